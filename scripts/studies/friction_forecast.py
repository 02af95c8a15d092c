"""Does `design` predict the intervals of a robot with friction, left in the responses or taken out of them?

    python scripts/studies/friction_forecast.py [--quick] [--sets 6] [--robot demo two-axis six-axis]
                                                [--friction none coulomb]

The plan and the forecast of each robot, then data sets of that plan (`fast_rig`, new phases and noise) through
estimator and fit: the predicted over the fitted standard deviation of every k and d, and of what its estimates scatter
by where there are many data sets. The geometric mean over a robot must lie within 0.8 to 1.25. The last line is one
JSON object.

Found with 6 data sets, `none` and `coulomb`: 0.95 and 0.87 for the demo, 0.88 and 0.95 for two axes; for six axes 0.94
(0.82 to 1.00) with `none`, and 0.90 with `coulomb` (4 sets, 8 steps in a sample).
"""

# One BLAS thread must be asked for before NumPy is loaded.
# ruff: noqa: E402
import os

for variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ[variable] = "1"

import argparse
import json
import math
from collections.abc import Callable
from dataclasses import replace
from importlib.resources import files
from pathlib import Path
from typing import Any, get_args

import numpy as np
from design import six_axes as six_axes_of
from fast_rig import FastRig, at_rest
from friction_coverage import SUBSTEPS, two_axes
from study_plants import with_coulomb

from elastid.design.design import with_friction_damping
from elastid.design.forecast import Forecast, forecast
from elastid.design.problem import DesignProblem
from elastid.experiment.plan.plan import Plan, make_plan
from elastid.experiment.specs.experiment import ExperimentSpec
from elastid.experiment.specs.simulated import CarrierSpec, SimulatedSpec
from elastid.fit.identify import fit_parameters
from elastid.fit.spec import FitSpec, ParameterSpec, WeightSpec
from elastid.frf.spec import EstimatorSpec, Friction
from elastid.nonlinear.find import find_friction
from elastid.nonlinear.take_out import estimate_without_friction
from elastid.study import load

# Predicted over fitted standard deviation, geometric mean over the parameters of a robot.
WANTED = (0.8, 1.25)
FIT = FitSpec(
    log_first=False,
    starts=1,
    start_factor=1.0,
    profile=(),
    weights=WeightSpec(floor=0.0),
    parameters=dict.fromkeys(("k_*", "d_*", "fm_*"), ParameterSpec()),
)


def demo() -> DesignProblem:
    """The study of `elastid demo`, its robot as the file has it, friction and all."""
    study = load(Path(str(files("elastid") / "app" / "templates" / "serial" / "study.yml"))).study
    assert study.excitation is not None
    configurations = {name: angles for name, angles in study.experiment.configurations.items() if name != "low"}
    experiment = replace(study.experiment.with_truth({}), configurations=configurations)
    return DesignProblem(study.robot, study.excitation, experiment, FIT, "acceleration", 1)


def two_axis() -> DesignProblem:
    """The two axes of `friction_coverage` with Coulomb friction of 0.16 of the rms torque, under their carrier."""
    bench = two_axes()
    robot = with_coulomb(bench.robot, 0.16 * np.asarray(bench.excitation.torque_rms))
    simulated = SimulatedSpec(carrier=bench.carrier, noise=bench.noise, substeps=bench.substeps)
    experiment = ExperimentSpec(bench.postures, 4, 2, 1, simulated=simulated)
    return DesignProblem(robot, bench.excitation, experiment, FIT, "acceleration", 1)


def six_axis() -> DesignProblem:
    """The six axes of `design` in four configurations, with Coulomb friction of 0.1 of the rms torque."""
    problem = six_axes_of(2)
    rms = np.asarray(problem.excitation.torque_rms)
    postures = {"a": (0, 20, 20, 30, 40, 10), "b": (40, -20, 50, -60, 70, 80), "c": (-60, 50, -30, 100, -50, -40),
                "d": (20, 0, 60, 10, 90, -90)}  # fmt: skip
    simulated = replace(problem.simulated, carrier=CarrierSpec(math.radians(1), 1), substeps=8)
    experiment = replace(
        problem.experiment,
        configurations={name: tuple(np.radians(angles)) for name, angles in postures.items()},
        simulated=simulated,
        realisations=3,
    )
    excitation = replace(problem.excitation, flat="torque", period=4.0)
    robot = with_coulomb(problem.robot, 0.1 * rms)
    return DesignProblem(robot, excitation, experiment, FIT, "acceleration", 1)


