"""Does a fault of a measurement ever give a wrong stiffness without a word?

    python scripts/studies/campaign_faults.py [--quick] [--only WORD] [--seed 1]

A simulated arm of two driven elastic axes with two further elastic rotations, one log for each experiment in three
postures, and 139 faults: of the robot's file, the postures, clocks, gains, signs, wiring, filters, sensors and logs,
small and large, those of tests/plants/faults.py among them.  Each goes through the commands `measure`, `estimate` and
`fit`, as a user's would.  A row has the fault, the exit code, the status of the fit, the distance of the worst
stiffness from the truth in the standard deviations that the fit states, whether a warning or an error was given, and
its first words.  A fault is silent where the exit code is 0 and nothing was warned of.  It is asserted that no command
ends with a traceback, that the true study is silent and none of its stiffnesses further off than MAX_SILENT, and that
no silent fault is.  Errors of held numbers that are so small that the parameters take them up (`ABSORBED`) may be: of
those it is asserted that the fit says what it takes as exact.  Factors that no response can show (`STATED`) may be,
too: it is asserted that the fit states the number, in log and summary, as one of which at least as much shows in no
residual.  The last line is one JSON object.
"""

# One BLAS thread must be asked for before NumPy is loaded.
# ruff: noqa: E402
import os

for variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ[variable] = "1"

import argparse
import io
import json
import math
import re
import sys
import tempfile
import traceback
from collections import Counter
from contextlib import redirect_stderr, redirect_stdout
from copy import deepcopy
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import h5py
import numpy as np

sys.path.insert(0, str(Path(__file__).parents[2] / "tests"))
from plants.injected_faults import ABSORBED, FAULTS
from plants.injected_measurement import Measurement, true_measurement

from elastid.app.cli import run_command
from elastid.store.results import read_fit

MAX_SILENT = 3.0
SHOWS = re.compile(r"up to (\S+) % of (\S+) shows in no residual")
NO_GRAVITY = re.compile(r"has no gravity: .* would move by (\S+) standard deviations")
# What no response of the motors can show: factors of held numbers, relative; standard deviations that gravity moves.
STATED = {"torque constants of both +5 %": ("gain_u_*", math.log(1.05)), "gravity left out": ("gravity", MAX_SILENT)}
QUICK = ("none", "torque constant of motor 1 +20 %")


@dataclass(frozen=True)
class Outcome:
    """How a fault ended: exit code of the last command, status of the fit, words, and the worst stiffness' distance.

    lists_held: True if the fit lists what it takes as exact, and how exactly.  stated: by name, how much of a held
    number it says to show in no residual, relative; of gravity, the standard deviations that a number would move.
    """

    code: int
    status: str
    deviations: float | None
    warned: bool
    words: str
    lists_held: bool = False
    stated: dict[str, float] = field(default_factory=dict)

    @property
    def is_silent(self) -> bool:
        """Whether the user had no reason to look."""
        return self.code == 0 and not self.warned


def outcome(measurement: Measurement, truth: dict[str, float], folder: Path) -> Outcome:
    """The study of a measurement through the commands."""
    study = written(measurement, folder)
    for stage in ("measure", "estimate", "fit"):
        code, words = command([stage, str(study), "--run", str(folder / "run"), "--jobs", "1", "-q"])
        if code:
            break
    lines = [line for line in words.splitlines() if line.strip()]
    log = (folder / "run" / "run.log").read_text(encoding="utf-8") if (folder / "run").is_dir() else ""
    warnings = [line.split("WARNING ", 1)[1] for line in log.splitlines() if " WARNING " in line]
    # A misfit's last line is the same for all; its warnings say what would explain it.
    first = lines[-1] if code not in (0, 3) and lines else (warnings or lines or [""])[0]
    status, deviations = fitted(folder, truth)
    lists_held = "take as exact what the fit held" in log
    words = first.removeprefix("warning: ")
    return Outcome(code, status, deviations, bool(code or warnings), words, lists_held, _stated(folder, log))


def _stated(folder: Path, log: str) -> dict[str, float]:
    """The number of which so much shows in no residual, as log and summary both say; none where they do not."""
    path = folder / "run" / "summary.json"
    summary = path.read_text(encoding="utf-8") if path.is_file() else ""
    factors, gravity = ([set(said.findall(text)) for text in (log, summary)] for said in (SHOWS, NO_GRAVITY))
    stated = {name: float(percent) / 100 for percent, name in factors[0] & factors[1]}
    return stated | {"gravity": max(map(float, gravity[0] & gravity[1]), default=0.0)}


