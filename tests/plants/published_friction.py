"""The friction of axis 2 of a large robot as it was published, and levels that follow it.

Law and numbers: Bittencourt, Wernholt, Sander-Tavallaey and Brogardh, LiTH-ISY-R-2948 (IROS 2010): torque in parts of
26 Nm and speed in rad/s on the motor's side, load in parts of its rating, 33 to 80 degC.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from elastid.base.arrays import FloatArray
from elastid.friction_study.constant_velocity import FrictionCurve

F_C, F_CL, F_SL, NU_L, D_S, D_ST = 3.11e-2, 2.34e-2, 0.126, 9.22, -2.50e-2, 1.60e-3
NU_0, NU_T, ALPHA, ALPHA_T, T_V, EXPONENT = -24.81, 0.98, 1.30e-4, 1.32e-3, 20.71, 1.36


def torque(v: FloatArray, load: FloatArray, T: FloatArray) -> FloatArray:
    """The level at v > 0."""
    by_load = F_SL * load * np.exp(-((v / NU_L) ** EXPONENT))
    by_temperature = (D_S + D_ST * T) * np.exp(-((v / (NU_0 + NU_T * T)) ** EXPONENT))
    return F_C + F_CL * load + by_load + by_temperature + (ALPHA + ALPHA_T * np.exp(-T / T_V)) * v


def published_levels(
    speeds: Sequence[float] = tuple(np.geomspace(1, 280, 12)),
    loads: Sequence[float] = (0.0, 0.3, 0.6, 1.0),
    temperatures: Sequence[float] = (33.0, 48.0, 62.0, 74.0, 80.0),
    noise: float = 0.02,
) -> FrictionCurve:
    """Exact levels at all combinations; std a share of the median level."""
    v, load, T = (grid.ravel() for grid in np.meshgrid(speeds, loads, temperatures, indexing="ij"))
    exact = torque(v, load, T)
    return FrictionCurve("motor 2", v, np.zeros_like(v), exact, np.full_like(v, noise * np.median(exact)), load, T)


def drawn(levels: FrictionCurve, seed: int) -> FrictionCurve:
    """The same with noise of its std."""
    return replace(
        levels, torque=levels.torque + levels.std * np.random.default_rng(seed).standard_normal(levels.n_conditions)
    )
