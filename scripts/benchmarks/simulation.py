"""Benchmark of closed-loop simulation with LuGre friction: speed relative to real time, and to MuJoCo.

    python scripts/benchmarks/simulation.py [--quick]

Robots: the three-axis robot of the demo, and the six-axis arm of fit.py with 18 coordinates. elastid simulates them
with a controller at 1 kHz, two Runge-Kutta steps per sample and LuGre friction at every motor, compiled (if there is a
C compiler) and in CasADi's virtual machine, with identical results. MuJoCo, if installed, simulates the same robots
without friction states in steps of 0.25 ms; its controller is a spring and a damper at every motor. All run in turn in
one process on one core. The medians of their CPU times are compared, after a check that accelerations agree. The last
line is JSON.
"""

import json
import time
from collections.abc import Callable
from dataclasses import replace
from importlib.resources import files
from importlib.util import find_spec
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import timing
import numpy as np
from fit import build_robot

from elastid.friction.robot_friction import frictions
from elastid.model.elastic import ElasticModel
from elastid.model.formulation import serial
from elastid.record import JointLoop
from elastid.robot import Friction, LuGre, Robot
from elastid.robot.simplified import with_joints
from elastid.simulation.closed_loop import MIN_CALLS, Commands, Trajectory, closed_loop, compiler, simulate
from elastid.simulation.contacts import contacts
from elastid.simulation.controller import tune
from elastid.simulation.drives import Drives
from elastid.simulation.dynamics import free_acceleration
from elastid.study import load
from elastid.targets.mujoco import mjcf

RATE_HZ, SUBSTEPS, MUJOCO_STEP = 1000.0, 2, 2.5e-4
# Goals for the compiled step of the six-axis arm.
MIN_TIMES_REAL_TIME, MAX_TIME_OVER_MUJOCO = 50.0, 3.0


def with_friction(robot: Robot) -> Robot:
    """Add LuGre friction to every motor (motor side): 0.3 to 0.45 Nm, bristle stiffness 70 Nm/rad."""
    law = Friction(0.3, 0.45, 1.5, lugre=LuGre(70.0, 0.02, 30.0))
    motors = {joint.name: replace(joint.motor, coulomb=0.0, friction=law) for joint in robot.driven if joint.motor}
    return with_joints(robot, lambda joint: replace(joint, motor=motors.get(joint.name)))


def elastid_run(model: ElasticModel, gains: JointLoop, torque: np.ndarray, samples: int) -> Callable[[], Trajectory]:
    """Prepare one run of the sampled loop.  samples: number that decides if the loop is compiled."""
    n_u, still = model.n_u, np.zeros_like(torque)
    limits, drives = np.array([[-9.0, 9.0]] * n_u), Drives(np.zeros(n_u), np.full(n_u, np.inf))
    loop = closed_loop(
        model, contacts(model, frictions(model.robot)), limits, RATE_HZ, SUBSTEPS, drives, samples=samples
    )
    return lambda: simulate(loop, gains, Commands(still, still, torque, still, still), np.zeros(model.n_q))


def in_mujoco(robot: Robot) -> Any:
    """Export the robot without friction states, and load it into MuJoCo."""
    import mujoco

    machine = mujoco.MjModel.from_xml_string(ElementTree.tostring(mjcf(robot), encoding="unicode"))
    machine.opt.timestep, machine.opt.integrator = MUJOCO_STEP, mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    machine.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONTACT
    return machine


def mujoco_run(robot: Robot, gains: JointLoop, torque: np.ndarray) -> Callable[[], object]:
    """Prepare a simulation of the same duration and robot by MuJoCo's rollout."""
    import mujoco
    from mujoco import rollout

    machine = in_mujoco(robot)
    for i, place in enumerate(robot.motor_locations):
        machine.jnt_stiffness[machine.joint(place).id] = gains.kp[i]
        machine.dof_damping[machine.joint(place).dofadr[0]] += gains.kd[i]
    data = mujoco.MjData(machine)
    start = np.zeros(mujoco.mj_stateSize(machine, mujoco.mjtState.mjSTATE_FULLPHYSICS.value))
    control = np.repeat(torque, round(1 / RATE_HZ / MUJOCO_STEP), axis=0)[None]
    return lambda: rollout.rollout(machine, data, start[None], control)


