"""Do 95 % intervals of stiffness and damping hold the truth on a robot with friction, through the whole measured wing?

    python scripts/studies/friction_coverage.py [--quick] [--sets 300] [--axes 2 3] [--coulomb 0 0.05 0.16 0.3]
                                       [--carrier yes no] [--friction none auto] [--realisations 4] [--verify]

Simulated records of a robot with Coulomb friction of so many times the rms torque (`fast_rig`, new phases and new noise
for every data set), estimated and fitted from the truth without a floor, so that the intervals are made of noise and
friction alone. Of every case: the share of the 95 % intervals of all k and d that hold the truth, and by parameter the
bias and the scatter of ln p over the standard deviation that the fit states. The share of every case must lie between
94 and 96 %, three of its own standard deviations allowed for chance. Both treatments share the records of a data set;
one of two axes costs 0.06 CPU seconds to simulate, 0.2 with `none` and 1.2 with `auto`, one of three axes 0.3, 0.4 and
3. The last line is one JSON object.

With `none`, at 0, 0.05, 0.16 and 0.3, each with a carrier and at rest: two axes, 300 data sets each, 96.8 and 96.3
+- 0.6 %, 95.6 and 95.4, 95.8 and 95.2, 95.3 and 95.0; three axes, 100 each, 95.8 and 95.9 +- 0.6 %, 95.9 and 95.2, 96.0
and 95.9, 94.9 and 95.8; bias at most 0.51 of the stated deviations, the worst parameter at 89 %. With `auto`: two axes,
60 each, 97.5 and 95.6 +- 1.4 %, 96.9 and 95.8, 95.8 and 96.4, 95.6 and 94.4; three axes, 20 each, 97.1 and 97.1 +- 1.4
%, 97.5 and 96.4, 97.5 and 95.4, 95.7 and 93.9; bias at most 0.89 of the stated deviations of 0.002 to 0.06 %, the worst
parameter at 70 % of 20.
"""

# One BLAS thread must be asked for before NumPy is loaded.
# ruff: noqa: E402
import os

for variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ[variable] = "1"

import argparse
import json
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from importlib.resources import files
from pathlib import Path
from typing import Any, get_args

import numpy as np
from fast_rig import FastRig, at_rest
from study_plants import fit_from_truth, with_coulomb

from elastid.base.arrays import FloatArray
from elastid.base.execution import ordered
from elastid.base.statistics import QUANTILE_95
from elastid.excitation.spec import MultisineSpec
from elastid.experiment.plan.plan import Plan, make_plan
from elastid.experiment.simulated.rig import SimulatedRig
from elastid.experiment.specs.disturbances import NoiseSpec
from elastid.experiment.specs.experiment import ExperimentSpec
from elastid.experiment.specs.simulated import CarrierSpec, SimulatedSpec
from elastid.frf.spec import EstimatorSpec, Friction
from elastid.nonlinear.find import find_friction
from elastid.nonlinear.take_out import estimate_without_friction
from elastid.robot import Body, Joint, Motor, Placement, Robot, Spring
from elastid.study import load

LEVELS = (0.0, 0.05, 0.16, 0.3)
# What the rig's nonlinear mechanics add, over the RMS of a signal.
MAX_ERROR = 2e-3
# Of the 95 % intervals, those that must hold the truth, and standard deviations of chance beside it.
COVERED, CHANCE = (0.94, 0.96), 3.0
# Runge-Kutta steps in a sample in which a motor reverses: with 2 the friction of a reversal is biased.
SUBSTEPS = 16


@dataclass(frozen=True)
class Bench:
    """A robot without friction, its postures, the excitation, and the carrier that it has where it has one."""

    robot: Robot
    postures: dict[str, tuple[float, ...]]
    excitation: MultisineSpec
    carrier: CarrierSpec
    noise: NoiseSpec
    substeps: int


def two_axes() -> Bench:
    """Two axes about the vertical with a third spring in the upper arm."""

    def driven(name: str, k: float, d: float, inertia: float) -> Joint:
        return Joint(name, "z", Spring(k, d), Motor(inertia, 100.0, 2e-3))

    robot = Robot(
        "two axes",
        (
            Body("upper", joints=(driven("1", 2.5e5, 250, 6e-3),), mass=40, center_of_mass=(0.2, 0, 0),
                 inertia=(1, 3, 3)),
            Body("tube", "upper", Placement((0.45, 0, 0)), (Joint("a", "z", Spring(1.5e5, 120)),), mass=40,
                 center_of_mass=(0.25, 0, 0), inertia=(1, 3, 3)),
            Body("fore", "tube", Placement((0.45, 0, 0)), (driven("2", 8e4, 80, 3e-3),), mass=50,
                 center_of_mass=(0.4, 0, 0), inertia=(1, 4, 4)),
        ),
        gravity=(0.0, 0.0, 0.0),
    )  # fmt: skip
    return Bench(
        robot,
        {"open": (0.3, 0.7), "bent": (0.3, -1.4)},
        MultisineSpec(500.0, 2.0, (1.0, 40.0), (60.0, 30.0)),
        CarrierSpec(0.01, 1),
        NoiseSpec(torque_std=1.0, encoder_counts=2**18),
        SUBSTEPS,
    )


