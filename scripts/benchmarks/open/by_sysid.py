"""Entry of MuJoCo's `sysid`: motor angles under logged references, a sampled controller, dry friction.

    uv run --group oracles --with "mujoco[sysid]" python scripts/benchmarks/open/by_sysid.py FOLDER --robots stiff_gears

Free are springs, dampers, viscous and dry friction; the data sheet is assumed exact. One period of each log counts,
after the period that settles. A first fit gives the weight of each channel. It takes ten minutes and more a robot.
"""

import logging
from dataclasses import replace
from typing import Any

import mujoco
import numpy as np
from engine import PERIOD_S, Array, build, equilibrium
from entry import Task, enter
from mujoco import sysid
from robots import Joint, Robot

STEP_S = 5e-4


def replay(robot: Robot, losses: Array, experiment: dict[str, Any], posture: Array, r: Array) -> Array:
    """Simulate motor angles (samples, n), link side, for references r (samples, n)."""
    plant = build(robot)
    plant.model.opt.timestep = STEP_S
    plant.model.dof_frictionloss[plant.motors] = losses
    plant.model.dof_solref[plant.motors] = [0.002, 1.0]
    data, law, rate = mujoco.MjData(plant.model), experiment["controller"], experiment["rate_hz"]
    kp, kd = (np.array(law[key]) for key in ("position_gain", "velocity_gain"))
    is_torque = experiment["route"] == "torque"
    t = np.arange(len(r))[:, None] / rate
    carrier = experiment["carrier_rad"] * np.sin(2 * np.pi * t / PERIOD_S + np.arange(len(posture)))
    target = posture + carrier if is_torque else r
    hold, last_target, angles = equilibrium(plant, target[0], data), target[0], []
    for n in range(len(r)):
        q = data.qpos[plant.motors].copy()
        torque = hold + kp * (target[n] - q) - kd * (q - last_target) * rate + (r[n] if is_torque else 0.0)
        angles.append(q)
        data.qfrc_applied[plant.motors], last_target = torque, q
        mujoco.mj_step(plant.model, data, round(1 / rate / STEP_S))
    return np.array(angles)


def identify(task: Task) -> dict[str, Any] | None:
    """Fit factors of the data sheet's guesses to the angles of all logs."""
    experiment, sheet, N = task.experiment, task.sheet, task.period
    if experiment["route"] == "position" or sheet.rod:
        return None
    logging.disable(logging.CRITICAL)
    guesses, ratio = sheet.truth(), np.array([m.ratio for m in sheet.motors])
    driven = [j.name for j in sheet.joints if j.motor]
    names = [*guesses, *(f"f_{name}" for name in driven), *(f"F_{name}" for name in driven)]
    size = 0.05 * np.array(experiment["torque_rms"])  # of dry friction, at first
    weight = np.full(len(ratio), 1e5)
    logs = [
        (np.array(experiment["postures"][file["posture"]]), r[: 2 * N], q[: 2 * N] / ratio)
        for file, (r, q) in task.logs("rq")
    ]
    parameters = sysid.ParameterDict()
    for name in names:
        parameters.add(sysid.Parameter(name, 1.0, 0.01 if name[0] == "F" else 0.05, 20.0))

    def deviation(x: Array) -> Array:
        factors = dict(zip(names, x, strict=True))

        def joint(j: Joint) -> Joint:
            k, d, f = (factors.get(f"{c}_{j.name}", 1.0) for c in "kdf")
            return replace(j, k=j.k * k, d=j.d * d, motor=j.motor and replace(j.motor, f=j.motor.f * f))

        losses, robot = size * [factors[f"F_{name}"] for name in driven], sheet.with_joints(joint)
        return np.concatenate([(q - replay(robot, losses, experiment, p, r))[N:] * weight for p, r, q in logs]).ravel()

    def residuals(x: Array, _: Any) -> tuple[list[Array], None, None]:
        columns = [deviation(row) for row in np.atleast_2d(x.T)]
        return [columns[0] if x.ndim == 1 else np.stack(columns, axis=1)], None, None

    for _ in range(2):
        parameters, end = sysid.optimize(parameters, residuals, optimizer="mujoco", verbose=False, max_iters=20)
        last = deviation(parameters.as_vector())
        weight = weight / last.reshape(-1, len(ratio)).std(axis=0)
    _, reach = sysid.calculate_intervals([last], np.asarray(end.jac))
    x = parameters.as_vector()
    values = {name: (guesses[name] * x[i], guesses[name] * reach[i] / 1.96) for i, name in enumerate(guesses)}
    return {"parameters": values}


if __name__ == "__main__":
    enter("sysid", identify)
