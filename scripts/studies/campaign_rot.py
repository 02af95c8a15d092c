"""Is a bit that flips in the results of a study ever silent?

Small studies of both kinds, an elastic joint and the friction of an axis, run once with page and figures. Then one
random bit of one random file of the run folder flips, and a user looks at it: `elastid inspect FILE`, then
`elastid run` of the same study, in a process that has read nothing yet. Every file or folder of files is as likely as
any other but run.log, which no program reads. A flip is

- noticed: `inspect` ends with exit code 1 and a sentence with the file, and `run` says that the file has changed, makes
  it again and leaves the folder with the same bytes as before;
- of no content: in a list of checksums, or in the 512 bytes in front of an HDF5 file, where no number is; `run` leaves
  the same content;
- unnoticed: anything else. Goal: none of 1000.
"""

from __future__ import annotations

import argparse
import contextlib
import io
import json
import os
import tempfile
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from importlib import import_module
from multiprocessing import get_context
from multiprocessing.connection import Connection
from pathlib import Path

import numpy as np
from campaign_kills import FEW_PASSES, ROBOT, STUDY

from elastid.app import scaffold
from elastid.app.cli import run_command
from elastid.app.stage_table import FRICTION, SIMULATED, stages_of
from elastid.store.files import CHECKSUMS, USER_BLOCK

NOTICED, NO_CONTENT, UNNOTICED = "noticed", "of no content", "UNNOTICED"


@dataclass(frozen=True)
class Finished:
    """A study and its finished run."""

    study: Path
    options: tuple[str, ...]

    @property
    def run(self) -> Path:
        """The run folder."""
        return self.study.parent / "run"

    @property
    def command(self) -> list[str]:
        """The words of `elastid run` of it."""
        words = [word for option in self.options for word in ("--set", option)]
        return ["run", str(self.study), "--run", str(self.run), "--jobs", "1", *words]


@dataclass(frozen=True)
class Said:
    """How a command ended and what it said."""

    code: int
    text: str


def finished(folder: Path, kinds: Sequence[str]) -> dict[str, Finished]:
    """Studies of these kinds, each run once with its figures."""
    for stage in (*stages_of(SIMULATED).values(), *stages_of(FRICTION).values()):
        import_module(stage.module)  # once, for all processes that are copies of this one
    joint, axis = folder / "joint", folder / "axis"
    joint.mkdir()
    (joint / "robot.yml").write_text(ROBOT, encoding="utf-8")
    (joint / "study.yml").write_text(STUDY, encoding="utf-8")
    axis_study = scaffold.new(axis, "friction")
    figures = ("report.formats=[png]",)
    found = {
        "elastic": Finished(joint / "study.yml", ("fit.starts=2", "fit.bootstrap=0", "fit.profile=[]", *figures)),
        "friction": Finished(axis_study, (*FEW_PASSES, *figures)),
    }
    found = {kind: found[kind] for kind in kinds}
    for each in found.values():
        (said,) = apart([each.command])
        assert said.code == 0, said.text
    return found


def apart(commands: list[list[str]]) -> list[Said]:
    """Commands in a process that has read none of the files before."""
    context = get_context("fork")
    ours, theirs = context.Pipe(duplex=False)
    process = context.Process(target=_carry_out, args=(commands, theirs))
    process.start()
    theirs.close()
    try:
        said: list[Said] = ours.recv()
    except EOFError:
        said = [Said(-1, "the process died")] * len(commands)
    process.join()
    return said


def _carry_out(commands: list[list[str]], answer: Connection) -> None:
    said = []
    for command in commands:
        heard = io.StringIO()
        with contextlib.redirect_stdout(heard), contextlib.redirect_stderr(heard):
            code = run_command(command)
        # A line is broken at the width of a terminal.
        said.append(Said(code, "".join(heard.getvalue().split())))
    answer.send(said)


def contents(run: Path) -> dict[str, bytes]:
    """Every file of a run folder but the log, which has the time in it."""
    files = (path for path in run.rglob("*") if path.is_file() and path.name != "run.log")
    return {path.relative_to(run).as_posix(): path.read_bytes() for path in files}


def verdict(name: str, place: int, inspected: Said, made_again: Said, same: bool) -> str:
    """What became of a flip in byte `place` of a file; same: whether the folder has its old bytes again."""
    if (
        inspected.code == 1
        and name in inspected.text
        and made_again.code == 0
        and f"{name}haschanged" in made_again.text
        and same
    ):
        return NOTICED
    holds_no_number = name == CHECKSUMS or (name.endswith(".h5") and place < USER_BLOCK)
    return NO_CONTENT if holds_no_number and made_again.code == 0 and same else UNNOTICED


def flip(study: Finished, name: str, bit: int, before: dict[str, bytes]) -> str:
    """Flip a bit of a file, look at it as a user would, and give the folder its old bytes."""
    path, times = study.run / name, (study.run / name).stat()
    spoilt = bytearray(before[name])
    spoilt[bit // 8] ^= 1 << bit % 8
    path.write_bytes(spoilt)
    # A disk that loses a bit keeps the time of the file.
    os.utime(path, ns=(times.st_atime_ns, times.st_mtime_ns))
    inspected, made_again = apart([["inspect", str(path)], study.command])
    after = contents(study.run)
    content = {key: value for key, value in after.items() if key != CHECKSUMS}
    same = content == {key: value for key, value in before.items() if key != CHECKSUMS}
    found = verdict(name, bit // 8, inspected, made_again, same)
    if found == UNNOTICED:
        print(name, bit, inspected, made_again, same, flush=True)
    for key in after.keys() - before.keys():
        (study.run / key).unlink()
    for key, value in before.items():
        if after.get(key) != value:
            (study.run / key).parent.mkdir(parents=True, exist_ok=True)
            (study.run / key).write_bytes(value)
    return found


def campaign(flips: int, seed: int, folder: Path, kinds: Sequence[str]) -> Counter[str]:
    """Flips by kind of study, file and verdict."""
    rng, counts = np.random.default_rng(seed), Counter[str]()
    studies = finished(folder, kinds)
    before = {kind: contents(study.run) for kind, study in studies.items()}
    places = sorted({(kind, name.partition("/")[0]) for kind, files in before.items() for name in files})
    for number in range(1, flips + 1):
        kind, place = places[int(rng.integers(len(places)))]
        name = str(rng.choice(sorted(name for name in before[kind] if name.partition("/")[0] == place)))
        bit = int(rng.integers(8 * len(before[kind][name])))
        found = flip(studies[kind], name, bit, before[kind])
        counts.update([found, f"{kind}, {place}: {found}"])
        print(f"{number:5} {kind:8} {name:32} bit {bit:9} {found}", flush=True)
    return counts


def main() -> None:
    """A line each flip, then one JSON line with the counts."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--flips", type=int, default=1000)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--quick", action="store_true", help="2 flips of an elastic study")
    options = parser.parse_args()
    flips, kinds = (2, ["elastic"]) if options.quick else (options.flips, ["elastic", "friction"])
    with tempfile.TemporaryDirectory() as temporary:
        counts = campaign(flips, options.seed, Path(temporary), kinds)
    print(json.dumps({"flips": flips, "unnoticed": counts[UNNOTICED], "counts": dict(sorted(counts.items()))}))
    assert not counts[UNNOTICED]


if __name__ == "__main__":
    main()
