"""Time simulation in closed loop with LuGre friction: how many times faster than real time, beside MuJoCo.

    python scripts/bench_simulation.py [--quick]

The three-axis robot of the demo and a six-axis arm of 18 coordinates, sampled at 1 kHz with two Runge-Kutta steps a
sample, LuGre friction at every motor. MuJoCo, where it is installed, simulates the same robots without friction states,
its controller a spring and a damper at every motor, in steps of 0.25 ms; both run in turns in one process on one core,
and the median of their CPU times counts. Before that their accelerations are compared. The last line is JSON.
"""

from __future__ import annotations

import argparse
import json
import statistics
import time
from collections.abc import Callable
from dataclasses import replace
from importlib.resources import files
from pathlib import Path

import numpy as np

from elastid.friction.placed import frictions
from elastid.model.elastic import ElasticModel
from elastid.model.serial import serial
from elastid.robot import Body, Friction, Joint, LuGre, Motor, Placement, Robot, Spring
from elastid.simulation.closed_loop import Commands, closed_loop, simulate
from elastid.simulation.contacts import contacts
from elastid.simulation.controller import Gains, tuned
from elastid.simulation.drives import Drives
from elastid.simulation.dynamics import free_acceleration
from elastid.study import load

RATE_HZ, SUBSTEPS, MUJOCO_STEP = 1000.0, 2, 2.5e-4
# Links of the six-axis arm: where the next joint is, mass, centre of mass, inertia, stiffness of gear and bearing.
SIX = (
    ("z", "x", (0.0, 0.0, 0.4), 250.0, (0.05, 0.0, 0.2), (15.0, 14.0, 18.0), 1.2e6, 2.0e6, 8e-3),
    ("y", "x", (0.3, 0.0, 0.4), 120.0, (0.0, 0.0, 0.5), (12.0, 13.0, 3.0), 1.5e6, 1.6e6, 8e-3),
    ("y", "z", (0.0, 0.0, 1.0), 90.0, (0.6, 0.0, 0.1), (2.0, 14.0, 14.0), 5e5, 8e5, 6e-3),
    ("x", "y", (1.0, 0.0, 0.1), 30.0, (0.1, 0.0, 0.0), (0.5, 1.0, 1.0), 1e5, 3e5, 1e-3),
    ("y", "z", (0.3, 0.0, 0.0), 15.0, (0.05, 0.0, 0.0), (0.2, 0.2, 0.2), 8e4, 2e5, 1e-3),
    ("x", "y", (0.15, 0.0, 0.0), 20.0, (0.1, 0.0, 0.0), (0.3, 0.4, 0.4), 5e4, 1e5, 1e-3),
)


def six_axes() -> Robot:
    """An arm with an elastic gear and an elastic bearing at each of six joints, its numbers made up."""
    bodies, parent = [], "base"
    for i, (axis, across, xyz, mass, center, inertia, k_gear, k_bearing, rotor) in enumerate(SIX, start=1):
        driven = Joint(str(i), axis, Spring(k_gear, k_gear / 1500), Motor(rotor, 120.0, 2e-3))
        bearing = Joint(f"{i}b", across, Spring(k_bearing, k_bearing / 1500))
        bodies.append(Body(f"link{i}", parent, Placement(xyz), (driven, bearing), mass, center, inertia))
        parent = f"link{i}"
    return Robot("six axes", tuple(bodies))


def rough(robot: Robot) -> Robot:
    """The robot with LuGre friction at every motor: 0.3 to 0.45 Nm on the motor side, bristles of 70 Nm/rad."""
    law = Friction(0.3, 0.45, 1.5, lugre=LuGre(70.0, 0.02, 30.0))

    def changed(joint: Joint) -> Joint:
        return replace(joint, motor=replace(joint.motor, coulomb=0.0, friction=law)) if joint.motor else joint

    return replace(robot, bodies=tuple(replace(b, joints=tuple(map(changed, b.joints))) for b in robot.bodies))


