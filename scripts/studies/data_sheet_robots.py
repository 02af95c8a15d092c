"""Do intervals hold the truth of robots that are off their file as CAD and data sheets are?

    python scripts/studies/data_sheet_robots.py [--quick] [--draws 75] [--plants demo ...] [--seed 0]

Robots of two, three and six axes and a parallel linkage. Of each draw masses are off their file by 3 %, inertias by
10 % (one factor a body), motor inertias by 5 %, centres of mass by 10 mm, lengths by 1 mm, zeros of axes by 0.2 deg,
springs and dampers by 20 %; the responses have 1 % of noise. The fit takes the file with `tolerances: {}`. Counted is
the share of 95 % intervals of k and d that hold the truth, misfits, the worst error of a stiffness, and CPU time over
that of a fit of the same robot with an exact file, and of the same data with the file held. Over all draws 94 to 96 %
of the intervals must hold, and 99 % of the fits converge. The last line is one JSON object.

With this seed, of 75 draws each: demo 95.0 % of 1050 intervals hold, all converged, k within 0.12 %; linkage 94.3 % of
600, one misfit, k within 9.7 % (its weakest pair). Of 300 draws of two axes 95.5 % of 1200, all converged, k within
0.29 %. Six axes: 97.1 % of the 240 intervals of ten draws, all converged, k within 0.10 %. Median time over that of an
exact robot, ten draws: demo 1.7, linkage 1.9; two axes 1.3.
"""

# One BLAS thread must be asked for before NumPy is loaded.
# ruff: noqa: E402
import os

for variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ[variable] = "1"

import argparse
import json
import math
import time
from collections import Counter
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from study_plants import Plant, demo, of_study, responses, six_axes

from elastid.fit.identify import identify
from elastid.fit.result import Result
from elastid.linear.linearise import Linearisation
from elastid.model.formulation import formulate
from elastid.record import Configuration
from elastid.response import Covariance, Response
from elastid.robot import Body, Joint, Motor, Placement, Robot, Spring, Tolerances

TIMED = 10  # draws that are fitted with an exact file and with the file held, too
ZERO = math.radians(0.2)
RELATIVE = {"mass": 0.03, "motor_inertia": 0.05, "springs": 0.2}
INERTIA, CENTRE_M, LENGTH_M, NOISE = 0.1, 0.01, 1e-3, 0.01
TEMPLATES = Path(__file__).parents[2] / "elastid" / "app" / "templates"


def two_axes() -> Plant:
    """Two links in a vertical plane with elastic gears."""
    shoulder = Joint("1", "y", Spring(3e4, 60), Motor(2e-3, 60, 1e-2))
    elbow = Joint("2", "y", Spring(2e4, 40), Motor(1e-3, 60, 1e-2))
    upper = Body("upper", joints=(shoulder,), mass=40, center_of_mass=(0, 0, 0.4), inertia=(3.0, 3.0, 0.5))
    fore = Body("fore", "upper", Placement((0, 0, 0.8)), (elbow,), 25.0, (0.3, 0, 0), 1.0)
    postures = ((0.3, 0.2), (0.9, -0.6), (-0.5, 1.0))
    configurations = tuple(Configuration(f"c{i}", angles) for i, angles in enumerate(postures))
    return Plant("two-axis", Robot("arm", (upper, fore)), configurations, np.linspace(2, 50, 40), demo().spec)


def linkage() -> Plant:
    """The arm with a parallelogram of the template."""
    return of_study(TEMPLATES / "parallel-linkage" / "study.yml", "linkage", 60)


PLANTS = {"two-axis": two_axes, "demo": demo, "six-axis": six_axes, "linkage": linkage}


