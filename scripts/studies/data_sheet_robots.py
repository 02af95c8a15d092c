"""Do intervals hold the truth of robots that are off their file as CAD and data sheets are?

    python scripts/studies/data_sheet_robots.py [--quick] [--draws 75] [--plants demo ...] [--seed 0]
        [--transmission 0.02 --postures 2 3 5]

Robots of two, three and six axes and a parallel linkage. Of each draw masses are off their file by 3 %, inertias by
10 % (one factor a body), motor inertias by 5 %, centres of mass by 10 mm, lengths by 1 mm, zeros of axes by 0.2 deg,
springs and dampers by 20 %; the responses have 1 % of noise. The fit takes the file with `tolerances: {}`. Counted is
the share of 95 % intervals of k and d that hold the truth, misfits, and the worst error of a stiffness. Over all draws
94 to 96 % of the intervals must hold, and 99 % of the fits converge. The last line is one JSON object.

With --transmission the gears of the two-axis robot have transmission errors of up to this part of the ratio, a number
for each draw, of random phase in each of some random postures: for each number of postures the share of intervals of k
that hold, and the median stated std over that of the errors.
"""

import json
import math
from collections import Counter
from dataclasses import replace
from typing import Any

import study_run
import numpy as np
from plants.measured_robots import responses_of
from study_plants import PLANTS, Plant, within_data_sheet

from elastid.fit.identify import identify
from elastid.response import Response
from elastid.robot import Robot, Tolerances
from elastid.robot.tolerances import RATIO

NOISE = 0.01


def measure(plant: Plant, robot: Robot, rng: np.random.Generator) -> list[Response]:
    """Return responses of the robot with noise of known covariance."""
    postures = {each.name: each.angles for each in plant.configurations}
    return responses_of(robot, postures, rng, plant.freq_hz, NOISE, 0.0, spec=plant.model)


def judge(plant: Plant, draws: int, seed: int) -> dict[str, Any]:
    """Count statuses, and intervals that contain the true value, over random robots of one plant."""
    inside, states, worst = [], Counter[str](), 0.0
    for draw in range(draws):
        rng = np.random.default_rng([seed, draw])
        robot = within_data_sheet(plant.robot, rng)
        data = measure(plant, robot, rng)
        file, spec = replace(plant.robot, tolerances=Tolerances()), replace(plant.spec, seed=1)
        result = identify(data, file, spec, model=plant.model)
        truth = {name: value for name, (value, _) in robot.parameters().items()}
        wanted = [p.name for p in result.parameters.of_interest if p.name.startswith(("k_", "d_"))]
        inside += [low <= truth[name] <= high for name in wanted for low, high in [result.interval(name)]]
        off = [abs(result.values[name] / truth[name] - 1) for name in wanted if name.startswith("k_")]
        worst = max([worst, *off]) if result.status == "converged" else worst
        states[result.status] += 1
    return {
        "inside": round(float(np.mean(inside)), 4), "of": len(inside), "status": dict(states),
        "worst k %": round(100 * worst, 3),
    }  # fmt: skip


def with_transmission_errors(amplitude: float, postures: int, draws: int, seed: int) -> dict[str, Any]:
    """Return the coverage of the intervals of k, and the stated std relative to the std of the errors, at low noise."""
    plant, errors, stds, inside = PLANTS["two-axis"](), list[float](), list[float](), list[bool]()
    for draw in range(draws):
        rng = np.random.default_rng([seed, draw, postures, int(1e6 * amplitude)])
        angles = rng.uniform((-1.2, 0.4), (0.8, 2.0), (postures, 2))
        robot, data = within_data_sheet(plant.robot, rng), list[Response]()
        e = rng.uniform(0, amplitude) * np.cos(rng.uniform(0, 2 * np.pi, (postures, 2)))
        for i, posture in enumerate(angles.tolist()):
            numbers = {f"{of}_{j + 1}": (1 + e[i, j]) ** 2 for of in ("Jm", "fm") for j in range(2)}
            off = robot.with_parameters({name: robot.parameters()[name][0] * by for name, by in numbers.items()})
            (G,) = responses_of(off, {f"c{i}": tuple(posture)}, rng, plant.freq_hz, 0.003, 0.0, spec=plant.model)
            # Read by the ratio of the file.
            data.append(replace(G, G=(1 + e[i])[:, None] * G.G * (1 + e[i]), ratio_std=np.full(2, RATIO)))
        result = identify(data, replace(plant.robot, tolerances=Tolerances()), plant.spec, model=plant.model)
        for name in ("k_1", "k_2"):
            truth = robot.parameters()[name][0]
            errors.append(result.values[name] / truth - 1)
            stds.append(result.std[name] / truth)
            inside.append(result.interval(name)[0] <= truth <= result.interval(name)[1])
    rms = math.sqrt(float(np.mean(np.square(errors))))
    ratio = round(float(np.median(stds)) / rms, 2)
    return {
        "inside": round(float(np.mean(inside)), 4),
        "of": len(inside),
        "error %": 100 * rms,
        "std over error": ratio,
    }


def main() -> None:
    sizes = {"draws": 75, "plants": tuple(PLANTS), "seed": 0, "transmission": float, "postures": [2, 3, 5]}
    args = study_run.options(__doc__, "one draw of two axes, without limits", **sizes)
    if args.transmission is not None:
        groups = {n: with_transmission_errors(args.transmission, n, args.draws, args.seed) for n in args.postures}
        print(json.dumps(groups))
        return
    names, draws = (["two-axis"], 1) if args.quick else (args.plants, args.draws)
    rows = {}
    for name in names:
        rows[name] = judge(PLANTS[name](), draws, args.seed)
        print(name, json.dumps(rows[name]), flush=True)
    if not args.quick:
        count = sum(each["of"] for each in rows.values())
        rate = sum(each["inside"] * each["of"] for each in rows.values()) / count
        misfits = sum(n for each in rows.values() for status, n in each["status"].items() if status != "converged")
        assert abs(rate - 0.95) <= max(0.01, 3 * math.sqrt(0.95 * 0.05 / count)), rate  # of few draws their scatter
        assert misfits <= 0.01 * draws * len(rows), misfits
    print(json.dumps(rows))


if __name__ == "__main__":
    main()
