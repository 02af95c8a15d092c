"""Does a command lose anything that is killed at any moment, in any of its stages, and resumed?

Small studies of both kinds, an elastic joint and the friction of an axis, run from nothing or from the results of all
stages but one; of the joint also a fleet, a live session, and a map, a move and the margins of its loops. SIGINT to all
processes as by Ctrl-C, SIGTERM or SIGKILL to the first one, at a moment drawn over the length of an undisturbed run,
that is also while Python and its libraries load. Then the same command again. Asserted of every kill: exit code 130, or
-9, no traceback, and no process left; of every resume: exit code 0 and a folder with the same bytes as that of the
undisturbed run, but for run.log. Full size: 200 kills.
"""

from __future__ import annotations

import argparse
import json
import os
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections import Counter
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from elastid.app import scaffold
from elastid.app.stage_table import FRICTION, SIMULATED, Stage, stages_of

ROBOT = """\
name: one elastic joint
gravity: [0, 0, 0]
bodies:
  - name: load
    joints:
      - name: 1
        axis: z
        motor: {inertia: 1e-3, ratio: 1, viscous: 1e-3}
        spring: {stiffness: 50, damping: 0.01}
        limits: {angle: [-90 deg, 90 deg]}
    inertia: 1e-3
frames: [{name: tool, body: load, placement: {xyz: [0.2, 0, 0]}}]
"""
STUDY = """\
name: joint
robot: robot.yml
seed: 1
excitation: {rate_hz: 500, period: 1 s, band_hz: [5, 100], torque_rms: 0.1}
experiment:
  configurations: {a: [0], b: [30 deg]}
  simulated: {truth: {k_1: 60 N*m/rad}, noise: {torque_std: 1e-3, angle_std: 1e-6}}
fit: {starts: 4, bootstrap: 40, profile: [k_1], parameters: {k_1: {}, d_1: {}}}
validation: {folds: 2}
report: {formats: []}
"""
# The friction template, made small.
FEW_PASSES = (
    "friction.rate_hz=500",
    "friction.passes={count: 5, repeat: 1, speeds: [10 deg/s, 60 deg/s], window: [-30 deg, 30 deg]}",
    "friction.law={stribeck: no, directions: no, load: no, temperature: no}",
    "report.formats=[]",
)
FLEET = """\
name: joints
study: study.yml
members:
  - {robot: "r ä", date: "2026-01-31", set: {seed: 1}}
  - {robot: "2 [b]", date: "2026-01-31", set: {seed: 2}}
"""
MOVE = "1 deg\n-20\n35\n"
BEGINNING = (("fleet", "fleet.yml"), ("live", "study.yml", "--goal", "k_1: 1 %", "--simulate"))
FROM_A_FIT = (
    ("map", "study.yml", "--random", "40"),
    ("tune", "study.yml", "--path", "move.csv", "--time", "1"),
    ("loops", "study.yml", "--draws", "20"),
)
WHOLE = "all stages"
CODES = {signal.SIGINT: (130,), signal.SIGTERM: (130,), signal.SIGKILL: (-9,)}
# Of a signal that finds Python before its own first instruction for it; no code of elastid runs by then.
CODES_OF_PYTHON = {signal.SIGINT: (-2, 1), signal.SIGTERM: (-15,), signal.SIGKILL: (-9,)}
# s that processes have to end once the first of them has.
PATIENCE_S = 20.0


@dataclass
class Kind:
    """A command and the folder of its file, with an undisturbed result, and how long its stages take, each alone.

    words: command, file and options.  base: a finished run from which the command starts, None for an empty folder.
    """

    folder: Path
    words: tuple[str, ...]
    stages: dict[str, Stage]
    base: Path | None = None
    lengths_s: dict[str, float] = field(default_factory=dict)

    def command(self, run: Path, jobs: int) -> list[str]:
        """The command into a folder."""
        name, *rest = self.words
        placed = [str(self.folder / word) if (self.folder / word).is_file() else word for word in rest]
        return [sys.executable, "-m", "elastid", name, *placed, "--run", str(run), "--jobs", str(jobs), "-q"]

    @property
    def undisturbed(self) -> Path:
        """The folder that every other one must be like."""
        return self.folder / f"undisturbed_{self.words[0]}"

    def begun(self, what: str, run: Path) -> None:
        """A folder in which one stage is missing, or all."""
        shutil.rmtree(run, ignore_errors=True)
        if what == WHOLE and self.base is not None:
            shutil.copytree(self.base, run)
        if what != WHOLE:
            shutil.copytree(self.undisturbed, run)
            for name in self.stages[what].leaves:
                path = run / name
                # A stage that the study does not have leaves nothing.
                shutil.rmtree(path) if path.is_dir() else path.unlink(missing_ok=True)

    def length_s(self, what: str, run: Path) -> float:
        """How long a run takes that has this to do."""
        if what not in self.lengths_s:
            self.begun(what, run)
            began = time.perf_counter()
            subprocess.run(self.command(run, 1), check=True, capture_output=True)
            self.lengths_s[what] = time.perf_counter() - began
            assert contents(run) == contents(self.undisturbed), f"{what} done again is not the same"
        return self.lengths_s[what]


