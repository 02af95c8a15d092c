"""Taps on the tool of a six-axis robot with equations of its own, right and with faults."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

import elastid as ei
from elastid.fit.identify import fit_parameters
from elastid.fit.spec import FitSpec, ParameterSpec, PriorSpec, WeightSpec
from elastid.response import Covariance
from plants.outside_arm import Outside
from plants.weighed_arm import ANGLES, LEVER, nominal, outside, responses

LINES = np.linspace(5, 80, 60)
NOISE = 1e-2  # of the largest element of a row on a line
TAPPED = (0, 2)
SPRINGS = tuple(f"k_{i}" for i in range(1, 7))
WRIST = SPRINGS[3:]
Fault = Callable[[np.ndarray, np.ndarray], np.ndarray]  # of G (F, 3, 3) and s (F, 1, 1)


def taps(robot: Outside, rng: np.random.Generator, motors: str = "held", fault: Fault | None = None) -> list:
    """Accelerations of the hook by forces on it, along its own axes."""
    every = []
    for i in TAPPED:
        M, D, K, rest = robot.matrices(ANGLES[i])
        if motors == "held":
            M, D, K = (A[:6, :6] for A in (M, D, K))
        Jv, _, R = robot.jacobian(rest, 5, np.array(LEVER))
        J = np.zeros((3, len(M)))
        J[:, :6] = R.T @ Jv
        s = 2j * np.pi * LINES[:, None, None]
        G = s**2 * J @ np.linalg.inv(s**2 * M + s * D + K) @ J.T
        G = G if fault is None else fault(G, s)
        std = NOISE * np.broadcast_to(np.abs(G).max(axis=2, keepdims=True), G.shape)
        G = G + std * (rng.standard_normal(G.shape) + 1j * rng.standard_normal(G.shape)) / np.sqrt(2)
        forces, motions = (tuple(f"{kind} hook {axis}" for axis in "xyz") for kind in ("force", "frame"))
        where, noise = ei.Configuration(f"p{i} at the tool", ANGLES[i]), Covariance(std**2, 1e4)
        every.append(ei.Response(LINES, G, forces, motions, "acceleration", where, noise=noise, motors="held"))
    return every


FAULTS: dict[str, tuple[Fault | None, str]] = {
    "sign": (lambda G, s: -G, "opposite signs"),
    "hammer": (lambda G, s: 1.1 * G, "times as large: check unit"),
    "velocity": (lambda G, s: G / s, "holds the velocity"),
    "late": (lambda G, s: G * np.exp(-1e-3 * s), "no single cause"),
    "free": (None, "the motors were free"),
    "gear": (None, "no single cause"),
}


def one_fit(seed: int, fault: str = "", also_alone: bool = False) -> tuple[ei.Result, ei.Result | None, dict]:
    """With taps; without them, too, where that is asked for; the true springs."""
    rng = np.random.default_rng([seed, len(fault), 7])
    robot = nominal()
    numbers = {n: v * np.exp(0.1 * rng.standard_normal()) for n, (v, _) in robot.parameters().items() if n[0] in "kd"}
    true = outside(robot.with_parameters(numbers))
    measured = responses(true, rng)
    changed, _ = FAULTS.get(fault, (None, ""))
    tapped = outside(robot.with_parameters(numbers | {"k_3": 0.9 * numbers["k_3"]})) if fault == "gear" else true
    both = [*measured, *taps(tapped, rng, "free" if fault == "free" else "held", changed)]
    spec = FitSpec(
        parameters={"k_*": ParameterSpec(), "d_*": ParameterSpec(prior=PriorSpec(0.1))}, starts=1, seed=seed,
        weights=WeightSpec(floor=0.0),
    )  # fmt: skip
    alone = fit_parameters(measured, replace(robot, name="alone"), spec) if also_alone else None
    return fit_parameters(both, robot, spec), alone, numbers