def same_accelerations(robot: Robot) -> float:
    """Return the largest relative difference between elastid's and MuJoCo's accelerations in random states."""
    import mujoco

    machine, model = in_mujoco(robot), serial(robot)
    data, names = mujoco.MjData(machine), [machine.joint(i).name for i in range(machine.njnt)]
    # MuJoCo's coordinates are T q: of an elastic gear the motor's angle and the twist of the gear.
    T = np.zeros((model.n_q, model.n_q))
    for row, name in enumerate(names):
        kind, joint = name.split(" ", 1)
        T[row, model.index(f"joint {joint}" if kind == "twist" else name)] = 1.0
        if kind == "twist":
            T[row, model.index(f"motor {joint}")] = -1.0
    free, random, worst = free_acceleration(model), np.random.default_rng(1), 0.0
    for _ in range(10):
        q, v, u = random.normal(0, 0.3, model.n_q), random.normal(0, 1, model.n_q), random.normal(0, 100, model.n_u)
        data.qpos[:], data.qvel[:], data.ctrl[:] = T @ q, T @ v, u
        mujoco.mj_forward(machine, data)
        ours = free(q, v, model.B @ u).full()[:, 0]
        worst = max(worst, float(np.abs(data.qacc - T @ ours).max() / np.abs(ours).max()))
    return worst


def bench(robot: Robot, seconds: float, rounds: int, with_mujoco: bool) -> dict[str, float]:
    """Measure the speed of both relative to real time, and the ratio of the speeds."""
    before = time.perf_counter()
    model = serial(with_friction(robot))
    built = time.perf_counter() - before
    gains = tune(model, np.zeros(model.n_q), 1.5, 0.8)
    torque = np.random.default_rng(1).normal(0.0, 30.0, (round(seconds * RATE_HZ), model.n_u))
    virtual, before = elastid_run(model, gains, torque, 0), time.perf_counter()
    machine = elastid_run(model, gains, torque, MIN_CALLS)
    loaded = time.perf_counter() - before
    if machine().q.tobytes() != virtual().q.tobytes():
        raise SystemExit("compiled and interpreted steps give different motions")
    runs: dict[str, Callable[[], object]] = {"elastid": machine, "virtual_machine": virtual}
    if with_mujoco:
        runs["mujoco"] = mujoco_run(robot, gains, torque)
    row = {f"{name}_times_real_time": seconds / cpu_s for name, cpu_s in timing.in_turn(runs, rounds).items()}
    row |= {"coordinates": model.n_q, "model_built_s": built, "loop_built_s": loaded}
    if with_mujoco:
        row["time_over_mujoco"] = row["mujoco_times_real_time"] / row["elastid_times_real_time"]
        row["acceleration_difference"] = same_accelerations(robot)
    return row


def check(six: dict[str, float]) -> None:
    """Assert the limits of the six-axis arm if a compiler and MuJoCo exist."""
    try:
        compiler()
    except OSError:
        return
    assert six["elastid_times_real_time"] > MIN_TIMES_REAL_TIME, six
    assert six.get("time_over_mujoco", 0.0) < MAX_TIME_OVER_MUJOCO, six


def main() -> None:
    """Print a row for each robot, then the JSON line."""
    quick = timing.options(__doc__, "one second once, to see that it runs").quick
    with_mujoco = find_spec("mujoco") is not None
    demo = load(Path(str(files("elastid") / "app/templates/serial/study.yml"))).study.robot
    seconds, rounds, results = *((1.0, 1) if quick else (5.0, 9)), dict[str, dict[str, float]]()
    for name, robot in {"demo": demo, "six_axes": build_robot()}.items():
        results[name] = bench(robot, seconds, rounds, with_mujoco)
        print(name, json.dumps(results[name]), flush=True)
    if not quick:
        check(results["six_axes"])
    print(json.dumps(results))


if __name__ == "__main__":
    main()
