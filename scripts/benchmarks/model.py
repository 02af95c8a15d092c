"""CPU time of building a robot's symbolic model and linearising it; of its mass matrix, beside other libraries.

    python scripts/benchmarks/model.py [--quick] [ROBOT]

In one process: reading the robot's file, the model (`serial`), its linearisation with all derivatives to the
parameters (`Linearisation.of`), a LinearModel in one configuration. Then the mass matrix at many postures: CasADi's
functions beside pinocchio's crba, where that is installed. The last line is JSON.
"""

from __future__ import annotations

import argparse
import importlib.util
import json
import statistics
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np

from elastid import Robot, serial
from elastid.linear.linearise import Linearisation
from elastid.model.rigid_body import inverse_dynamics
from elastid.record import Configuration
from elastid.study import load_robot

ROBOT = Path(__file__).parents[2] / "configs" / "robots" / "kr300_twelve_springs.yml"
LIMIT_S = 1.0


def cpu_s(work: Callable[[], object], rounds: int) -> float:
    """Median CPU seconds of a piece of work."""
    times = []
    for _ in range(rounds):
        start = time.process_time()
        work()
        times.append(time.process_time() - start)
    return statistics.median(times)


def built(robot: Robot) -> Linearisation:
    """The symbolic model and its derivatives."""
    return Linearisation.of(serial(robot))


def rigid_in_pinocchio(robot: Robot) -> Callable[[np.ndarray], object] | None:
    """q -> M of the same tree in pinocchio; None where that is not installed."""
    if importlib.util.find_spec("pinocchio") is None:
        return None
    import pinocchio as pin

    model = pin.Model()
    seats = {"base": (0, pin.SE3.Identity())}
    for body in robot.all_bodies:
        parent, place = seats[body.parent]
        place = place * pin.SE3(body.placement.rotation, np.array(body.placement.xyz))
        for joint in body.joints:
            kind = pin.JointModelPrismaticUnaligned if joint.slides else pin.JointModelRevoluteUnaligned
            axis = np.array({"x": (1.0, 0, 0), "y": (0, 1.0, 0), "z": (0, 0, 1.0)}.get(str(joint.axis), joint.axis))
            parent, place = model.addJoint(parent, kind(axis), place, joint.name), pin.SE3.Identity()
        place = place * pin.SE3(body.mounting.rotation, np.array(body.mounting.xyz))
        inertia = pin.Inertia(body.mass, np.array(body.center_of_mass), body.inertia_matrix)
        model.appendBodyToJoint(parent, inertia, place)
        seats[body.name] = (parent, place)
    data = model.createData()
    return lambda q: pin.crba(model, data, q)


def main() -> None:
    """The table, then the JSON line."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--quick", action="store_true", help="one round, to see that it runs")
    parser.add_argument("robot", nargs="?", type=Path, default=ROBOT)
    arguments = parser.parse_args()
    rounds, postures = (1, 100) if arguments.quick else (7, 5000)
    robot = load_robot(arguments.robot)
    linearisation = built(robot)
    model = linearisation.model
    configuration = Configuration("zero", np.zeros(model.n_u))
    seconds = {
        "read": cpu_s(lambda: load_robot(arguments.robot), rounds),
        "build": cpu_s(lambda: built(robot), rounds),
        "linearise": cpu_s(lambda: linearisation.at(configuration, model.theta, model.inputs, "acceleration"), rounds),
    }
    q = np.random.default_rng(0).normal(size=(postures, model.n_q))
    mass = model.mass.map(postures)
    per_posture = cpu_s(lambda: mass(q.T, model.theta), rounds) / postures
    reference = rigid_in_pinocchio(robot)
    n_l = len(robot.joints)
    other = None if reference is None else cpu_s(lambda: [reference(each[:n_l]) for each in q], rounds) / postures
    total = seconds["build"] + seconds["linearise"]
    for what, value in seconds.items():
        print(f"{what:<10} {1e3 * value:8.1f} ms CPU")
    print(f"M(q)       {1e6 * per_posture:8.1f} us" + ("" if other is None else f", pinocchio {1e6 * other:.1f} us"))
    said = {
        "robot": robot.name,
        "coordinates": model.n_q,
        "seconds": seconds,
        "build_and_linearise_s": total,
        "limit_s": LIMIT_S,
        "passed": total <= LIMIT_S,
        "operations": {
            "mass": model.mass.n_instructions(),
            "force": model.force.n_instructions(),
            "inverse_dynamics": inverse_dynamics(robot).n_instructions(),
        },
        "mass_over_pinocchio": None if other is None else per_posture / other,
    }
    print(json.dumps(said))


if __name__ == "__main__":
    main()
