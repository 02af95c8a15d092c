"""Entry of MuJoCo's `sysid`: motor angles under logged references, a sampled controller, dry friction.

    uv run --group oracles --with "mujoco[sysid]" python scripts/benchmarks/open/by_sysid.py FOLDER --robots stiff_gears

Free are springs, dampers, viscous and dry friction; the data sheet is assumed exact. One period of each log counts,
after the period that settles. A first fit gives the weight of each channel. It takes some minutes a robot.
"""

import logging
from typing import Any

import numpy as np
from engine import PERIOD_S, Array, Controller, Plant, closed_loop
from entry import Task, enter
from mujoco import sysid

STEP_S = 5e-4


def identify(task: Task) -> dict[str, Any] | None:
    """Fit factors of the data sheet's guesses to the angles of all logs."""
    experiment, sheet = task.experiment, task.sheet
    if experiment["route"] == "position" or sheet.rod:
        return None
    logging.disable(logging.CRITICAL)
    ratio = np.array([j.motor.ratio for j in sheet.gears])
    start = sheet.parameters | {f"f_{j.name}": j.motor.f for j in sheet.gears}
    start |= {f"F_{j.name}": 0.05 * torque for j, torque in zip(sheet.gears, experiment["torque_rms"], strict=True)}
    gains = (np.array(experiment["controller"][key]) for key in ("position_gain", "velocity_gain"))
    law, is_torque = Controller(*gains, experiment["rate_hz"]), experiment["route"] == "torque"
    N = round(PERIOD_S * law.hz)
    t = np.arange(2 * N)[:, None] / law.hz
    carrier = experiment["carrier_rad"] * np.sin(2 * np.pi * t / PERIOD_S + np.arange(len(ratio)))
    logs, zero = [], np.zeros_like(carrier)
    for file, (r, q) in task.logs("rq"):
        target = experiment["postures"][file["posture"]] + carrier
        logs.append((q[N : 2 * N] / ratio, (target, r[: 2 * N]) if is_torque else (r[: 2 * N], zero)))
    parameters, weight = sysid.ParameterDict(), np.full(len(ratio), 1e5)
    for name in start:
        parameters.add(sysid.Parameter(name, 1.0, 0.01 if name[0] == "F" else 0.05, 20.0))

    def deviation(x: Array) -> Array:
        values = dict(zip(start, [*start.values()] * x, strict=True))
        plant = Plant(sheet.with_parameters(values))
        plant.model.opt.timestep, plant.model.dof_solref[plant.motors] = STEP_S, [0.002, 1.0]
        plant.model.dof_frictionloss[plant.motors] = [values[f"F_{j.name}"] for j in sheet.gears]
        angles = [closed_loop(plant, law, *references, zero, 2.0**-60)[2][N:, plant.motors] for _, references in logs]
        return np.concatenate([(q - angle) * weight for (q, _), angle in zip(logs, angles, strict=True)]).ravel()

    def residuals(x: Array, _: Any) -> tuple[list[Array], None, None]:
        columns = [deviation(row) for row in np.atleast_2d(x.T)]
        return [columns[0] if x.ndim == 1 else np.stack(columns, axis=1)], None, None

    for _ in range(2):
        parameters, end = sysid.optimize(parameters, residuals, optimizer="mujoco", verbose=False, max_iters=20)
        last = deviation(parameters.as_vector())
        weight = weight / last.reshape(-1, len(ratio)).std(axis=0)
    _, reach = sysid.calculate_intervals([last], np.asarray(end.jac))
    ends = zip(start.items(), parameters.as_vector(), reach, strict=True)
    return {"parameters": {name: (value * x, value * interval / 1.96) for (name, value), x, interval in ends}}


if __name__ == "__main__":
    enter("sysid", identify)
