"""How often does each repair, note and warning appear on logs in which nothing is wrong?

    python scripts/studies/false_alarms.py [--quick] [--logs 300] [--seed 0] [--jobs 1] [--rig PATH]

Sets of clean logs of many kinds (plants.clean_logs) are read, repaired, estimated, as a study does, by a local method
(codes that begin with `local-`), fitted by the true robot's file with the diagnosis, and validated. An alarm is a
repair, a warning, a refusal, a status that is not `converged`, friction that is taken out of a robot without any, or an
excess of the cost; each counts once in a set. What is true of a
kind, such as a period that differs because the torque stepped in it, is none (`true_of`). --rig: a module with
`dataset` and `write` as the module of an outside rig has them, one more set of which is read for ten of the others.

No code has alarms in 1 % of the sets or more, but those that state their own rate in their words. The last line is one
JSON object.

300 sets: no period is left out; the line next to a slow wander is left out as weak in 2; in 2, of one realisation of
two periods, a spring is suspected. A mirrored torque, a misfit or an error of the model is found in none. Spikes were
replaced in 3, in two of them at the counts of a coarse encoder; since what recurs is none, no spike is found in any
set. Validation finds an excess of the cost in 2 (fits of one start without diagnosis), by a test that says of itself
that it does so once in two hundred; before the level that leaking torques share counted, in 7 at once in a hundred. Of
other draws of three kinds that had one, of one realisation of two periods with a wander or a step, it still finds it in
0, 12 and 19 % (14 to 16 draws, at once in a hundred; 40 to 55 % before): so little does not show such a noise.
True are misfits of 3 and suspected numbers of 5 with one realisation of two axes on a carrier, which nothing is said of
with three realisations, and elements of 3 that are a tenth of their noise in the true robot too.

Limits were set with these sets in view. Of 300 others (--seed 2, read and estimated only) 4 leave a line out, 3 a
period, 2 have a spike, and none a mirrored torque or a transient: 1.3 and 1.0 % of sets, each of four logs on average.
"""

# One BLAS thread must be asked for before NumPy is loaded.
# ruff: noqa: E402
import os

for variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ[variable] = "1"

import argparse
import importlib
import json
import sys
import tempfile
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import h5py
from scipy.stats import beta

sys.path.insert(0, str(Path(__file__).parents[2] / "tests"))
from plants.clean_logs import PERIOD, RATE_HZ, Kind

from elastid import verbs
from elastid.base.errors import ElastidError, Note
from elastid.base.execution import Execution
from elastid.experiment.specs.channels import ChannelSpec
from elastid.experiment.specs.experiment import ExperimentSpec
from elastid.experiment.specs.recorded import FileSpec, RecordedSpec
from elastid.fit.fitted_robot import FittedRobot
from elastid.fit.identify import identify
from elastid.fit.spec import FitSpec, ParameterSpec
from elastid.record import Record
from elastid.recorded.rig import RecordedRig
from elastid.response import Response
from elastid.robot import Robot
from elastid.study import load
from elastid.validation.agreement import noise_p, validate
from elastid.validation.measured_modes import measured_modes
from elastid.validation.residual_tests import FALSE_ALARM

RIG_EVERY = 10
# Sets of each period count, grid, wander, step and encoder, at least, of 300.
MIN_SETS = 50
# Of the sets; a judgement that states its own rate in its words may reach it.  Fewer sets show no such rate.
MAX_RATE, MIN_COUNTED, STATED = 0.01, 100, ("excess-of-cost",)
START = {"frf/transient-left-out": "the logs of the outside rig begin with its start"}


@dataclass(frozen=True)
class Alarms:
    """Codes of the alarms of one set of logs, with their sentences, and what was done with the set."""

    name: str
    codes: Mapping[str, str]


