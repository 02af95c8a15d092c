r"""Relations of two signals of one joint: derivatives of each other, and the torque that a motion needs.

Motions are compared as derivatives of one Gaussian, :math:`x^{(k)} = (G_s * x)^{(k)}`, at several widths s:
:math:`b = g\, a^{(k)}`. The sign of a torque is that with which

.. math:: u = J a + f v + F_c\,\mathrm{sgn}(v) + o + c_1 \cos q + c_2 \sin q, \qquad J > 0, \quad f v^2 + F_c |v| > 0.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import starmap

import numpy as np

from elastid.base.arrays import FloatArray
from elastid.robot import Joint

# Widths of the Gaussian in samples: the band up to a tenth of the rate, a fortieth, and a hundred-sixtieth.
GAUSSIAN_WIDTHS = (2.0, 8.0, 32.0)
# Minimum correlation of a derivative with the signal that is stated to be this derivative.
MIN_CORRELATION = 0.98
# Minimum fraction of a torque that the motion of its joint explains.
MIN_EXPLAINED = 0.75
# Minimum fraction that the acceleration alone explains, for a statement on the inertia.
MIN_BY_INERTIA = 0.2
# Ratio of accelerations above which another joint may drive this one; fraction that viscous friction must then explain.
MIN_MOVING, MIN_EXPLAINED_OF_MOVED = 0.1, 0.9
# |log| of the gain from sensor to motor torque that losses of a gear explain, and gain over its standard error.
MAX_LN_LOSS, MIN_GAIN_OVER_STD = 0.8, 5.0
# Travel below which a joint is held by its controller, in m where it slides and in rad.
REST_TRAVEL_M, REST_TRAVEL_RAD = 1e-3, 5e-3
MIN_UNEXPLAINED_VARIANCE = 0.03  # of the variance of an acceleration, that the other columns do not explain


@dataclass(frozen=True)
class MotionRelation:
    """Gain of b = gain a^(order), two motions, and the correlation of both sides, with the sign of the gain."""

    gain: float
    correlation: float


@dataclass(frozen=True)
class TorqueRelation:
    """Fraction of the variance of a torque that the motion of one joint explains, and the inertia J.

    inertia, largest_inertia: J in the band where it carries most of the torque, and its upper limit (three standard
    errors) over all bands where it carries enough, infinite without one, as where friction carries a slow motion.
    is_against_motion: J is negative, or friction gives power, and neither contradicts the other.  by_inertia: fraction
    of the torque's variance that only the acceleration explains.  is_shared: other joints moved as well.
    """

    explained: float = 0.0
    inertia: float = 0.0
    largest_inertia: float = np.inf
    is_against_motion: bool = False
    by_inertia: float = 0.0
    is_shared: bool = False

    def is_before_gear(self, joint: Joint, ratio: float, scale: float = 1.0) -> bool:
        """Return True if J / scale is below half the rotor's inertia as a link-side number, not as a motor-side one."""
        rotor = 0.0 if joint.motor is None else joint.motor.inertia * ratio**2 * scale
        return 2 * self.largest_inertia < rotor < 2 * self.inertia * ratio**2


def derivative(x: FloatArray, order: int, rate_hz: float, width: float) -> FloatArray:
    """Differentiate a signal (n,) to (n - 12 width,), smoothed by a Gaussian, width in samples; -1: integrate."""
    omega = 2 * np.pi * np.fft.rfftfreq(len(x))
    gain = (1j * np.append(1.0, omega[1:])) ** order * np.exp(-((width * omega) ** 2) / 2)
    gain[0] = order == 0  # an integral has no mean
    margin = int(6 * width)  # a jump from the last sample to the first has no effect beyond
    return np.fft.irfft(np.fft.rfft(x) * gain, len(x))[margin:-margin] * rate_hz**order


def motion_relations(a: FloatArray, b: FloatArray, rate_hz: float) -> dict[int, MotionRelation]:
    """Compute the relations of two motions (n,) by order, -2 to 2, each at the width where both sides agree best."""
    relations = {}
    for order in range(-2, 3):
        # Positions drift and keep offsets, so that velocities are compared.
        orders = (max(order, 0), max(-order, 0)) if order else (1, 1)
        pairs = ([derivative(x, k, rate_hz, s) for x, k in zip((a, b), orders, strict=True)] for s in _widths(a))
        relations[order] = max(starmap(_relation, pairs), key=lambda relation: abs(relation.correlation))
    return relations


def _widths(x: FloatArray) -> list[float]:
    return [width for width in GAUSSIAN_WIDTHS if len(x) > 20 * width]


def _relation(x: FloatArray, y: FloatArray) -> MotionRelation:
    """Compute the ratio of the deviations of two signals (n,), with the sign of their correlation, 0 if one rests."""
    sizes = float(np.std(x)), float(np.std(y))
    rho = float(np.mean((x - x.mean()) * (y - y.mean()))) / (sizes[0] * sizes[1]) if min(sizes) > 0 else 0.0
    return MotionRelation(float(np.sign(rho)) * sizes[1] / max(sizes[0], 1e-300), rho)


