r"""Evidence about the channels of one joint: kinematics, and the sign of torque and motion, from arrays alone.

Signals are compared as derivatives of one Gaussian, :math:`x^{(k)} = (G_s * x)^{(k)} = G_s^{(k)} * x`, at several
widths s, so that the same filter acts on all of them: two motions by :math:`b = g\, a^{(k)}`, a torque by

.. math:: u = J a + f v + F_c\,\mathrm{sgn}(v) + o + c_1 \cos q + c_2 \sin q, \qquad J > 0, \quad f v^2 + F_c |v| > 0.

Torques of a log that contradict the study: measured twice, mirrored, or one channel under two names.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from elastid.base.arrays import FloatArray
from elastid.base.errors import Note
from elastid.experiment.specs.channels import ChannelSpec
from elastid.recorded.repair import blocks
from elastid.recorded.repair.time_stamps import CLOCK

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
    """Place of the derivative of each signal (n,) that has it among them, and the rate in Hz by it."""
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
    """Correlation of two signals (n,); 0 where one is still."""
    x, y = x - x.mean(), y - y.mean()
    size = float(np.linalg.norm(x) * np.linalg.norm(y))
    return float(x @ y) / size if size > 0 else 0.0


# Sine of the angle between two signals without their means, up to which they are one but for rounding.
MAX_DIFFERENCE = 1e-9


def drive_notes(channels: Sequence[ChannelSpec], signals: FloatArray, N: int | None, where: str) -> list[Note]:
    """Notes on each r of signals (n, c) and the u at its motor.  N: samples of the period, None without one."""
    u = {c.at: i for i, c in enumerate(channels) if c.role == "u"}
    drivers = [(c.at, signals[:, i], signals[:, u[c.at]]) for i, c in enumerate(channels) if c.role == "r"]
    return [Note(*code_and_text, where) for each in drivers if (code_and_text := _compared(*each, N))]


def _compared(place: str, r: FloatArray, u: FloatArray, N: int | None) -> tuple[str, str] | None:
    if np.ptp(r) > 0 and np.array_equal(r, u):
        return "records/same-signal", (
            f"u at {place} equals r to the last bit: the command was logged twice, so that feedback, the drive's "
            "limits and its delay are not in u; log the torque that acts, or leave the channel of role r out if "
            "nothing feeds back"
        )
    correlation = _at_once(r, u, N)
    if correlation > -CLOCK.min_correlation:
        return None
    return "records/torque", (
        f"u at {place} moves against r (correlation {correlation:.2f}): the motor is mirrored or one of the two "
        "channels has the other sign; give that channel sign: -1"
    )


def _at_once(r: FloatArray, u: FloatArray, N: int | None) -> float:
    """The correlation of r and u (n,), each line with the power that r has there.

    Feedback makes u largest where it turns the phase most.
    """
    if N is None:
        first, second = (np.concatenate([x - x.mean(), np.zeros(len(x))]) for x in (r, u))
    else:
        first, second = (blocks(x, N).mean(axis=0) for x in (r, u))
    power, U = np.abs(np.fft.rfft(first)[1:]) ** 2, np.fft.rfft(second)[1:]
    turned = np.fft.rfft(first)[1:].conj() * U
    cosine = np.divide(turned.real, np.abs(turned), out=np.zeros_like(power), where=turned != 0)
    return float(power @ cosine / max(power.sum(), 1e-300))


def same_signal_notes(channels: Sequence[ChannelSpec], signals: FloatArray, where: str) -> list[Note]:
    """A note on each pair of torques, or of motors' motions, of signals (n, c) that move as one up to a factor."""
    moving = signals - signals.mean(axis=0)
    size = np.linalg.norm(moving, axis=0)
    known = [i for i, c in enumerate(channels) if c.role in ("u", "y") and c.at.startswith("motor ") and size[i] > 0]
    notes = []
    for a, b in combinations(known, 2):
        if channels[a].role != channels[b].role:
            continue
        factor = moving[:, a] @ moving[:, b] / size[a] ** 2
        if np.linalg.norm(moving[:, b] - factor * moving[:, a]) <= MAX_DIFFERENCE * size[b]:
            text = (
                f"{channels[b].full_name} holds the samples of {channels[a].full_name}: one of the two is not the "
                "signal of its motor; check channel and column in the study, and the wiring of the logger"
            )
            notes.append(Note("records/same-signal", text, where))
    return notes