def judged(number: int, seed: int, rig: str) -> Alarms:
    """All alarms of a set of clean logs; of the outside rig where the number is beyond those of the kinds."""
    with tempfile.TemporaryDirectory() as name:
        if number < 0:
            return _alarms(f"outside rig {-number}", lambda: _of_rig(rig, -number, Path(name)), START, seed)
        kind = Kind.drawn(number, seed)

        def measured() -> tuple[list[Record], Any]:
            return read(kind, Path(name)), kind.robot

        return _alarms(str(kind), measured, true_of(kind), seed)


def true_of(kind: Kind) -> dict[str, str]:
    """Alarms that are true of a kind, and why."""
    true: dict[str, str] = {}
    if kind.step:
        true |= dict.fromkeys(("frf/periods-left-out", "frf/transient-left-out"), "the period with the step differs")
    if kind.carrier and kind.axes > 1 and not kind.has_reference:
        true["frf/lines-left-out"] = "at the line of a carrier that no reference shows the inputs move together"
    if kind.coulomb:
        true["nonlinear/friction-taken-out"] = "there is friction"
    if kind.source == "simulated" and kind.axes > 1:
        true["fit/weights"] = "axes at right angles barely move each other"
        if kind.realisations == 1 and kind.carrier:
            distorted = ("fit/likely-cause", "status-misfit", "excess-of-cost")
            true |= dict.fromkeys(distorted, "one realisation does not show how a carrier through postures distorts")
    return true


def _alarms(name: str, measured: Any, true: Mapping[str, str], seed: int) -> Alarms:
    """Reads, estimates, fits and validates; a refusal ends it."""
    codes: dict[str, str] = {}
    try:
        records, robot = measured()
        of_records = _codes(note for record in records for note in record.notes)
        codes |= of_records
        responses = verbs.estimate(records, robot)
        codes |= _of_responses(responses)
        codes |= {f"local-{code}": text for code, text in _local(records, robot).items() if code not in of_records}
        free = {pattern: ParameterSpec() for pattern in ("k_*", "d_*", "fm_*")}
        spec = FitSpec(parameters=free, starts=3, seed=seed)
        result = identify(responses, robot, spec)
        codes |= _codes(result.notes)
        if result.status != "converged":
            codes[f"status-{result.status}"] = result.message
        fitted = FittedRobot.of(result, robot, responses)
        judged = validate(responses, fitted.responses, ())
        codes |= {"excess-of-cost": judged.verdict} if noise_p(judged.configurations) < FALSE_ALARM else {}
        codes |= _codes(note for modes in measured_modes(fitted) for note in modes.notes)
    except ElastidError as error:
        codes["refused"] = str(error)
    return Alarms(name, {code: text for code, text in codes.items() if code not in true})


def _of_responses(responses: Iterable[Response]) -> dict[str, str]:
    """Notes on responses."""
    return _codes(note for response in responses for note in response.notes)


def _local(records: list[Record], robot: Robot) -> dict[str, str]:
    """Of the local rational method; new phases in every experiment are no repeats."""
    try:
        responses = verbs.estimate(records, robot, method="local_rational", friction="none")
    except ElastidError as error:
        return {"refused": str(error)}
    return _of_responses(responses)


def _codes(notes: Iterable[Note]) -> dict[str, str]:
    return {
        note.code: str(note)
        for note in notes
        if note.severity == "warning" or note.code == "nonlinear/friction-taken-out"
    }


def read(kind: Kind, folder: Path) -> list[Record]:
    """The logs of a kind, written to files and read as a laboratory's are."""
    files, channels = [], []
    for i, log in enumerate(kind.logs()):
        with h5py.File(folder / f"{i}.h5", "w") as file:
            for name, signal in log.signals.items():
                file[name] = signal
        files.append(FileSpec(f"{i}.h5", log.configuration, log.realisation, log.experiment))
    for j, place in enumerate(kind.robot.motor_locations, 1):
        channels += [ChannelSpec("r", place, f"r{j}")] if kind.has_reference else []
        channels += [ChannelSpec("u", place, f"u{j}")]
        channels += [ChannelSpec("y", place, f"q{j}", quantity="position", side="motor")]
    recorded = RecordedSpec(
        RATE_HZ, tuple(channels), tuple(files), PERIOD / RATE_HZ, half_wave=kind.half_wave, hold="zero-order"
    )
    rig = RecordedRig(kind.robot, ExperimentSpec(kind.configurations, recorded=recorded), folder)
    return [rig.measure(experiment) for experiment in rig.experiments]


