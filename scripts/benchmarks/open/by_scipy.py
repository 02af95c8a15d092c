"""Entry of a simple SciPy method: responses by FFT, MuJoCo's linearisation of the data sheet, weighted least squares.

    uv run --all-groups python scripts/benchmarks/open/by_scipy.py FOLDER [--seed 0] [--robots ...]

Friction is not compensated, and the data sheet is assumed exact. Records without torques at the motors are left out.
"""

from typing import Any

import mujoco
import numpy as np
from engine import LINES, PERIOD_S, Array, Plant, build, equilibrium
from entry import Task, enter
from robots import mass_matrix
from scipy.ndimage import uniform_filter1d
from scipy.optimize import least_squares
from scipy.signal import cont2discrete


def responses(task: Task) -> dict[str, tuple[Array, Array]]:
    """Return, by posture, the mean of Y / U over realisations (F, n, n), and its variance, smoothed over lines."""
    pairs: dict[tuple[str, int], list[list[Array]]] = {}
    for file, signals in task.logs("uq"):
        means = (x[task.period :].reshape(-1, task.period, x.shape[1]).mean(axis=0) for x in signals)
        pairs.setdefault((file["posture"], file["realisation"]), []).append(
            [np.fft.rfft(x, axis=0)[LINES] for x in means]
        )
    every: dict[str, list[Array]] = {}
    for (posture, _), experiments in pairs.items():
        U, Y = (np.stack(part, axis=2) for part in zip(*experiments, strict=True))
        every.setdefault(posture, []).append(Y @ np.linalg.inv(U))
    variance = {name: np.var(G, axis=0, ddof=1) / len(G) for name, G in every.items()}
    return {
        name: (np.mean(G, axis=0), uniform_filter1d(variance[name], 9, axis=0, mode="nearest"))
        for name, G in every.items()
    }


def linear(plant: Plant, posture: Array) -> tuple[Array, Array, Array]:
    """Return M, D and K of the data-sheet model in a posture by finite differences."""
    model, data = plant.model, mujoco.MjData(plant.model)
    equilibrium(plant, posture, data)
    q, steps, zero = data.qpos.copy(), 1e-6 * np.eye(model.nv), np.zeros(model.nv)

    def force(q: Array, v: Array) -> Array:
        data.qpos[:], data.qvel[:] = q, v
        mujoco.mj_forward(model, data)
        return np.asarray(data.qfrc_bias - data.qfrc_passive)

    K = np.stack([(force(q + h, zero) - force(q - h, zero)) / 2e-6 for h in steps], axis=1)
    D = np.stack([(force(q, h) - force(q, -h)) / 2e-6 for h in steps], axis=1)
    force(q, zero)
    return mass_matrix(model, data), D, K


def identify(task: Task) -> dict[str, Any] | None:
    """Fit springs, dampers and viscous friction."""
    experiment, sheet = task.experiment, task.sheet
    if "u" not in experiment["channels"] or sheet.rod:
        return None
    plant, start = build(sheet), {**sheet.truth(), **{f"f_{i}": m.f for i, m in enumerate(sheet.motors)}}
    places = {f"{c}_{j.name}": int(plant.model.joint(f"s{j.name}").dofadr[0]) for j in sheet.joints for c in "kd"}
    places |= {f"f_{i}": int(m) for i, m in enumerate(plant.motors)}
    ratio, T = np.array([m.ratio for m in sheet.motors]), 1 / experiment["rate_hz"]
    z = np.exp(2j * np.pi * LINES * T / PERIOD_S)[:, None, None]
    postures = experiment["postures"]
    measured = responses(task)
    systems = {name: linear(plant, np.array(q)) for name, q in postures.items()}
    names, is_fixed = list(start), experiment["route"] == "torque"

    def modelled(system: tuple[Array, Array, Array], values: dict[str, float], delay: float) -> Array:
        M, D, K = (part.copy() for part in system)
        for name, value in values.items():
            (K if name[0] == "k" else D)[places[name], places[name]] += value - start[name]
        n, m = len(M), len(plant.motors)
        A = np.block([[np.zeros((n, n)), np.eye(n)], [-np.linalg.solve(M, K), -np.linalg.solve(M, D)]])
        B = np.vstack([np.zeros((n, m)), np.linalg.inv(M)[:, plant.motors]])
        if is_fixed:
            A, B, *_ = cont2discrete((A, B, np.eye(2 * n), np.zeros((2 * n, m))), T)
        p = z if is_fixed else np.log(z) / T
        X = np.linalg.solve(p * np.eye(2 * n) - A, np.broadcast_to(B, (len(z), 2 * n, m)))
        late = np.exp(np.log(z) / T * delay)
        return np.asarray(X[:, plant.motors] * ratio[:, None] * late)

    def residuals(x: Array) -> Array:
        values, delay = dict(zip(names, np.exp(x[:-1]), strict=True)), 0.0 if is_fixed else 1e-3 * x[-1]
        rows = [(modelled(systems[c], values, delay) - G) * np.sqrt(2 / V) for c, (G, V) in measured.items()]
        flat = np.concatenate([row.ravel() for row in rows])
        return np.concatenate([flat.real, flat.imag, x[-1:] if is_fixed else []])

    end = least_squares(residuals, [*np.log([start[name] for name in names]), 0.0])
    scale = max(1.0, 2 * end.cost / (len(end.fun) - len(end.x)))
    std = np.sqrt(scale * np.diag(np.linalg.pinv(end.jac.T @ end.jac)))
    values = {name: (float(np.exp(v)), float(np.exp(v) * s)) for name, v, s in zip(names, end.x, std, strict=False)}
    return {"parameters": values}


if __name__ == "__main__":
    enter("scipy", identify)