def elastid_run(model: ElasticModel, gains: Gains, torque: np.ndarray) -> Callable[[], object]:
    """One run of the sampled loop, ready to go."""
    n_u, rest = model.n_u, np.zeros(model.n_q)
    limits, drives = np.array([[-9.0, 9.0]] * n_u), Drives(np.zeros(n_u), np.full(n_u, np.inf))
    loop = closed_loop(model, contacts(model, frictions(model.robot)), limits, RATE_HZ, SUBSTEPS, drives)
    still = np.zeros_like(torque)
    return lambda: simulate(loop, gains, Commands(still, still, torque, still, still), rest)


def mjcf(robot: Robot, gains: Gains | None) -> str:
    """The robot as MuJoCo reads it: motors as bodies of their own, gears as tendons, gains as springs and dampers."""
    by_parent: dict[str, list[Body]] = {}
    for body in robot.bodies:
        by_parent.setdefault(body.parent, []).append(body)

    def row(values: object) -> str:
        return " ".join(f"{value:.17g}" for value in np.ravel(values))  # type: ignore[call-overload]

    def body_xml(body: Body) -> str:
        joints = "".join(
            f'<joint name="joint {j.name}" axis="{row({"x": (1, 0, 0), "y": (0, 1, 0), "z": (0, 0, 1)}[j.axis])}"'
            f' damping="{j.viscous + (j.spring.damping if j.spring and not j.motor else 0)}"'
            f' stiffness="{j.spring.stiffness if j.spring and not j.motor else 0}"/>'
            for j in body.joints
        )
        tensor = body.inertia_matrix[[0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2]]
        inertial = f'<inertial mass="{body.mass}" pos="{row(body.center_of_mass)}" fullinertia="{row(tensor)}"/>'
        children = "".join(map(body_xml, by_parent.get(body.name, ())))
        assert body.placement.rpy == (0.0, 0.0, 0.0)
        return f'<body name="{body.name}" pos="{row(body.placement.xyz)}">{joints}{inertial}{children}</body>'

    kp, kd = (np.zeros(6), np.zeros(6)) if gains is None else (gains.kp, gains.kd)
    motors = "".join(
        f'<body pos="{9 + i} 0 0"><joint name="motor {j.name}" armature="{j.motor.ratio**2 * j.motor.inertia}"'
        f' damping="{j.motor.ratio**2 * j.motor.viscous + kd[i]}" stiffness="{kp[i]}"/>'
        '<inertial mass="1e-9" pos="0 0 0" diaginertia="1e-12 1e-12 1e-12"/></body>'
        for i, j in enumerate(robot.flexible)
        if j.motor
    )
    gears = "".join(
        f'<fixed stiffness="{j.spring.stiffness}" damping="{j.spring.damping}" springlength="0 0">'
        f'<joint joint="motor {j.name}" coef="1"/><joint joint="joint {j.name}" coef="-1"/></fixed>'
        for j in robot.flexible
        if j.spring
    )
    drives = "".join(f'<motor joint="motor {j.name}"/>' for j in robot.flexible)
    links = "".join(map(body_xml, by_parent["base"]))
    return (
        f'<mujoco><compiler angle="radian" boundmass="0" boundinertia="0"/>'
        f'<option timestep="{MUJOCO_STEP}" gravity="{row(robot.gravity)}" integrator="implicitfast">'
        f'<flag contact="disable"/></option><worldbody>{links}{motors}</worldbody>'
        f"<tendon>{gears}</tendon><actuator>{drives}</actuator></mujoco>"
    )