def _of_rig(path: str, number: int, folder: Path) -> tuple[list[Record], Any]:
    """A set of the outside rig with its true stiffnesses as a start."""
    # Nothing is written beside it.
    sys.dont_write_bytecode = True
    os.environ["NUMBA_CACHE_DIR"] = str(Path(tempfile.gettempdir()) / "outside_rig")
    sys.path.insert(0, str(Path(path).parent))
    module = importlib.import_module(Path(path).stem)
    module.write(module.dataset(seed=number, M=1 + number % 3, periods=(2, 3, 5)[number % 3]), str(folder))
    study = load(folder / "study.yml").study
    rig = RecordedRig(study.robot, study.experiment, folder)
    return [rig.measure(experiment) for experiment in rig.experiments], study.robot


def interval(count: int, of: int) -> tuple[float, float]:
    """The 95 % interval of a rate (Clopper and Pearson, 1934)."""
    low = float(beta.ppf(0.025, count, of - count + 1)) if count else 0.0
    return low, float(beta.ppf(0.975, count + 1, of - count)) if count < of else 1.0


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--quick", action="store_true")
    parser.add_argument("--logs", type=int, default=300)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--jobs", type=int, default=1)
    parser.add_argument("--rig", default="")
    given = parser.parse_args()
    count = 2 if given.quick else given.logs
    outside = range(-1, -1 - count // RIG_EVERY, -1) if given.rig else ()
    judge = partial(judged, seed=given.seed, rig=given.rig)
    results = []
    for index, each in Execution(given.jobs).unordered(judge, [*range(count), *outside]):
        results.append((index, each))
        for code, text in each.codes.items():
            print(f"{code}: {each.name}: {text[:160]}", flush=True)
        if len(results) % 10 == 0:
            print(f"after {len(results)} sets:", dict(Counter(c for _, one in results for c in one.codes)), flush=True)
    alarms = [each for _, each in sorted(results)]
    totals = Counter(code for each in alarms for code in each.codes)
    rows = rates(totals, len(alarms))
    too_often = MAX_RATE * len(alarms) if len(alarms) >= MIN_COUNTED else 1
    wrong = [
        f"{code} in {n} of {len(alarms)} sets" for code, n in totals.items() if n > too_often and code not in STATED
    ]
    kinds = covered([Kind.drawn(number, given.seed) for number in range(count)], alarms)
    wrong += [f"{kind} has {sets} sets" for kind, (sets, _) in kinds.items() if sets < MIN_SETS * count // 300]
    print(json.dumps({"logs": len(alarms), "alarms": rows, "kinds": kinds, "wrong": wrong}))
    assert not wrong, "\n".join(wrong)


def covered(kinds: Sequence[Kind], alarms: Sequence[Alarms]) -> dict[str, tuple[int, int]]:
    """Sets of each kind, and those of them with any alarm."""
    sets, raised = Counter[str](), Counter[str]()
    for kind, each in zip(kinds, alarms, strict=False):
        names = [f"{name} {getattr(kind, name)}" for name in ("periods", "grid", "wander", "step", "counts")]
        sets.update(names)
        raised.update(names if each.codes else ())
    return {name: (sets[name], raised[name]) for name in sorted(sets)}


def rates(totals: Mapping[str, int], sets: int) -> dict[str, tuple[int, int, float, float]]:
    """Count, sets and ends of the 95 % interval of each code."""
    return {code: (count, sets, *interval(count, sets)) for code, count in sorted(totals.items())}


if __name__ == "__main__":
    main()
