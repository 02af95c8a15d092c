r"""The noise of a response as the sum of noise on its outputs and of torques at its inputs that pass through it.

.. math:: C(k) = \sum_i a_i(\omega)\, e_i e_i^T + \sum_j b_j(\omega)\, g_j(k) g_j(k)^H, \qquad a_i, b_j \ge 0

g_j are the columns of the measured response: noise of the torque, friction and disturbances at a motor move all outputs
together, strongest at the resonances. a_i is a sum of white noise in position, velocity and acceleration; b_j of white
torque, torque that falls with frequency, and torque that grows with the excitation. These few levels are found over all
lines by maximum likelihood of Wishart matrices with a majorising step,

.. math:: \theta \leftarrow \theta\, \frac{\sum_k w_k\, \mathrm{tr}(Q C^{-1} S C^{-1})}
                                          {\sum_k w_k\, \mathrm{tr}(Q C^{-1})}, \qquad C = \sum \theta Q

so that they are known far better than the covariance S of a line. w_k <= 1 is small where a line is far noisier than
the others. (Zhou, Hu, Zhou and Lange, MM algorithms for variance components models, JCGS 28, 2019.)
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from elastid.base.arrays import BoolArray, ComplexArray, FloatArray
from elastid.record import MOTION_ORDER, Motion

# What is added to the diagonal, as a share of the mean variance of an output: keeps a model of exact data regular.
MIN_VARIANCE_SHARE = 1e-9


@dataclass(frozen=True)
class NoiseShapes:
    """The shapes along frequency of a response's noise: own (p, F) of its outputs, torque (q, F) of its inputs.

    G (F, n_y, n_u): how torque reaches the outputs.
    """

    own: FloatArray
    torque: FloatArray
    G: ComplexArray

    @classmethod
    def of(cls, freq_hz: FloatArray, G: ComplexArray, quantity: Motion, weakness: FloatArray | None) -> NoiseShapes:
        """weakness (F,): the inverse of the excitation's power, where it is known."""
        f = np.maximum(freq_hz, freq_hz[freq_hz > 0].min()) / freq_hz.max()
        own = np.stack([f ** (2 * MOTION_ORDER[quantity] - power) for power in (0.0, 2.0, 4.0)])
        torque = [np.ones_like(f), f**-2.0]
        if weakness is not None and np.all(weakness > 0):
            torque.append(weakness.mean() / weakness)
        return cls(own, np.stack(torque), G)

    def on(self, lines: BoolArray) -> NoiseShapes:
        """The same on some of the lines."""
        return NoiseShapes(self.own[:, lines], self.torque[:, lines], self.G[lines])


def noise_model(S: ComplexArray, shapes: NoiseShapes) -> ComplexArray:
    """C (F, n_y, n_y) that explains the sample covariances S (F, n_y, n_y) of a response's errors best.

    The levels of every other line are those of the lines between them, so that C knows nothing of a line's own S;
    fewer than 16 lines are not divided.
    """
    lines = np.arange(len(S))
    C = np.empty(S.shape, np.complex128)
    for half in (lines % 2 == 0, lines % 2 == 1):
        source = ~half if len(S) >= 16 else np.ones_like(half)
        C[half] = _levels(S[source], shapes.on(source))(shapes.on(half))
    return C


def _levels(S: ComplexArray, shapes: NoiseShapes) -> Callable[[NoiseShapes], ComplexArray]:
    """The model with the levels that explain S best, as a function of other lines' shapes."""
    F, n_y, n_u = shapes.G.shape
    level = np.einsum("faa->a", S).real / F
    if not np.all(level > 0):
        diagonal = np.diag(level + MIN_VARIANCE_SHARE * max(float(level.max()), 1e-300))
        return lambda other: np.broadcast_to(diagonal, (len(other.G), n_y, n_y)).astype(np.complex128)
    scale = np.sqrt(level)
    S, g = np.asarray(S / np.outer(scale, scale), np.complex128), shapes.G / scale[:, None]
    floor = MIN_VARIANCE_SHARE * np.eye(n_y)
    a = np.tile(1 / shapes.own.mean(axis=1)[:, None], n_y) / (2 * len(shapes.own))
    reached = np.einsum("qf,fij->qj", shapes.torque, np.abs(g) ** 2)
    b = np.divide(F * n_y / (2 * n_u * len(shapes.torque)), reached, out=np.zeros_like(reached), where=reached > 0)
    for _ in range(30):
        W = np.asarray(np.linalg.inv(_sum(a, b, shapes, g) + floor), np.complex128)
        WSW = np.asarray(W @ S @ W)
        t = np.einsum("fab,fba->f", W, S).real / n_y
        w = np.minimum(1.0, 1.0 / np.maximum(t, 1e-300))
        a = a * _ratio(_own_power(WSW, w, shapes), _own_power(W, w, shapes))
        b = b * _ratio(_torque_power(WSW, w, shapes, g), _torque_power(W, w, shapes, g))
    return lambda other: np.asarray(
        (_sum(a, b, other, other.G / scale[:, None]) + floor) * np.outer(scale, scale), np.complex128
    )


def _sum(a: FloatArray, b: FloatArray, shapes: NoiseShapes, g: ComplexArray) -> ComplexArray:
    """sum theta Q (F, n_y, n_y); a (p, n_y), b (q, n_u)."""
    C = (g * (shapes.torque.T @ b)[:, None, :]) @ np.swapaxes(g, -1, -2).conj()
    diagonal = np.arange(g.shape[1])
    C[:, diagonal, diagonal] += shapes.own.T @ a
    return np.asarray(C)


def _own_power(W: ComplexArray, w: FloatArray, shapes: NoiseShapes) -> FloatArray:
    """sum_k w_k tr(Q W) (p, n_y) of the noise on the outputs."""
    return np.asarray((shapes.own * w) @ np.einsum("faa->fa", W).real)


def _torque_power(W: ComplexArray, w: FloatArray, shapes: NoiseShapes, g: ComplexArray) -> FloatArray:
    """sum_k w_k tr(Q W) (q, n_u) of torques."""
    return np.asarray((shapes.torque * w) @ np.einsum("fij,fij->fj", g.conj(), W @ g).real)


def _ratio(measured: FloatArray, expected: FloatArray) -> FloatArray:
    return np.divide(np.maximum(measured, 0.0), expected, out=np.zeros_like(measured), where=expected > 0)