def kinds(folder: Path, is_quick: bool) -> dict[str, Kind]:
    """The commands (quick: that of a joint alone), each run once; those that use a fit start from the joint's."""
    joint, axis = folder / "joint", folder / "axis"
    joint.mkdir()
    for name, text in (("robot.yml", ROBOT), ("study.yml", STUDY), ("fleet.yml", FLEET), ("move.csv", MOVE)):
        (joint / name).write_text(text, encoding="utf-8")
    scaffold.new(axis, "friction")
    of_axis = {name: stage for name, stage in stages_of(FRICTION).items() if not stage.needs}
    few = tuple(word for option in FEW_PASSES for word in ("--set", option))
    elastic = Kind(joint, ("run", "study.yml"), stages_of(SIMULATED))
    found = {"elastic": elastic, "friction": Kind(axis, ("run", "study.yml", *few), of_axis)}
    found |= {words[0]: Kind(joint, words, {}) for words in BEGINNING}
    found |= {words[0]: Kind(joint, words, {}, elastic.undisturbed) for words in FROM_A_FIT}
    if is_quick:
        found = {"elastic": elastic}
    for kind in found.values():
        kind.begun(WHOLE, kind.undisturbed)
        began = time.perf_counter()
        subprocess.run(kind.command(kind.undisturbed, 1), check=True, capture_output=True)
        kind.lengths_s[WHOLE] = time.perf_counter() - began
    return found


def contents(run: Path) -> dict[str, bytes]:
    """Every file of a run folder but the log, which has the time in it."""
    files = (path for path in run.rglob("*") if path.is_file() and path.name != "run.log")
    return {path.relative_to(run).as_posix(): path.read_bytes() for path in files}


@dataclass(frozen=True)
class Killed:
    """How a program ended that was sent a signal; too_late: it had ended by itself before."""

    code: int
    complained: str
    too_late: bool

    @property
    def before_elastid(self) -> bool:
        """Whether the signal found Python still loading itself, which has its own words for it."""
        return "elastid" not in self.complained

    def check(self, number: signal.Signals) -> None:
        """AssertionError where it ended in another way than it has to."""
        expected = CODES[number] + CODES_OF_PYTHON[number] * self.before_elastid
        assert self.code in expected, (number.name, self.code, self.complained)
        assert self.before_elastid or "Traceback" not in self.complained, self.complained


def killed(command: list[str], number: signal.Signals, after_s: float) -> Killed:
    """Start a program and send it a signal; all its processes have to end."""
    program = subprocess.Popen(
        command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True, start_new_session=True
    )
    time.sleep(after_s)
    too_late = program.poll() is not None
    if not too_late:
        if number == signal.SIGINT:  # as a terminal does
            os.killpg(program.pid, number)
        else:
            program.send_signal(number)
    _, complained = program.communicate(timeout=10 * PATIENCE_S)
    # A signal in the last moment finds nothing to interrupt.
    found = Killed(program.returncode, complained, too_late or program.returncode == 0)
    until = time.monotonic() + PATIENCE_S
    while is_alive(program.pid):
        assert time.monotonic() < until, f"{number.name}: processes of {command} are left"
        time.sleep(0.02)
    return found


def is_alive(group: int) -> bool:
    """Whether a group has processes."""
    try:
        os.killpg(group, 0)
    except ProcessLookupError:
        return False
    return True


def campaign(kills: int, seed: int, folder: Path, is_quick: bool) -> Counter[str]:
    """Kills by kind, stage, signal and where they fell; AssertionError at the first that is not as it has to be."""
    rng, counts, number_of = np.random.default_rng(seed), Counter[str](), 0
    studies, run = kinds(folder, is_quick), folder / "run"
    while number_of < kills:
        name = str(rng.choice(list(studies)))
        kind, jobs = studies[name], int(rng.choice([1, 1, 1, 2]))
        what = str(rng.choice([WHOLE, *kind.stages]))
        number = signal.Signals(int(rng.choice([signal.SIGINT, signal.SIGTERM, signal.SIGKILL])))
        after_s = kind.length_s(what, run) * float(rng.uniform(0, 1))
        kind.begun(what, run)
        found = killed(kind.command(run, jobs), number, after_s)
        if found.too_late:
            counts["too late"] += 1
            continue
        found.check(number)
        again = subprocess.run(kind.command(run, jobs), capture_output=True, text=True, check=False)
        assert again.returncode == 0, again.stderr
        ours, theirs = contents(run), contents(kind.undisturbed)
        assert ours == theirs, sorted(n for n in ours.keys() | theirs.keys() if ours.get(n) != theirs.get(n))
        number_of += 1
        began = "before elastid" if found.before_elastid and number != signal.SIGKILL else ""
        counts.update([f"{name}, {what}", number.name, f"{jobs} processes", *filter(None, [began])])
        print(
            f"{number_of:4} {name:8} {what:10} {number.name:7} {jobs} {after_s:6.2f} s {found.code:4} {began}",
            flush=True,
        )
    return counts


def main() -> None:
    """A line each kill, then one JSON line with the counts."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--kills", type=int, default=200)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--quick", action="store_true", help="one kill of an elastic study")
    options = parser.parse_args()
    kills = 1 if options.quick else options.kills
    with tempfile.TemporaryDirectory() as temporary:
        counts = campaign(kills, options.seed, Path(temporary), options.quick)
    print(json.dumps({"kills": kills, "same_bytes": kills, "counts": dict(sorted(counts.items()))}))


if __name__ == "__main__":
    main()