ROBOTS: dict[str, Callable[[], DesignProblem]] = {"demo": demo, "two-axis": two_axis, "six-axis": six_axis}


def compared(name: str, problem: DesignProblem, friction: Friction, sets: int) -> dict[str, Any]:
    """Predicted, fitted and scattered standard deviations of ln p of one robot."""
    simulated = replace(problem.simulated, substeps=SUBSTEPS)
    problem = replace(problem, friction=friction, experiment=replace(problem.experiment, simulated=simulated))
    plan, expected = plan_and_forecast(problem)
    predicted = dict(zip(expected.parameters, expected.relative.tolist(), strict=True))
    rig = FastRig.of(problem.robot, problem.simulated, plan)
    fits = [fitted(problem, rig, friction, seed) for seed in range(sets)]
    names = [name for name in predicted if not name.startswith("fm_")]
    stated = np.array([[fit.std[name] / fit.values[name] for name in names] for fit in fits])
    values = np.array([[math.log(fit.values[name]) for name in names] for fit in fits])
    rms = np.sqrt(np.mean(stated**2, axis=0))
    ratio = np.array([predicted[name] for name in names]) / rms
    return {
        "robot": name,
        "friction": friction,
        "sets": sets,
        "parameters": names,
        "predicted_percent": [round(100 * predicted[name], 4) for name in names],
        "fitted_percent": (100 * rms).round(4).tolist(),
        "scatter_percent": (100 * values.std(axis=0, ddof=1)).round(4).tolist(),
        "ratio": ratio.round(3).tolist(),
        "mean_ratio": float(np.exp(np.mean(np.log(ratio)))),
    }


def plan_and_forecast(problem: DesignProblem) -> tuple[Plan, Forecast]:
    """The plan and its forecast as `design` makes them where no limit is in the way."""
    settled = with_friction_damping(problem)
    plan, x = problem.plan(problem.experiment), settled.parameters.x
    return plan, forecast([prospect.expected(c, x, M) for prospect, c, M in settled.fitted(plan)], x)


def fitted(problem: DesignProblem, rig: FastRig, friction: Friction, seed: int) -> Any:
    """The fit of one data set of a plan, with phases and noise of a seed."""
    plan = make_plan(problem.excitation, problem.experiment, problem.robot, seed)
    records = rig.measure(plan, seed)
    spec = EstimatorSpec(friction=friction)
    groups = [[one for one in records if one.configuration.name == c.name] for c in plan.configurations]
    taken = None if friction == "none" else find_friction(groups, spec, plan.lines)
    responses = [at_rest(estimate_without_friction(group, taken, spec, plan.lines)) for group in groups]
    return fit_parameters(responses, problem.robot, problem.fit)


def table(row: dict[str, Any]) -> str:
    """The parameters of one robot."""
    lines = [f"{row['robot']}, friction: {row['friction']}, {row['sets']} data sets",
             f"  {'':<8}{'predicted %':>13}{'fitted %':>11}{'scatter %':>11}{'predicted / fitted':>20}"]  # fmt: skip
    keys = ("parameters", "predicted_percent", "fitted_percent", "scatter_percent", "ratio")
    for name, predicted, stated, scatter, ratio in zip(*(row[key] for key in keys), strict=True):
        lines.append(f"  {name:<8}{predicted:>13.4g}{stated:>11.4g}{scatter:>11.4g}{ratio:>20.2f}")
    low, high = min(row["ratio"]), max(row["ratio"])
    verdict = "within" if WANTED[0] <= row["mean_ratio"] <= WANTED[1] else "NOT within"
    lines.append(
        f"  geometric mean of predicted / fitted {row['mean_ratio']:.2f} ({verdict} {WANTED[0]:g} to {WANTED[1]:g}), "
        f"from {low:.2f} to {high:.2f}"
    )
    return "\n".join(lines)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--quick", action="store_true", help="two axes alone, few data sets")
    parser.add_argument("--sets", type=int, default=6)
    parser.add_argument("--robot", nargs="*", default=list(ROBOTS), choices=list(ROBOTS))
    parser.add_argument("--friction", nargs="*", default=["none", "coulomb"], choices=get_args(Friction))
    given = parser.parse_args()
    robots, sets = (["two-axis"], 2) if given.quick else (given.robot, given.sets)
    rows = []
    for name in robots:
        for friction in given.friction:
            rows.append(compared(name, ROBOTS[name](), friction, sets))
            print(table(rows[-1]), flush=True)
    for row in rows:
        assert WANTED[0] <= row["mean_ratio"] <= WANTED[1], row
    print(json.dumps({"forecast": rows}))


if __name__ == "__main__":
    main()