def three_axes() -> Bench:
    """The robot of `elastid demo` in three of its configurations, excited as there: at 500 Hz, lines up to 60 Hz."""
    study = load(Path(str(files("elastid") / "app" / "templates" / "serial" / "study.yml"))).study
    chosen = {name: study.experiment.configurations[name] for name in ("stretched", "folded", "reach")}
    assert study.excitation is not None
    return Bench(
        with_coulomb(study.robot, (0.0, 0.0, 0.0)),
        chosen,
        replace(study.excitation, period=2.0),
        CarrierSpec(0.0087, 1),
        NoiseSpec(torque_std=1.0, encoder_counts=2**20),
        SUBSTEPS,
    )


BENCHES: dict[int, Callable[[], Bench]] = {2: two_axes, 3: three_axes}


@dataclass(frozen=True)
class Case:
    """Data sets of one bench: Coulomb friction over rms torque, with or without carrier, and how it is treated."""

    axes: int
    coulomb: float
    carrier: bool
    frictions: tuple[Friction, ...]
    realisations: int = 4
    periods: int = 2

    @property
    def name(self) -> str:
        """In a table, without the treatment."""
        return f"{self.axes} axes, {self.coulomb:4.2f}, {'carrier' if self.carrier else 'at rest'}"

    def __call__(self, number: int) -> FloatArray:
        """ln p - ln of the truth, and its stated deviation, by treatment (n_f, 2, n) of one data set."""
        rig, experiment, excitation = _prepared(self)
        plan = make_plan(excitation, experiment, rig.robot, number)
        records = rig.measure(plan, number)
        groups = [[one for one in records if one.configuration.name == name] for name in rig.postures]
        found = []
        for friction in self.frictions:
            spec = EstimatorSpec(friction=friction)
            taken = None if friction == "none" else find_friction(groups, spec, plan.lines)
            responses = [at_rest(estimate_without_friction(group, taken, spec, plan.lines)) for group in groups]
            found.append(fit_from_truth(responses, rig.robot, self.names))
        return np.array(found)

    @property
    def names(self) -> tuple[str, ...]:
        """The parameters that are compared: every k and d."""
        robot = _prepared(self)[0].robot
        return tuple(name for name, (value, _) in robot.parameters().items() if name[:2] in ("k_", "d_") and value > 0)


@lru_cache(maxsize=4)
def _prepared(case: Case) -> tuple[FastRig, ExperimentSpec, MultisineSpec]:
    bench = BENCHES[case.axes]()
    n_u = len(bench.robot.driven)
    rms = np.broadcast_to(np.asarray(bench.excitation.torque_rms, float), (n_u,))
    robot = with_coulomb(bench.robot, case.coulomb * rms)
    simulated = SimulatedSpec(
        carrier=bench.carrier if case.carrier else None, noise=bench.noise, substeps=bench.substeps
    )
    experiment = ExperimentSpec(bench.postures, case.realisations, case.periods, 1, simulated=simulated)
    plan: Plan = make_plan(bench.excitation, experiment, robot, 0)
    return FastRig.of(robot, simulated, plan), experiment, bench.excitation


def verified(case: Case) -> dict[str, float]:
    """The fast rig against the real one on a run: error of torque and angle over their RMS, encoders unlimited."""
    bench = BENCHES[case.axes]()
    rig, experiment, excitation = _prepared(case)
    quiet = replace(experiment.as_simulated(), noise=replace(bench.noise, encoder_counts=0))
    experiment = replace(experiment, simulated=quiet, realisations=1)
    plan = make_plan(excitation, experiment, rig.robot, 0)
    true = SimulatedRig(rig.robot, experiment, plan, 0).measure(plan.experiments[0])
    fast = FastRig.of(rig.robot, quiet, plan).measure(plan, 0)[0]
    parts = {"torque": (fast.u, true.u), "angle": (fast.y, true.y)}
    return {name: float(np.max(np.std(a - b, axis=0) / np.std(b, axis=0))) for name, (a, b) in parts.items()}