def drawn(robot: Robot, rng: np.random.Generator) -> Robot:
    """The robot as it is, off its file."""
    factors, numbers = {body.name: math.exp(INERTIA * rng.standard_normal()) for body in robot.all_bodies}, {}
    for name, (value, _) in robot.parameters(tuple(robot.geometry)).items():
        z, owner = rng.standard_normal(), name.split("_", 1)[1]
        if value == 0 and not name.startswith(("c_", "zero_")):
            continue
        if name.startswith("I_"):
            numbers[name] = value * factors.get(owner, factors.get(owner.rpartition("_")[0], 1.0))
        elif name.startswith("c_"):
            numbers[name] = value + CENTRE_M * z
        elif name.startswith("zero_"):
            numbers[name] = ZERO * z
        elif name in robot.geometry:
            numbers[name] = value + LENGTH_M * z
        elif name.startswith(("m_", "Jm_", "k_", "d_")):
            kind = {"m": "mass", "J": "motor_inertia"}.get(name[0], "springs")
            numbers[name] = value * math.exp(RELATIVE[kind] * z)
    return robot.with_parameters(numbers)


def measured(plant: Plant, robot: Robot, rng: np.random.Generator) -> list[Response]:
    """Responses of the robot with noise of known variance."""
    data = []
    for G in responses(plant, Linearisation.of(formulate(robot, plant.model)), robot):
        std = NOISE * np.abs(G.G)
        error = std * (rng.standard_normal(std.shape) + 1j * rng.standard_normal(std.shape)) / math.sqrt(2)
        data.append(replace(G, G=G.G + error, total=Covariance(std**2, np.inf)))
    return data


def fitted(plant: Plant, robot: Robot, data: list[Response]) -> tuple[Result, float]:
    """The fit and its CPU time in s."""
    begun = time.process_time()
    result = identify(data, robot, replace(plant.spec, seed=1), model=plant.model)
    return result, time.process_time() - begun


def judged(plant: Plant, draws: int, seed: int) -> Iterator[dict[str, Any]]:
    """Counts over the draws of one plant so far, after each of them."""
    inside, states, worst, times, drops = [], Counter[str](), 0.0, [], []
    fitted(plant, plant.robot, measured(plant, plant.robot, np.random.default_rng(seed)))  # builds the equations
    for draw in range(draws):
        rng = np.random.default_rng([seed, draw])
        robot = drawn(plant.robot, rng)
        data = measured(plant, robot, rng)
        result, cpu_s = fitted(plant, replace(plant.robot, tolerances=Tolerances()), data)
        if draw < TIMED:
            ideal = measured(plant, plant.robot, rng)
            times.append(cpu_s / fitted(plant, plant.robot, ideal)[1])
            drops.append(cpu_s / fitted(plant, plant.robot, data)[1])
        truth = {name: value for name, (value, _) in robot.parameters().items()}
        wanted = [p.name for p in result.parameters.asked if p.name.startswith(("k_", "d_"))]
        inside += [low <= truth[name] <= high for name in wanted for low, high in [result.interval(name)]]
        off = [abs(result.values[name] / truth[name] - 1) for name in wanted if name.startswith("k_")]
        worst = max([worst, *off]) if result.status == "converged" else worst
        states[result.status] += 1
        yield {
            "inside": round(float(np.mean(inside)), 4), "of": len(inside), "status": dict(states),
            "worst k %": round(100 * worst, 3), "time over exact robot": round(float(np.median(times)), 2),
            "time over held file": round(float(np.median(drops)), 2),
        }  # fmt: skip


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("--quick", action="store_true", help="one draw of two axes, without limits")
    parser.add_argument("--draws", type=int, default=75, help="of each plant")
    parser.add_argument("--plants", nargs="+", choices=PLANTS, default=list(PLANTS))
    parser.add_argument("--seed", type=int, default=0)
    given = parser.parse_args()
    names, draws = (["two-axis"], 1) if given.quick else (given.plants, given.draws)
    rows = {}
    for name in names:
        for draw, row in enumerate(judged(PLANTS[name](), draws, given.seed), start=1):
            rows[name] = row
            if draw % 10 == 0 or draw == draws:
                print(f"{name:10} {draw:4}", json.dumps(row), flush=True)
    if not given.quick:
        count = sum(each["of"] for each in rows.values())
        share = sum(each["inside"] * each["of"] for each in rows.values()) / count
        misfits = sum(n for each in rows.values() for status, n in each["status"].items() if status != "converged")
        assert abs(share - 0.95) <= max(0.01, 3 * math.sqrt(0.95 * 0.05 / count)), share  # of few draws their scatter
        assert misfits <= 0.01 * draws * len(rows), misfits
    print(json.dumps(rows))


if __name__ == "__main__":
    main()
