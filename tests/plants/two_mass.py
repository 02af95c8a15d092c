"""A motor and a load on a spring in closed form, responses that carry given arrays, and circular noise."""

import math

import numpy as np

from elastid.record import Configuration
from elastid.response import Covariance, Response

FREQ_HZ = np.arange(11.0, 251.0)
BENCH = (FREQ_HZ, 8e-4, 6e-4, 95.0)  # with inertias of motor and load and the stiffness between them


def two_inertias(freq_hz, motor, load, stiffness, damping, friction=0.0):
    """Motor and load acceleration per motor torque (F, 2, 1) of two inertias on a spring, viscous friction of one."""
    s = 2j * np.pi * freq_hz
    spring = damping * s + stiffness
    det = (motor * s**2 + friction * s + spring) * (load * s**2 + spring) - spring**2
    return s[:, None, None] ** 2 * np.stack([load * s**2 + spring, spring], axis=1)[:, :, None] / det[:, None, None]


def response(G, std=None, dof=math.inf, freq_hz=FREQ_HZ):
    _, n_y, n_u = G.shape
    covariance = None if std is None else Covariance(np.broadcast_to(std, G.shape) ** 2, dof)
    names = [f"motor {i + 1}" for i in range(max(n_y, n_u))]
    where = Configuration("c1", np.zeros(n_u))
    return Response(freq_hz, G, tuple(names[:n_u]), tuple(names[:n_y]), "acceleration", where, total=covariance)


def circular(rng, shape):
    return (rng.standard_normal(shape) + 1j * rng.standard_normal(shape)) / math.sqrt(2)


def drawn(G, std, rng, dof=math.inf):
    """G (F, n_y, n_u) with noise of std, and its covariance as it was estimated from so many degrees of freedom."""
    noisy = G + std * circular(rng, std.shape)
    variance = std**2 * (rng.chisquare(2 * dof, std.shape) / (2 * dof) if math.isfinite(dof) else 1.0)
    return noisy, Covariance(variance, dof)