def command(arguments: list[str]) -> tuple[int, str]:
    """Exit code and what was written to stderr; -1 and the traceback where an exception left the program."""
    said = io.StringIO()
    with redirect_stdout(io.StringIO()), redirect_stderr(said):
        try:
            code = run_command(arguments)
        except Exception:
            return -1, traceback.format_exc()
    return code, said.getvalue()


def fitted(folder: Path, truth: dict[str, float]) -> tuple[str, float | None]:
    """Status of the fit, and the worst distance of a stiffness from the truth; nothing where there is no fit."""
    path = folder / "run" / "summary.json"
    if not path.is_file():
        return "", None
    status = str(json.loads(path.read_text(encoding="utf-8"))["status"])
    if not (folder / "run" / "fit.h5").is_file():
        return status, None
    result = read_fit(folder / "run" / "fit.h5")
    names, std = result.parameters.free_names, np.sqrt(np.diag(result.covariance))
    off = [abs(result.x[i] - np.log(truth[name])) / std[i] for i, name in enumerate(names) if name in truth]
    return status, float(np.max(off))


def written(measurement: Measurement, folder: Path) -> Path:
    """The study, the robot and the logs as files; JSON is YAML."""
    folder.mkdir()
    for log in measurement.logs:
        with h5py.File(folder / log.path, "w") as file:
            for name, values in log.signals.items():
                file[name] = values
    (folder / "robot.yml").write_text(json.dumps(measurement.robot, indent=1), encoding="utf-8")
    (folder / "study.yml").write_text(json.dumps(measurement.study, indent=1), encoding="utf-8")
    return folder / "study.yml"


def main() -> None:
    """A row for each fault, then one JSON line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="one of them, and none")
    parser.add_argument("--only", default="", help="faults whose name contains this")
    parser.add_argument("--seed", type=int, default=1)
    asked = parser.parse_args()
    true, truth = true_measurement(asked.seed)
    faults = {**FAULTS, **ABSORBED}
    names = [name for name in faults if asked.only in name and (name in QUICK or not asked.quick)]
    rows: dict[str, Outcome] = {}
    print(f"{'fault':<46}{'code':>5}  {'status':<14}{'error / std':>11}  words", flush=True)
    with tempfile.TemporaryDirectory() as temporary:
        for i, name in enumerate(names):
            faulty = deepcopy(true)
            faults[name](faulty)
            found = rows[name] = outcome(faulty, truth, Path(temporary) / str(i))
            off = "" if found.deviations is None else f"{found.deviations:.1f}"
            silence = "(silent, but it lists what is taken as exact)" if found.lists_held else "(silent)"
            words = silence if found.is_silent else found.words[:150]
            print(f"{name:<46}{found.code:>5}  {found.status:<14}{off:>11}  {words}", flush=True)
    print(json.dumps({"faults": judged(rows, bool(asked.only))}))


def judged(rows: dict[str, Outcome], some: bool) -> dict[str, Any]:
    """Counts and rows; AssertionError where a fault is silent, or a program crashed."""
    silent = {name: row.deviations for name, row in rows.items() if row.is_silent and row.deviations is not None}
    absorbed = {name: off for name, off in silent.items() if name in ABSORBED}
    stated = [name for name, (of, size) in STATED.items() if name in silent and rows[name].stated.get(of, 0.0) >= size]
    wrong = {name: off for name, off in silent.items() if off > MAX_SILENT and name not in (*absorbed, *stated)}
    unlisted = [name for name in absorbed if not rows[name].lists_held]
    crashed = [name for name, row in rows.items() if row.code == -1]
    worst = max((off for name, off in silent.items() if name not in (*absorbed, *stated)), default=0.0)
    codes = Counter(str(row.code) for row in rows.values())
    quiet = len(silent) - len(absorbed) - len(stated)
    counts = f"{quiet} silent, worst {worst:.1f}; {len(absorbed)} absorbed; {len(stated)} stated"
    print(f"{len(rows)} cases; exit codes {dict(codes)}; {counts}")
    assert not crashed, crashed
    assert some or rows["none"].is_silent, rows["none"]
    assert not wrong, wrong
    assert not unlisted, unlisted
    return {"cases": len(rows), "codes": codes, "silent": silent, "rows": {n: asdict(row) for n, row in rows.items()}}


if __name__ == "__main__":
    main()
