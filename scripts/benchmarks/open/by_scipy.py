"""Entry of a simple SciPy method: responses by FFT, MuJoCo's linearisation of the data sheet, weighted least squares.

    uv run --all-groups python scripts/benchmarks/open/by_scipy.py FOLDER [--seed 0] [--robots ...]

Friction is not compensated, and the data sheet is assumed exact. Records without torques at the motors are left out.
"""

from typing import Any

import mujoco
import numpy as np
from engine import LINES, PERIOD_S, Array, Plant, equilibrium
from entry import Task, enter
from scipy.ndimage import uniform_filter1d
from scipy.optimize import least_squares
from scipy.signal import cont2discrete


def responses(task: Task) -> tuple[Array, Array]:
    """Return the mean of Y / U over realisations (postures, F, n, n) and its variance, smoothed over lines."""
    postures, n, periods = len(task.experiment["postures"]), len(task.sheet.gears), task.experiment["periods"] + 1
    logs = np.array([signals for _, signals in task.logs("uq")])
    logs = logs.reshape(postures, -1, n, 2, periods, logs.shape[2] // periods, n)
    U, Y = np.einsum("cmesfi->scmfie", np.fft.rfft(logs[:, :, :, :, 1:].mean(axis=4), axis=4)[:, :, :, :, LINES])
    G = Y @ np.linalg.inv(U)
    return G.mean(axis=1), uniform_filter1d(G.var(axis=1, ddof=1) / G.shape[1], 9, axis=1, mode="nearest")


def linear(plant: Plant, posture: Array) -> Array:
    """Return M, D and K (3, n_v, n_v) of the data-sheet model in a posture by finite differences."""
    model, data = plant.model, mujoco.MjData(plant.model)
    equilibrium(plant, posture, data)
    K, D, M = matrices = np.empty((3, model.nv, model.nv))
    data.qacc[:], model.opt.integrator = 0.0, mujoco.mjtIntegrator.mjINT_EULER
    mujoco.mjd_inverseFD(model, data, 1e-6, False, K, D, M, None, None, None, None)
    return matrices[::-1].transpose(0, 2, 1)


def identify(task: Task) -> dict[str, Any] | None:
    """Fit springs, dampers and viscous friction."""
    experiment, sheet = task.experiment, task.sheet
    if "u" not in experiment["channels"] or sheet.rod:
        return None
    plant, start = Plant(sheet), sheet.parameters | {f"f_{j.name}": j.motor.f for j in sheet.gears}
    joints = [plant.model.joint(("m" if name[0] == "f" else "s") + name[2:]).dofadr[0] for name in start]
    ratio, T = np.array([[j.motor.ratio] for j in sheet.gears]), 1 / experiment["rate_hz"]
    s = 2j * np.pi * LINES[:, None, None] / PERIOD_S
    measured, variance = responses(task)
    systems = [linear(plant, np.array(q)) for q in experiment["postures"].values()]
    is_held, n, m = experiment["route"] == "torque", plant.model.nv, len(ratio)

    def modelled(system: Array, values: Array, delay_s: float) -> Array:
        M, D, K = system.copy()
        for i, name, change in zip(joints, start, values - [*start.values()], strict=True):
            (K if name[0] == "k" else D)[i, i] += change
        A = np.block([[np.zeros((n, n)), np.eye(n)], [-np.linalg.solve(M, K), -np.linalg.solve(M, D)]])
        B = np.vstack([np.zeros((n, m)), np.linalg.inv(M)[:, plant.motors]])
        if is_held:
            A, B, *_ = cont2discrete((A, B, np.eye(2 * n), np.zeros((2 * n, m))), T)
        X = np.linalg.solve((np.exp(s * T) if is_held else s) * np.eye(2 * n) - A, B[None])
        return np.asarray(X[:, plant.motors] * ratio * np.exp(s * delay_s))

    def residuals(x: Array) -> Array:
        G = [modelled(system, np.exp(x[:-1]), 0.0 if is_held else 1e-3 * x[-1]) for system in systems]
        flat = ((G - measured) * np.sqrt(2 / variance)).ravel()
        return np.concatenate([flat.real, flat.imag, x[-1:] if is_held else []])

    end = least_squares(residuals, [*np.log([*start.values()]), 0.0])
    scale = max(1.0, 2 * end.cost / (len(end.fun) - len(end.x)))
    std = np.sqrt(scale * np.diag(np.linalg.pinv(end.jac.T @ end.jac)))
    values = np.exp(end.x)
    return {"parameters": dict(zip(start, np.column_stack([values, values * std]).tolist(), strict=False))}


if __name__ == "__main__":
    enter("scipy", identify)
