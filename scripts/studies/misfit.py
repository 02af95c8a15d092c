"""Does a wrong model ever end as converged, and a true one as a misfit? Faults and honest data of a simulated arm.

    python scripts/studies/misfit.py [--quick] [--sets 100] [--rig 20] [--faulty 5] [--noise 0.005 0.02 0.05] [--seed 0]
                                     [--jobs 2]

The arm, its fifteen faults and the distortion of friction are those of tests/plants/faults.py. True models: noise, and
friction whose distortion the covariance knows, both estimated with 3 and with 8 degrees of freedom, without a floor and
with floors of 1.5 and 4.5 %, --sets data sets each; and --rig simulations each of a rig of two axes with dry friction
of 0.05 and 0.16 of the torque that nothing takes out (tests/plants/dry_friction.py). Faults: --faulty data sets at each
level of noise, with each floor. Counted is how the fits end, and by how many of its stated standard deviations the
worst stiffness is off where a wrong model ends as converged or at a bound; and the share of true stiffnesses that the
95 % intervals of misfits hold. It is asserted that 99 % of true models converge, and that no wrong model whose
stiffness is 5 standard deviations off ends as converged. The last line is one JSON object.

516 true models (--sets 40 --rig 6): all converge. One data set of each fault with each floor in 0.5, 2 and 5 % of
noise, 135 fits: exchanged postures and a mirrored motor end as model errors, everything else as misfits, and none as
converged. A torsion that the file lacks, in 5 % of noise, where V is 1.03 to 1.14 of its expectation and stiffnesses 16
to 34 of their deviations off, is a misfit by its resonance, and is named. Intervals of misfits in 2 % of noise hold
80 % of the true stiffnesses, 42 % under the worst fault, a payload that is forgotten.
"""

# One BLAS thread must be asked for before NumPy is loaded.
# ruff: noqa: E402
import os

for variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ[variable] = "1"

import argparse
import json
import sys
from collections import Counter
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[2] / "tests"))
from plants.dry_friction import TORQUE_RMS, measured, robot
from plants.faults import FAULTS, SPEC, Case, drawn, rubbing, true_case

from elastid.base.arrays import FloatArray
from elastid.base.execution import ordered
from elastid.base.statistics import QUANTILE_95
from elastid.fit.identify import identify
from elastid.fit.result import FitResult
from elastid.fit.spec import WeightSpec
from elastid.frf.estimate import estimate
from elastid.frf.spec import EstimatorSpec

FLOORS = (0.0, 0.015, 0.045)
TRUE_KINDS = ("noise, 3 degrees of freedom", "noise, 8", "friction, 3", "friction, 8")
RIGS = {"rig, Coulomb 0.05 of the torque": 0.05, "rig, Coulomb 0.16 of the torque": 0.16}
SILENT = ("converged", "at_bound")
MIN_CONVERGED, MAX_DEVIATIONS = 0.99, 5.0
# Blocks see what differs between them: intervals of misfits hold less than the 95 % of true models, on average more.
MIN_MISFITS_HOLD = 0.6


@dataclass(frozen=True)
class Fit:
    """A data set by what it is of, its floor, its noise and its number."""

    kind: str
    floor: float
    noise: float
    seed: tuple[int, int]

    def __call__(self) -> tuple[str, FloatArray]:
        """The status, and the deviations by which each stiffness is off."""
        if self.kind in RIGS:
            return rig_status(RIGS[self.kind], self.floor, self.seed[1]), np.zeros(1)
        rng, case = np.random.default_rng(self.seed), _case(self.kind)
        if self.kind in FAULTS:
            data = drawn(case, rng, self.noise)
        else:
            dof = float(self.kind.split(", ")[1].split()[0])
            data = (
                drawn(case, rng, self.noise, dof) if "noise" in self.kind else rubbing(case, rng, 2 * self.noise, dof)
            )
        result = identify(data, case.robot, replace(SPEC, weights=WeightSpec(floor=self.floor)))
        return result.status, deviations(result, case)


def rig_status(coulomb: float, floor: float, seed: int) -> str:
    """How the fit of a simulated rig with dry friction ends, its responses estimated as they are."""
    levels = (coulomb * TORQUE_RMS[0], coulomb * TORQUE_RMS[1])
    records, lines = measured(levels, 3, 1000 + seed)
    responses = [estimate(list(each), EstimatorSpec(friction="none"), lines) for each in records]
    return identify(responses, robot(levels), replace(SPEC, weights=WeightSpec(floor=floor))).status


