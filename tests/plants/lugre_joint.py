"""An elastic joint with LuGre friction at its motor, moved through presliding and sliding, and at rest."""

from __future__ import annotations

from functools import lru_cache

import casadi as ca
import numpy as np

from elastid.base.arrays import FloatArray
from elastid.friction_study.lugre_shooting import JointLog
from elastid.simulation.elastic_joint import FRICTION, ElasticJoint

JOINT = ElasticJoint(0.01, 0.02, 800.0, 0.3)
TRUTH = {
    "sigma_0": 300.0, "sigma_1": 0.5, "coulomb": 1.0, "stiction": 1.5, "stribeck_velocity": 8.0, "viscous": 5e-3,
}  # fmt: skip
RATE, COUNT, NOISE = 1000.0, 2 * np.pi / 2**16, 0.05


@lru_cache(maxsize=4)
def walk(n: int, substeps: int) -> ca.Function:
    """(x_0 (5,), numbers (6, n), torque (1, n)) -> states (5, n)."""
    return JOINT.step(RATE, substeps).mapaccum("walk", n)


def angle(torque: FloatArray, substeps: int = 8) -> FloatArray:
    """The motor's angle (n,) at the end of each sample, from rest; torque (n,) held from sample to sample."""
    p = np.tile(np.array([TRUTH[name] for name in FRICTION])[:, None], len(torque))
    return np.asarray(walk(len(torque), substeps)(np.zeros(5), p, torque[None]).full()[0])


def torque() -> FloatArray:
    """8 s: 1 Hz up to 0.95 of break-away with a dither of 5 to 60 Hz, then reversals up to 80 rad/s."""
    t = np.arange(8000) / RATE
    rng = np.random.default_rng(5)
    dither = sum(0.03 * np.sin(2 * np.pi * f * t + rng.uniform(0, 6)) for f in range(5, 61, 5))
    slow = np.where(t < 4, 0.95 * 1.5 * t / 4 * np.sin(2 * np.pi * t), 6.0 * np.sin(np.pi * (t - 4)))
    return np.asarray(slow + dither)


@lru_cache(maxsize=4)
def joint_log(seed: int) -> JointLog:
    """Torque as commanded, without its noise, and the angle in counts."""
    u = torque()
    noisy = u + NOISE * np.random.default_rng(seed).standard_normal(len(u))
    return JointLog("motor 1", RATE, u, np.round(angle(noisy) / COUNT) * COUNT, NOISE, COUNT / np.sqrt(12))


def wrong_start(seed: int) -> dict[str, float]:
    """Wrong by up to a factor of two."""
    rng = np.random.default_rng(100 + seed)
    values = {name: value * 2.0 ** rng.uniform(-1, 1) for name, value in TRUTH.items()}
    return values | {"stiction": max(values["stiction"], 1.2 * values["coulomb"])}
