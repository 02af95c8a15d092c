"""How often is a posture in which nothing is wrong refused, or a mode of it taken for another kind?

    python scripts/studies/false_alarms_of_postures.py [--quick] [--postures 300] [--seed 0]

Two thirds of the postures are of linkages with a rod, parallelograms and some with a crank 15 or 30 % shorter. Their
crank is within 1 rad of square to the lower arm: a parallelogram folds over at pi / 2. The others are of arms of two
axes with gravity, under which gears give by up to some 0.05 rad. Loops are closed, and the equilibrium under gravity is
found; a refusal is an alarm. Without gravity each spring, also a rod, makes one mode with the motors free and one with
the first motor locked, and each motor a free motion; another number of any is an alarm. The rates are compared with the
docstrings of the tables as those of false_alarms.py are. The last line is one JSON object.

300 postures: none is refused, and every mode is what it is. Before steps below 1e-6 rad were taken whole, 4 were: their
loops stayed open.
"""

# One BLAS thread must be asked for before NumPy is loaded.
# ruff: noqa: E402
import os

for variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ[variable] = "1"

import argparse
import json
from collections import Counter
from collections.abc import Mapping
from dataclasses import replace

import numpy as np
from false_alarms import compared

from elastid.base.arrays import FloatArray
from elastid.base.errors import ElastidError
from elastid.linear.equilibrium import equilibrium
from elastid.linear.linearise import linearise
from elastid.linear.modes import antiresonances, modes
from elastid.model.closed_posture import assembled
from elastid.model.formulation import formulate
from elastid.record import Configuration
from elastid.robot import Body, Joint, Motor, Placement, Robot, Spring
from tests.plants.linkages import LEVER, linkage

GRAVITY = (0.0, 0.0, -9.81)
# Postures of each robot.
EACH = 10
JUDGEMENTS: Mapping[str, Mapping[str, str]] = {
    "model.closed_posture.Limits": {"closure-refused": "*"},
    "linear.equilibrium.Limits": {"equilibrium-refused": "*"},
    "linear.modes.ModeLimits": {"other-modes": "rigid_rate", "other-zeros": "zero_ratio"},
}


def drawn(rng: np.random.Generator, has_loop: bool) -> Robot:
    """A linkage, or an arm of two axes in the vertical plane."""
    if has_loop:
        return linkage(crank=LEVER * float(rng.choice((1.0, 0.85, 0.7))), bends=bool(rng.integers(2)))
    bodies, mass = list[Body](), rng.uniform(20, 80, 2)
    for i, (name, parent) in enumerate((("upper", "base"), ("fore", "upper"))):
        # The torque of gravity at the joint is at most m g (l + l'), of which the spring gives 0.005 to 0.05 rad.
        spring = Spring(9.81 * mass.sum() * 1.5 / rng.uniform(0.005, 0.05), 10.0)
        joint = Joint(f"{i + 1}", "y", spring, Motor(1e-3, 100.0))
        place = Placement((0.0, 0.0, rng.uniform(0.4, 0.8))) if i else Placement()
        bodies.append(Body(name, parent, place, (joint,), mass[i], (0.0, 0.0, rng.uniform(0.1, 0.4)), (1.0, 1.0, 1.0)))
    return Robot("arm", tuple(bodies), gravity=GRAVITY)


def angles(rng: np.random.Generator, has_loop: bool) -> FloatArray:
    """Of the driven joints (2,)."""
    first = rng.uniform(-1.0, 1.0)
    return np.array([first, first + rng.uniform(-1.0, 1.0) if has_loop else rng.uniform(-2.5, 2.5)])


def other_modes(robot: Robot, posture: FloatArray) -> list[str]:
    """Judgements about modes without gravity that are wrong in a posture."""
    model = formulate(replace(robot, gravity=(0.0, 0.0, 0.0)))
    place = robot.motor_locations[0]
    linear = linearise(model, Configuration("c", posture), model.theta, (place,), "position")
    theta = linear.theta_ref
    springs = sum(joint.spring is not None for body in robot.bodies for joint in body.joints) + len(robot.loops)
    free, locked = modes(linear, theta), antiresonances(linear, theta, place, place)
    rubs = any(joint.motor is not None and joint.motor.viscous > 0 for joint in robot.driven)
    rigid = int(np.count_nonzero(free.real_poles == 0)), len(robot.driven) * (1 if rubs else 2)
    wrong = {"other-modes": len(free.freq_hz) != springs or rigid[0] != rigid[1]}
    return [code for code, is_wrong in (wrong | {"other-zeros": len(locked.freq_hz) != springs}).items() if is_wrong]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--quick", action="store_true")
    parser.add_argument("--postures", type=int, default=300)
    parser.add_argument("--seed", type=int, default=0)
    given = parser.parse_args()
    rng, totals = np.random.default_rng(given.seed), Counter[str]()
    count = EACH if given.quick else given.postures
    for robot_number in range(count // EACH):
        has_loop = robot_number % 3 > 0
        robot = drawn(rng, has_loop)
        model = formulate(robot)
        for _ in range(EACH):
            posture, stage = angles(rng, has_loop), "closure"
            try:
                assembled(robot, posture)
                stage = "equilibrium"
                equilibrium(model, model.theta, Configuration("c", posture))
                totals.update(other_modes(robot, posture))
            except ElastidError as error:
                totals[f"{stage}-refused"] += 1
                print(f"{stage}-refused: robot {robot_number}: {error}", flush=True)
    rows, unmeasured, wrong = compared(JUDGEMENTS, totals, lambda *_: count)
    own = [name for name in unmeasured if name.rpartition(".")[0] in JUDGEMENTS]
    print(json.dumps({"postures": count, "alarms": rows, "unmeasured": own, "wrong": wrong}))
    assert not wrong


if __name__ == "__main__":
    main()