def torque_relation(
    u: FloatArray, y: FloatArray, order: int, rate_hz: float, turns: bool = True,
    others: Sequence[tuple[FloatArray, int]] = (),
) -> TorqueRelation:  # fmt: skip
    """Regress the torque u (n,) on the motion y (n,), a derivative of the position of the given order.

    turns: gravity may change with the angle.  others: motions of other joints and their orders.  If these move the
    joint, its controller adds -k_d v, which resembles friction of the wrong sign. The sign then follows from dry
    friction, or from viscous friction that explains nearly all of the torque.
    """
    bands = [width for width in _widths(u) if np.ptp(u) > 0]
    relations = [_relation_at(u, y, order, rate_hz, width, turns, others) for width in bands]
    if not relations:
        return TorqueRelation()
    limits = [r.largest_inertia for r in relations if r.explained > MIN_EXPLAINED and r.by_inertia > MIN_BY_INERTIA]
    inertia = max(relations, key=lambda relation: relation.by_inertia).inertia
    best = max(relations, key=lambda relation: relation.explained)
    return replace(best, inertia=inertia, largest_inertia=max(limits, default=np.inf))


def sensor_gain(u: FloatArray, sensor: FloatArray, y: FloatArray, order: int, rate_hz: float) -> tuple[float, float]:
    r"""Estimate the gain :math:`\beta` of a torque sensor behind the gear of a joint, and its standard error.

    .. math:: u = J_m a + f v + F_c\,\mathrm{sgn}(v) + o + \beta s

    Other joints may move: their torques are in the sensor's.  The error is infinite if the motion explains the sensor.
    """
    gains = [(0.0, np.inf)]
    for width in _widths(u):
        torque, s = (derivative(x, 0, rate_hz, width) for x in (u, sensor))
        v, a = (derivative(y, k - order, rate_hz, width) for k in (1, 2))
        A = np.stack([s, a, v, np.sign(v), np.ones_like(a)], axis=1)[:: int(width / 2)]
        theta, _, alone, std = _fit(A, torque[:: int(width / 2)], 0)
        gains += [(float(theta[0]), std)] if (np.var(alone) > MIN_UNEXPLAINED_VARIANCE * np.var(A[:, 0])) else []
    return min(gains, key=lambda pair: pair[1] / max(abs(pair[0]), 1e-300))


def _fit(A: FloatArray, x: FloatArray, column: int) -> tuple[FloatArray, FloatArray, FloatArray, float]:
    """Fit x (n,) by columns of A (n, c): coefficients, residual, a column without the others, its coefficient's std.

    The sandwich estimate has a window of ten samples, since neighbouring residuals are correlated (Newey and West,
    Econometrica 55, 1987).
    """
    size = np.maximum(np.linalg.norm(A, axis=0), 1e-300)
    theta = np.linalg.lstsq(A / size, x, rcond=1e-9)[0] / size
    residual, other_columns = x - A @ theta, np.delete(A, column, axis=1)
    alone = A[:, column] - other_columns @ np.linalg.lstsq(other_columns, A[:, column], rcond=1e-9)[0]
    score = alone * residual
    variance = score @ score + 2 * sum((1 - k / 10) * float(score[k:] @ score[:-k]) for k in range(1, 10))
    return theta, residual, alone, float(np.sqrt(max(variance, 0.0))) / max(float(alone @ alone), 1e-300)


def _relation_at(
    u: FloatArray, y: FloatArray, order: int, rate_hz: float, width: float, turns: bool,
    others: Sequence[tuple[FloatArray, int]]
) -> TorqueRelation:  # fmt: skip
    """Fit the relation in a band."""
    torque = derivative(u, 0, rate_hz, width)
    v, a = (derivative(y, k - order, rate_hz, width) for k in (1, 2))
    columns = [a, v, np.sign(v), np.ones_like(a)]
    q = derivative(y, -order, rate_hz, width) if turns and order < 2 else np.zeros(1)
    if np.ptp(q) > 0.3:  # from so many rad on gravity changes as a cosine
        columns += [np.cos(q), np.sin(q)]
    accelerations = [derivative(x, 2 - k, rate_hz, width) for x, k in others]
    moving = [x for x in accelerations if np.std(x) > MIN_MOVING * np.std(a)]
    A, torque = np.stack(columns, axis=1)[:: int(width / 2)], torque[:: int(width / 2)]
    theta, residual, alone, std = _fit(A, torque, 0)
    r_squared = 1 - float(np.var(residual) / np.var(torque))
    by_inertia = float(theta[0] ** 2 * np.var(alone) / np.var(torque))
    friction = slice(2 if moving and r_squared < MIN_EXPLAINED_OF_MOVED else 1, 3)
    terms = (A[:, 0] * theta[0], A[:, friction] @ theta[friction])
    signs = (np.sign(theta[0]), np.sign(np.mean(terms[1] * A[:, 1])))
    signed = [float(s * abs(np.cov(term, torque)[0, 1]) / np.var(torque)) for s, term in zip(signs, terms, strict=True)]
    is_against = r_squared > MIN_EXPLAINED and min(signed) < -0.3 and max(signed) < 0.1
    if is_against and moving:  # joints that move in proportion do not determine the sign
        B = np.stack([np.ones_like(torque), *(x[:: int(width / 2)] for x in moving)], axis=1)
        independent, remaining = (x - B @ np.linalg.lstsq(B, x, rcond=1e-9)[0] for x in (A[:, :2], torque))
        is_rich = np.var(independent[:, 0]) > MIN_UNEXPLAINED_VARIANCE * np.var(A[:, 0])
        slopes = np.linalg.lstsq(independent, remaining, rcond=1e-9)[0]
        is_against = bool(is_rich and min(slopes * np.std(independent, axis=0)) < 0)
    return TorqueRelation(
        r_squared, float(theta[0]), abs(float(theta[0])) + 3 * std, is_against, by_inertia, bool(moving)
    )


def range_without_spikes(x: FloatArray) -> float:
    """Return the range of a signal (n,) without single spikes."""
    return float(np.ptp(np.percentile(x, [0.1, 99.9])))
