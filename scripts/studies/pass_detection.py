"""Are the passes of a joint with cogging detected without a stated speed, and its levels right?

    python scripts/studies/pass_detection.py [--quick] [--draws 40] [--seed 0]

Outside rigs (tests/plants/cogged_joint.py, with equations and an integrator of their own): a joint with Coulomb
friction of about 115 Nm, a Stribeck effect, viscous friction, gravity and 15 Nm of cogging goes there and back over
0.8 rad at twelve speeds of 0.024 to 1.2 rad/s under a controller of 5 to 12 Hz, so that a slow one wanders by up to
30 % (std). The lowest speed is below a third of the Stribeck velocity, without which a law has no Stribeck effect;
where the joint sticks there, as notes on the passes say, the law is without it, and its F_c does not count. Half of
the draws log each speed in a file of its own, half all of them, in random order, in one. Every second draw has viscous
friction that differs by 12 % between the directions.

Of each draw: detected speeds of twelve, the largest error of a level, the error of the law's F_c, and if the
directions are judged rightly. In every draw all twelve must be detected, and levels and F_c be within 0.5 %; directions
must be right in 95 % of the draws.
The last line is one JSON object.

40 draws: twelve of twelve in each, and no pass more; levels within 0.45 %, 96 % of their 95 % intervals hold the truth;
F_c within 0.10 %, and all intervals hold it; directions right in all.
"""

# One BLAS thread must be asked for before NumPy is loaded.
# ruff: noqa: E402
import os

for variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ[variable] = "1"

import argparse
import json
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[2] / "tests"))
from plants.cogged_joint import RATIO, SPEEDS, CoggedJoint, logged, reference, simulated

from elastid.friction_study.laws import StaticLaw
from elastid.friction_study.levels import levels_of_records
from elastid.friction_study.pass_detection import detect_passes
from elastid.friction_study.spec import LawSpec
from elastid.record import FrictionRecord

STEP_S, TRAVEL, MAX_ERROR = 1e-3, 0.8, 5e-3


def drawn(draw: int, rng: np.random.Generator) -> CoggedJoint:
    """A joint."""
    coulomb = 114.6 * rng.uniform(0.95, 1.05)
    viscous = rng.uniform(40, 80)
    return CoggedJoint(
        rng.uniform(12, 30), coulomb, coulomb * rng.uniform(1.05, 1.2), rng.uniform(0.085, 0.15), viscous,
        0.12 * viscous if draw % 2 else 0.0, rng.uniform(20, 150), 15.0, int(rng.choice([2, 4, 6])),
        rng.uniform(0, 2 * np.pi), rng.uniform(5, 12),
    )  # fmt: skip


def logs_of(draws: int, seed: int) -> list[tuple[CoggedJoint, list[FrictionRecord]]]:
    """The joints and their logs."""
    rng = np.random.default_rng(seed)
    joints = [drawn(draw, rng) for draw in range(draws)]
    orders = [
        [tuple(rng.permutation(SPEEDS))] if draw % 4 < 2 else [(speed,) for speed in SPEEDS] for draw in range(draws)
    ]
    each = [(draw, speeds) for draw, order in enumerate(orders) for speeds in order]
    ends = []
    for many in (False, True):  # logs of one speed are shorter than those of all
        chosen = [i for i, (_, speeds) in enumerate(each) if (len(speeds) > 1) == many]
        references = [reference(each[i][1], TRAVEL, STEP_S) for i in chosen]
        if chosen:
            ends += list(zip(chosen, simulated([joints[each[i][0]] for i in chosen], references, STEP_S), strict=True))
    logs: list[list[FrictionRecord]] = [[] for _ in joints]
    for i, (angle, torque) in sorted(ends, key=lambda end: end[0]):
        own = logs[each[i][0]]
        own.append(replace(logged(angle, torque, STEP_S, i), name=f"log {len(own)}"))
    return list(zip(joints, logs, strict=True))


def assessed(joint: CoggedJoint, logs: list[FrictionRecord]) -> dict[str, float]:
    """The figures of a draw."""
    passes = [each for log in logs for each in detect_passes(log, True)]
    speeds = np.array([each.speed for each in passes])
    levels = levels_of_records(passes, True, 2 * np.pi / RATIO).levels
    error = levels.torque / np.array([
        joint.level(v, s) for v, s in zip(levels.speed, levels.direction, strict=True)
    ]) - 1  # fmt: skip
    law = StaticLaw.of(levels, LawSpec())
    low, high = law.intervals["coulomb"][2:]
    return {
        "detected": float(np.sum([np.any(np.abs(speeds / speed - 1) < 0.05) for speed in SPEEDS])),
        "passes": float(len(passes)),
        "level_error": float(np.abs(error).max()),
        "levels_covered": float(np.mean(np.abs(error) * levels.torque < 1.96 * levels.std)),
        "coulomb_error": law.values["coulomb"] / joint.coulomb - 1 if "stiction" in law.names else np.nan,
        "coulomb_covered": float(low <= joint.coulomb <= high) if "stiction" in law.names else np.nan,
        "directions": float(("directions.viscous" in law.names) == (joint.uneven > 0)),
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--quick", action="store_true", help="four draws")
    parser.add_argument("--draws", type=int, default=40)
    parser.add_argument("--seed", type=int, default=0)
    given = parser.parse_args()
    rows = [assessed(*draw) for draw in logs_of(4 if given.quick else given.draws, given.seed)]
    for row in rows:
        print("  ".join(f"{name} {value:.4g}" for name, value in row.items()))
    columns = {name: np.array([row[name] for row in rows]) for name in rows[0]}
    assert np.all(columns["detected"] == len(SPEEDS)), columns["detected"]
    for name in ("level_error", "coulomb_error"):
        assert np.nanmax(np.abs(columns[name])) < MAX_ERROR, (name, columns[name])
    assert columns["directions"].mean() >= 0.95, columns["directions"]
    print(json.dumps({
        "draws": len(rows),
        "detected_least": columns["detected"].min(),
        "passes_most": columns["passes"].max(),
        "level_error_largest": round(columns["level_error"].max(), 5),
        "levels_covered": round(columns["levels_covered"].mean(), 3),
        "coulomb_error_largest": round(np.nanmax(np.abs(columns["coulomb_error"])), 5),
        "coulomb_covered": round(np.nanmean(columns["coulomb_covered"]), 3),
        "without_stribeck": int(np.isnan(columns["coulomb_error"]).sum()),
        "directions_right": round(columns["directions"].mean(), 3),
    }))  # fmt: skip


if __name__ == "__main__":
    main()