def mujoco_run(robot: Robot, gains: Gains, torque: np.ndarray) -> Callable[[], object]:
    """The same time of the same robot in MuJoCo, rolled out by its own loop."""
    import mujoco
    from mujoco import rollout

    machine = mujoco.MjModel.from_xml_string(mjcf(robot, gains))
    data = mujoco.MjData(machine)
    start = np.zeros(mujoco.mj_stateSize(machine, mujoco.mjtState.mjSTATE_FULLPHYSICS.value))
    control = np.repeat(torque, round(1 / RATE_HZ / MUJOCO_STEP), axis=0)[None]
    return lambda: rollout.rollout(machine, data, start[None], control)


def same_accelerations(robot: Robot) -> float:
    """Largest relative difference of elastid's and MuJoCo's accelerations at random states."""
    import mujoco

    machine = mujoco.MjModel.from_xml_string(mjcf(robot, None))
    data, model = mujoco.MjData(machine), serial(robot)
    places = [machine.joint(name).qposadr[0] for name in model.coordinates]
    free, random, worst = free_acceleration(model), np.random.default_rng(1), 0.0
    for _ in range(10):
        q, v, u = random.normal(0, 0.3, model.n_q), random.normal(0, 1, model.n_q), random.normal(0, 100, model.n_u)
        data.qpos[places], data.qvel[places], data.ctrl[:] = q, v, u
        mujoco.mj_forward(machine, data)
        ours = free(q, v, model.B @ u).full()[:, 0]
        worst = max(worst, float(np.abs(data.qacc[places] - ours).max() / np.abs(ours).max()))
    return worst


def cpu_s(run: Callable[[], object]) -> float:
    """CPU time of one run."""
    before = time.process_time()
    run()
    return time.process_time() - before


def benched(robot: Robot, seconds: float, rounds: int, with_mujoco: bool) -> dict[str, float]:
    """Times faster than real time of both, and their ratio."""
    before = time.perf_counter()
    model = serial(rough(robot))
    built = time.perf_counter() - before
    gains = tuned(model, np.zeros(model.n_q), 1.5, 0.8)
    torque = np.random.default_rng(1).normal(0.0, 30.0, (round(seconds * RATE_HZ), model.n_u))
    runs = {"elastid": elastid_run(model, gains, torque)}
    if with_mujoco:
        runs["mujoco"] = mujoco_run(robot, gains, torque)
    times: dict[str, list[float]] = {name: [] for name in runs}
    for _ in range(rounds):
        for name, run in runs.items():
            times[name].append(cpu_s(run))
    found = {f"{name}_times_real_time": seconds / statistics.median(values) for name, values in times.items()}
    found |= {"coordinates": model.n_q, "model_built_s": built}
    if with_mujoco:
        found["ratio_to_mujoco"] = found["elastid_times_real_time"] / found["mujoco_times_real_time"]
        found["acceleration_difference"] = same_accelerations(robot)
    return found


def main() -> None:
    """The table, then the JSON line."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--quick", action="store_true", help="one second once, to see that it runs")
    quick = parser.parse_args().quick
    try:
        import mujoco  # noqa: F401

        with_mujoco = True
    except ImportError:
        with_mujoco = False
    robots = {
        "demo": load(Path(str(files("elastid") / "templates/serial/study.yml"))).study.robot,
        "six_axes": six_axes(),
    }
    seconds, rounds = (1.0, 1) if quick else (5.0, 9)
    results = {name: benched(robot, seconds, rounds, with_mujoco) for name, robot in robots.items()}
    print(f"{'robot':10}{'coordinates':>12}{'elastid, LuGre':>16}{'MuJoCo':>10}{'ratio':>8}   times real time, CPU")
    for name, row in results.items():
        peer, ratio = row.get("mujoco_times_real_time"), row.get("ratio_to_mujoco")
        print(
            f"{name:10}{row['coordinates']:>12.0f}{row['elastid_times_real_time']:>16.1f}"
            + (f"{peer:>10.1f}{ratio:>8.2f}" if peer and ratio else f"{'-':>10}{'-':>8}")
        )
    print(json.dumps(results))


if __name__ == "__main__":
    main()
