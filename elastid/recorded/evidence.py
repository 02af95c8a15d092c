r"""Evidence about the channels of one joint: kinematics, and the sign of torque and motion, from arrays alone.

Signals are compared as derivatives of one Gaussian, :math:`x^{(k)} = (G_s * x)^{(k)} = G_s^{(k)} * x`, at several
widths s, so that the same filter acts on all of them: two motions by :math:`b = g\, a^{(k)}`, a torque by

.. math:: u = J a + f v + F_c\,\mathrm{sgn}(v) + o + c_1 \cos q + c_2 \sin q, \qquad J > 0, \quad f v^2 + F_c |v| > 0.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from elastid.base.arrays import FloatArray

# Widths of the Gaussian in samples: the band up to a tenth of the rate, a fortieth, and a hundred-sixtieth.
WIDTHS = (2.0, 8.0, 32.0)
# Correlation of a derivative with the signal that is it.
MIN_CORRELATION = 0.98
# Share of a torque that the motion of its joint explains, at least.
MIN_EXPLAINED = 0.75


@dataclass(frozen=True)
class MotionRelation:
    """b = gain a^(order) of two motions, and the correlation of both sides, with the sign of the gain."""

    order: int
    gain: float
    correlation: float


@dataclass(frozen=True)
class TorqueRelation:
    """The torque that the motion of one joint explains.

    explained: share of the variance of the torque.  inertial, dissipated: correlations of the torque with its parts J a
    and f v + F_c sgn(v), negative where J and the power are.  inertia: J.
    """

    explained: float = 0.0
    inertial: float = 0.0
    dissipated: float = 0.0
    inertia: float = 0.0

    @property
    def is_joint(self) -> bool:
        """True if it explains most of the torque, by a positive inertia and friction that takes power."""
        return self.explained > MIN_EXPLAINED and self.inertial > 0 and self.dissipated > 0

    @property
    def is_against_motion(self) -> bool:
        """True if it does so with the inertia negative or power out of friction, neither contradicted by the other."""
        low, high = sorted((self.inertial, self.dissipated))
        return self.explained > MIN_EXPLAINED and low < -0.3 and high < 0.1


def derivative(x: FloatArray, order: int, rate_hz: float, width: float) -> FloatArray:
    """The derivative (n - 12 width,) of a signal (n,), smoothed by a Gaussian of a width in samples."""
    omega = 2 * np.pi * np.fft.rfftfreq(len(x))
    gain = (1j * omega) ** order * np.exp(-((width * omega) ** 2) / 2)
    margin = int(6 * width)  # a jump from the last sample to the first has no effect beyond
    return np.asarray(np.fft.irfft(np.fft.rfft(x) * gain, len(x))[margin:-margin] * rate_hz**order)


def motion_relations(a: FloatArray, b: FloatArray, rate_hz: float) -> Iterator[MotionRelation]:
    """The relations of order -2 to 2 of two motions (n,), each at the width where both sides agree best."""
    for order in range(-2, 3):
        # Positions drift and keep offsets, so that velocities are compared.
        common = 1 if order == 0 else 0
        pairs = [
            (derivative(a, common + max(order, 0), rate_hz, s), derivative(b, common + max(-order, 0), rate_hz, s))
            for s in WIDTHS
            if len(a) > 20 * s
        ]
        results = [(correlation(x, y), float(np.std(y)) / max(float(np.std(x)), 1e-300)) for x, y in pairs]
        rho, size = max(results, key=lambda result: abs(result[0]), default=(0.0, 0.0))
        yield MotionRelation(order, float(np.sign(rho)) * size, rho)


def velocities(signals: Sequence[FloatArray]) -> dict[int, tuple[int, float]]:
    """Of each of the signals (n,) that has its derivative among them: the place of that, and the rate in Hz by it."""
    if not signals or len(signals[0]) < 40 * WIDTHS[1]:
        return {}
    speed, smooth = (np.stack([derivative(x, k, 1.0, WIDTHS[1]) for x in signals]) for k in (1, 0))
    a, b = (x - x.mean(axis=1, keepdims=True) for x in (speed, smooth))
    of_a, of_b = (np.maximum(np.linalg.norm(x, axis=1), 1e-300) for x in (a, b))
    rho = (a @ b.T) / np.outer(of_a, of_b)
    best = {i: int(np.argmax(row)) for i, row in enumerate(rho) if row.max() > MIN_CORRELATION}
    # A velocity has an acceleration where it is logged too, and is no position then.
    return {i: (j, float(of_b[j] / of_a[i])) for i, j in best.items() if i not in best.values()}


def torque_relation(u: FloatArray, y: FloatArray, order: int, rate_hz: float, turns: bool = True) -> TorqueRelation:
    """How the motion y (n,), a derivative of the position of the given order, explains the torque u (n,).

    turns: the joint turns, so that gravity may change with its angle.
    """
    results = (_relation_at(u, y, order, rate_hz, width, turns) for width in WIDTHS if len(u) > 20 * width)
    return max(results, key=lambda result: result.explained, default=TorqueRelation())


def _relation_at(u: FloatArray, y: FloatArray, order: int, rate_hz: float, width: float, turns: bool) -> TorqueRelation:
    torque = derivative(u, 0, rate_hz, width)
    # Of an acceleration the velocity is its integral, without the drift.
    motion, order, turns = (_integral(y, rate_hz), 1, False) if order == 2 else (y, order, turns)
    v, a = (derivative(motion, k - order, rate_hz, width) for k in (1, 2))
    quick = np.pad(derivative(motion, 1 - order, rate_hz, WIDTHS[0]), int(6 * WIDTHS[0]), mode="edge")
    columns = [a, v, derivative(np.sign(quick), 0, rate_hz, width), np.ones_like(a)]
    angle = {0: y, 1: _integral(y, rate_hz)}.get(order) if turns else None
    # From 0.3 rad on gravity changes as a cosine.
    if angle is not None and np.ptp(angle) > 0.3:
        q = derivative(angle, 0, rate_hz, width)
        columns += [np.cos(q), np.sin(q)]
    # Smoothed signals need no more samples than two a width.
    step = max(1, int(width / 2))
    A, torque = np.stack(columns, axis=1)[::step], torque[::step]
    size = np.maximum(np.linalg.norm(A, axis=0), 1e-300)
    theta = np.linalg.lstsq(A / size, torque, rcond=1e-9)[0] / size
    total = float(np.var(torque))
    if total == 0 or not np.isfinite(total):
        return TorqueRelation()

    def part(*members: int) -> float:
        signal = A[:, members] @ theta[list(members)]
        sign = np.sign(np.mean(signal * A[:, members[0]])) or 1.0
        return float(sign * abs(np.mean((signal - signal.mean()) * (torque - torque.mean()))) / total)

    left = float(np.var(torque - A @ theta)) / total
    return TorqueRelation(1 - left, part(0), part(1, 2), float(theta[0]))


def travel(x: FloatArray) -> float:
    """The range of a signal (n,), single spikes left out."""
    return float(np.percentile(x, 99.9) - np.percentile(x, 0.1))


def _integral(y: FloatArray, rate_hz: float) -> FloatArray:
    total = np.cumsum(y - y.mean()) / rate_hz
    t = np.arange(len(total))
    return np.asarray(total - np.polyval(np.polyfit(t, total, 1), t))


def correlation(x: FloatArray, y: FloatArray) -> float:
    """That of two signals (n,); 0 where one is still."""
    x, y = x - x.mean(), y - y.mean()
    size = float(np.linalg.norm(x) * np.linalg.norm(y))
    return float(x @ y) / size if size > 0 else 0.0