@cache
def _case(kind: str) -> Case:
    case = true_case()
    return FAULTS[kind](case) if kind in FAULTS else case


def _fitted(fit: Fit) -> tuple[str, FloatArray]:
    return fit()


def deviations(result: FitResult, case: Case) -> FloatArray:
    """The distances of the stiffnesses from the true ones, in standard deviations of ln k as the fit states them."""
    free = result.parameters.free_names
    off = [
        abs(result.x[free.index(name)] - np.log(k)) / np.sqrt(result.covariance[free.index(name), free.index(name)])
        for name, k in case.stiffness.items()
    ]
    return np.array(off)


def true_models(sets: int, rigs: int, seed: int, jobs: int) -> dict[str, Any]:
    """The statuses of fits of true models."""
    print(f"{'true model':<34}{'floor':>6}{'fits':>6}  ends")
    counts: dict[str, Counter[str]] = {}
    for kind, count in (dict.fromkeys(TRUE_KINDS, sets) | dict.fromkeys(RIGS, rigs)).items():
        for floor in FLOORS:
            fits = [Fit(kind, floor, 0.005, (seed, number)) for number in range(count)]
            ends = counts[f"{kind}, floor {floor:g}"] = Counter(status for status, _ in ordered(_fitted, fits, jobs))
            print(f"{kind:<34}{floor:>6g}{count:>6}  {_said(ends)}")
    every = sum(counts.values(), Counter[str]())
    share = every["converged"] / every.total()
    print(f"{'all':<34}{'':>6}{every.total():>6}  {_said(every)}: {100 * share:.2f} % converged\n")
    assert share >= MIN_CONVERGED, every
    return {"fits": every.total(), "converged": share, "ends": {kind: dict(ends) for kind, ends in counts.items()}}


def wrong_models(sets: int, noises: list[float], floors: tuple[float, ...], seed: int, jobs: int) -> dict[str, Any]:
    """The statuses of fits of wrong models, and how far off those are that end as if nothing were wrong."""
    print(f"{'wrong model':<34}{'noise':>6}{'fits':>6}{'worst silent / std':>20}{'misfits hold':>14}  ends")
    rows, far = {}, []
    for kind in FAULTS:
        for noise in noises:
            fits = [Fit(kind, floor, noise, (seed + 1, n)) for floor in floors for n in range(sets)]
            found = ordered(_fitted, fits, jobs)
            ends = Counter(status for status, _ in found)
            silent = max((float(off.max()) for status, off in found if status in SILENT), default=0.0)
            off = np.concatenate([np.zeros(0), *(off for status, off in found if status == "misfit")])
            held = float(np.mean(off < QUANTILE_95)) if off.size else None
            share = "" if held is None else f"{100 * held:.0f} %"
            print(f"{kind:<34}{noise:>6g}{len(fits):>6}{silent:>20.1f}{share:>14}  {_said(ends)}", flush=True)
            rows[f"{kind}, noise {noise:g}"] = {"ends": dict(ends), "worst_silent": silent, "misfits_hold": held}
            if silent > MAX_DEVIATIONS:
                far.append((kind, noise, silent))
    assert not far, far
    held = [row["misfits_hold"] for row in rows.values() if row["misfits_hold"] is not None]
    mean, least = 100 * float(np.mean(held)), 100 * min(held)
    print(f"intervals of misfits hold {mean:.0f} % of the true stiffnesses, {least:.0f} % under the worst fault")
    assert len(floors) < len(FLOORS) or np.mean(held) > MIN_MISFITS_HOLD, held
    return rows


def _said(ends: Counter[str]) -> str:
    return ", ".join(f"{status.replace('_', ' ')} {count}" for status, count in ends.most_common())


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--quick", action="store_true", help="few data sets, to see that it runs")
    parser.add_argument("--sets", type=int, default=100)
    parser.add_argument("--rig", type=int, default=20)
    parser.add_argument("--faulty", type=int, default=5)
    parser.add_argument("--noise", type=float, nargs="*", default=[0.005, 0.02, 0.05])
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--jobs", type=int, default=2)
    given = parser.parse_args()
    if given.quick:
        given.sets, given.rig, given.faulty, given.noise, given.jobs = 2, 1, 1, [0.01], 1
    results = {
        "true": true_models(given.sets, given.rig, given.seed, given.jobs),
        "wrong": wrong_models(given.faulty, given.noise, FLOORS[: 1 if given.quick else None], given.seed, given.jobs),
    }
    print(json.dumps({"misfit": results}))


if __name__ == "__main__":
    main()