def covered(case: Case, sets: int, jobs: int) -> list[dict[str, Any]]:
    """The figures of a case from so many data sets, by treatment."""
    every = np.array(ordered(case, list(range(sets)), jobs))
    return [_figures(case, friction, *every[:, i].swapaxes(0, 1)) for i, friction in enumerate(case.frictions)]


def _figures(case: Case, friction: Friction, error: FloatArray, stated: FloatArray) -> dict[str, Any]:
    within = np.abs(error) < QUANTILE_95 * stated
    rms = np.sqrt(np.mean(stated**2, axis=0))
    sets = len(error)
    # Data sets are independent, parameters of one are not; few sets may all have the same share.
    chance = max(np.std(within.mean(axis=1), ddof=1), np.sqrt(0.95 * 0.05 / len(case.names))) / np.sqrt(sets)
    return {
        "case": f"{case.name}, {friction}",
        "sets": sets,
        "coverage": float(within.mean()),
        "chance": float(chance),
        "parameters": list(case.names),
        "coverage_by_parameter": within.mean(axis=0).round(4).tolist(),
        "bias_percent": (100 * error.mean(axis=0)).round(4).tolist(),
        "bias_over_stated": (error.mean(axis=0) / rms).round(3).tolist(),
        "scatter_over_stated": (np.std(error, axis=0, ddof=1) / rms).round(3).tolist(),
        "stated_percent": (100 * rms).round(4).tolist(),
    }


def table(rows: Sequence[dict[str, Any]]) -> str:
    """One line a case: coverage of all and of the worst parameter, bias and scatter over the stated deviation."""
    lines = [
        f"{'case (Coulomb over rms torque)':<38}{'sets':>5}{'covered, %':>16}{'by parameter, %':>18}"
        f"{'bias / stated':>18}{'scatter / stated':>18}{'stated, %':>16}"
    ]
    for row in rows:
        by = 100 * np.array(row["coverage_by_parameter"])
        bias, scatter, stated = (
            np.array(row[key]) for key in ("bias_over_stated", "scatter_over_stated", "stated_percent")
        )
        share = f"{100 * row['coverage']:.1f} +- {100 * row['chance']:.1f}"
        lines.append(
            f"{row['case']:<38}{row['sets']:>5}{share:>16}{_span(by):>18}{_span(bias):>18}{_span(scatter):>18}"
            f"{_span(stated):>16}"
        )
    return "\n".join(lines)


def _span(values: FloatArray) -> str:
    return f"{values.min():.3g} to {values.max():.3g}"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument(
        "--quick", action="store_true", help="two small data sets of two axes on a carrier, to see that it runs"
    )
    parser.add_argument("--sets", type=int, default=300)
    parser.add_argument("--axes", type=int, nargs="*", default=[2, 3], choices=sorted(BENCHES))
    parser.add_argument("--coulomb", type=float, nargs="*", default=list(LEVELS))
    parser.add_argument("--carrier", nargs="*", default=["yes", "no"], choices=["yes", "no"])
    parser.add_argument("--friction", nargs="*", default=["none", "auto"], choices=get_args(Friction))
    parser.add_argument("--realisations", type=int, default=4)
    parser.add_argument("--periods", type=int, default=2)
    parser.add_argument("--jobs", type=int, default=1)
    parser.add_argument("--verify", action="store_true", help="first compare a run with that of the simulated rig")
    given = parser.parse_args()
    sets, axes, levels, carriers, realisations = (
        given.sets,
        given.axes,
        given.coulomb,
        given.carrier,
        given.realisations,
    )
    if given.quick:
        sets, axes, levels, carriers, realisations = 2, [2], [0.16], ["yes"], 2
    rows = []
    for n in axes if given.verify else ():
        for level, carrier in ((0.0, False), (0.16, False), (0.16, True)):
            case = Case(n, level, carrier, ("none",))
            error = verified(case)
            print(f"{case.name}: {error['torque']:.1e} of the torque, {error['angle']:.1e} of the angle")
            assert max(error.values()) < MAX_ERROR
    for n in axes:
        for carrier in carriers:
            for level in levels:
                case = Case(n, level, carrier == "yes", tuple(given.friction), realisations, given.periods)
                for row in covered(case, sets, given.jobs):
                    rows.append(row)
                    print(table(rows[-1:]).split("\n")[1 if len(rows) > 1 else 0 :][-1], flush=True)
    print("\n" + table(rows))
    for row in rows:
        low, high = COVERED[0] - CHANCE * row["chance"], COVERED[1] + CHANCE * row["chance"]
        assert low <= row["coverage"] <= high, row
    print(json.dumps({"coverage": rows}))


if __name__ == "__main__":
    main()
