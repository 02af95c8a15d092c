r"""Evidence about the channels of one joint: kinematics, Newton's law and energy, from arrays alone.

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


@dataclass(frozen=True)
class MotionRelation:
    """b = gain a^(order) of two motions, and the correlation of both sides, with the sign of the gain."""

    order: int
    gain: float
    correlation: float


@dataclass(frozen=True)
class TorqueRelation:
    """The torque that the motion of one joint explains.

    explained: share of the variance of the torque.  inertial, viscous, dissipated: correlations of the torque with its
    parts J a, f v, and f v + F_c sgn(v), negative where J, f and the power are.  inertia: J.  damping: f.
    """

    explained: float
    inertial: float
    viscous: float
    dissipated: float
    inertia: float
    damping: float

    @property
    def is_against_motion(self) -> bool:
        """True if the inertia is negative or power comes out of friction, and neither is contradicted by the other."""
        low, high = sorted((self.inertial, self.dissipated))
        return low < -0.3 and high < 0.1


NO_RELATION = TorqueRelation(0.0, 0.0, 0.0, 0.0, 0.0, 0.0)


def derivative(x: FloatArray, order: int, rate_hz: float, width: float) -> FloatArray:
    """The derivative (n - 12 width,) of a signal (n,), smoothed by a Gaussian of a width in samples."""
    omega = 2 * np.pi * np.fft.rfftfreq(len(x))
    gain = (1j * omega) ** order * np.exp(-((width * omega) ** 2) / 2)
    margin = int(6 * width)  # a jump from the last sample to the first has no effect beyond
    return np.asarray(np.fft.irfft(np.fft.rfft(x) * gain, len(x))[margin:-margin] * rate_hz**order)


def widths(n: int) -> tuple[float, ...]:
    """Those that a log of n samples is long enough for."""
    return tuple(width for width in WIDTHS if n > 20 * width)


def motion_relations(a: FloatArray, b: FloatArray, rate_hz: float) -> Iterator[MotionRelation]:
    """The relations of order -2 to 2 of two motions (n,), each at the width where both sides agree best."""
    for order in range(-2, 3):
        # Positions drift and keep offsets, so that velocities are compared.
        common = 1 if order == 0 else 0
        pairs = [
            (derivative(a, common + max(order, 0), rate_hz, s), derivative(b, common + max(-order, 0), rate_hz, s))
            for s in widths(len(a))
        ]
        results = [(_correlation(x, y), float(np.std(y)) / max(float(np.std(x)), 1e-300)) for x, y in pairs]
        rho, size = max(results, key=lambda result: abs(result[0]), default=(0.0, 0.0))
        yield MotionRelation(order, float(np.sign(rho)) * size, rho)


def torque_relation(u: FloatArray, y: FloatArray, order: int, rate_hz: float, turns: bool = True) -> TorqueRelation:
    """How the motion y (n,), a derivative of the position of the given order, explains the torque u (n,).

    turns: the joint turns, so that gravity may change with its angle.
    """
    results = (_relation_at(u, y, order, rate_hz, width, turns) for width in widths(len(u)))
    return max(results, key=lambda result: result.explained, default=NO_RELATION)


def _relation_at(u: FloatArray, y: FloatArray, order: int, rate_hz: float, width: float, turns: bool) -> TorqueRelation:
    torque = derivative(u, 0, rate_hz, width)
    # Of an acceleration the velocity is its integral, without the drift.
    motion, order, turns = (_integral(y, rate_hz), 1, False) if order == 2 else (y, order, turns)
    v, a = (derivative(motion, k - order, rate_hz, width) for k in (1, 2))
    quick = np.pad(derivative(motion, 1 - order, rate_hz, WIDTHS[0]), int(6 * WIDTHS[0]), mode="edge")
    s = derivative(np.sign(quick), 0, rate_hz, width)
    columns = [a, v, s, np.ones_like(a)]
    angle = {0: y, 1: _integral(y, rate_hz)}.get(order) if turns else None
    # From 0.3 rad on gravity changes as a cosine.
    if angle is not None and np.ptp(angle) > 0.3:
        q = derivative(angle, 0, rate_hz, width)
        columns += [np.cos(q), np.sin(q)]
    # Smoothed signals need no more samples than two a width.
    step = max(1, int(width / 2))
    A, torque = np.stack(columns, axis=1)[::step], torque[::step]
    size = np.maximum(np.linalg.norm(A, axis=0), 1e-300)
    scaled, *_ = np.linalg.lstsq(A / size, torque, rcond=1e-9)
    theta = scaled / size
    total = float(np.var(torque))
    if total == 0 or not np.isfinite(total):
        return NO_RELATION
    left = float(np.var(torque - A @ theta)) / total

    def part(*members: int) -> float:
        signal = A[:, members] @ theta[list(members)]
        sign = np.sign(np.mean(signal * A[:, members[0]])) or 1.0
        return float(sign * abs(np.mean((signal - signal.mean()) * (torque - torque.mean()))) / total)

    return TorqueRelation(1 - left, part(0), part(1), part(1, 2), float(theta[0]), float(theta[1]))


def travel(x: FloatArray) -> float:
    """The range of a signal (n,), single spikes left out."""
    return float(np.percentile(x, 99.9) - np.percentile(x, 0.1))


def nearest_factor(gain: float, factors: Sequence[tuple[float, str]], tolerance: float) -> str:
    """The text of the factor that a gain is within a tolerance (of its logarithm) of; empty where there is none."""
    nearest = ((abs(np.log(abs(gain) / factor)), text) for factor, text in factors if gain and factor)
    away, text = min(nearest, default=(np.inf, ""))
    return text if away <= tolerance else ""


def _integral(y: FloatArray, rate_hz: float) -> FloatArray:
    total = np.cumsum(y - y.mean()) / rate_hz
    t = np.arange(len(total))
    return np.asarray(total - np.polyval(np.polyfit(t, total, 1), t))


def _correlation(x: FloatArray, y: FloatArray) -> float:
    x, y = x - x.mean(), y - y.mean()
    size = float(np.linalg.norm(x) * np.linalg.norm(y))
    return float(x @ y) / size if size > 0 else 0.0
