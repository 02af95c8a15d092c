r"""Sensitivity of joint loops that the arm couples: peaks, bandwidths, poles and limits of a controller on N plants.

.. math:: S(z) = [I + F(z) P(z)]^{-1}, \qquad M_S = \max_\omega \bar\sigma\bigl(J^{-1/2} S(e^{j \omega T_s}) J^{1/2}
          \bigr), \qquad L_i = 1 / S_{ii} - 1

F: the controllers, filters and delay included, a diagonal matrix; P: from torques to the motors' angles. S is what
motors give of a torque that is injected: u = S r. J, the inertia of each axis, makes torques of all axes comparable,
and M_S the same at torques and angles for loops that are alike; no axis has a larger peak |S_ii| (Skogestad and
Postlethwaite, Multivariable Feedback Control, 2005, section 9.2). L_i is the loop of an axis while all others are
closed. Bandwidth of an axis: lowest frequency at which the error of its motor behind a reference of its position,

.. math:: E_{ii} = 1 - [P S]_{ii} F_{r,i}, \qquad F_r = k_p (1 + k_i \textstyle\sum)\, H

is -3 dB; the velocity of the reference is not fed forward.

Gain, phase and delay margins of single loops:

.. math:: A_m = \frac{1}{|L(\omega_{180})|}, \qquad \varphi_m = \arg(-L(\omega_c)), \qquad
          T_m = \frac{\varphi_m \bmod 2 \pi}{\omega_c}

omega_180: where L is real and negative, omega_c: where |L| = 1, both between lines by ln L, which is linear there. Of
several crossings the smallest margin counts.

Closed-loop records show S itself without a model: G_ur from an injected torque r, which has no noise, to the torques
u of all motors, by the estimator of the study's responses.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from elastid.base.arrays import BoolArray, ComplexArray, FloatArray, frozen_value, labelled
from elastid.frf.estimate import estimate
from elastid.frf.spec import EstimatorSpec
from elastid.record import Motion, Record
from elastid.simulation.controller import Filters, Gains
from elastid.use.loops.plants import Plants

LIMIT_DB = 6.0  # of M_S
THRESHOLD = 10 ** (-3 / 20)  # of |E_ii| at the bandwidth
STABLE = 1 - 1e-9  # |z| of a pole, which rounding of an integrator at 1 stays outside of


def controller_response(
    gains: Gains, filters: Filters | None, freq_hz: FloatArray, rate_hz: float
) -> tuple[ComplexArray, ComplexArray]:
    """F and F_r (..., n_u) at freq_hz (...)."""
    H = 1.0 if filters is None else filters.response(freq_hz, rate_hz)
    of_position = replace(gains, kd=np.zeros_like(gains.kd))
    return gains.response(freq_hz, rate_hz) * H, of_position.response(freq_hz, rate_hz) * H


def grid(plants: Plants, lines: int, per_mode: int) -> FloatArray:
    """freq_hz (N, F): logarithmic up to half the rate, and denser about each mode of a plant."""
    poles = np.linalg.eigvals(plants.A)
    with np.errstate(divide="ignore", invalid="ignore"):
        s = np.log(poles.astype(complex)) * plants.rate_hz
    freq_hz, zeta = np.abs(s) / (2 * np.pi), -s.real / np.maximum(np.abs(s), 1e-300)
    top = 0.499 * plants.rate_hz
    counts = (s.imag > 1e-6 * np.abs(s)) & (zeta < 0.5) & (zeta > 0) & (freq_hz < top)
    slowest = freq_hz[counts].min(initial=0.2 * top)
    base = np.geomspace(max(slowest / 300, top / 5000), top, lines)
    spread = np.sinh(np.linspace(-3, 3, per_mode)) / np.sinh(3)
    most = int(counts.sum(axis=1).max(initial=0))
    rows = []
    for own, z, keep in zip(freq_hz, zeta, counts, strict=True):
        centres, widths = own[keep], np.clip(8 * z[keep], 0.02, 0.4)
        near = (centres[:, None] * (1 + widths[:, None] * spread)).ravel()
        padding = np.geomspace(base[0], top, (most - len(centres)) * per_mode + 2)[1:-1] * (1 + 1e-6)
        rows.append(np.sort(np.clip(np.concatenate([base, near, padding]), base[0], top)))
    return np.array(rows)


@dataclass(frozen=True, eq=False)
class Scene:
    """N plants, the grid of each freq_hz (N, F), and P (N, F, n_u, n_u) on it."""

    plants: Plants
    freq_hz: FloatArray
    P: ComplexArray

    @classmethod
    def of(cls, plants: Plants, lines: int = 220, per_mode: int = 13) -> Scene:
        """Scene on a grid with so many lines."""
        freq_hz = grid(plants, lines, per_mode)
        return cls(plants, freq_hz, plants.response(freq_hz))

    def closed(self, gains: Gains, filters: Filters | None) -> Closed:
        """The loops of gains (n_u,) or (N, n_u)."""
        each = Gains(*(np.atleast_2d(part)[:, None] for part in (gains.kp, gains.kd, gains.ki)))
        F, F_r = controller_response(each, filters, self.freq_hz, self.plants.rate_hz)
        S = np.asarray(np.linalg.inv(np.eye(self.P.shape[-1]) + F[..., :, None] * self.P))
        return Closed(self, gains, filters, S, 1 - np.einsum("...ij,...ji->...i", self.P, S) * F_r)


@dataclass(frozen=True, eq=False)
class Closed:
    """Loops of N plants closed by a controller: S (N, F, n_u, n_u) and E_ii (N, F, n_u)."""

    scene: Scene
    gains: Gains
    filters: Filters | None
    S: ComplexArray
    E: ComplexArray

    @cached_property
    def size(self) -> FloatArray:
        """Largest singular value (N, F), torques of the axes compared by their inertias."""
        return largest_gain(scaled(self.S, self.scene.plants.inertia))

    @cached_property
    def stable(self) -> BoolArray:
        """True (N,) of loops that are stable."""
        poles = closed_loop_poles(self.scene.plants, self.gains, self.filters)
        return np.asarray(np.abs(poles).max(axis=1) < STABLE)

    @property
    def peaks_db(self) -> FloatArray:
        """M_S in dB (N,), infinite where a loop is unstable."""
        return np.where(self.stable, peaks_db(self.size, self.scene.freq_hz), np.inf)

    @property
    def bandwidth_hz(self) -> FloatArray:
        """Bandwidth of each axis (N, n_u)."""
        return bandwidths(self.E, self.scene.freq_hz)

    @property
    def reached(self) -> float:
        """Mean over the axes of the logarithm of the bandwidth, the smallest of all plants."""
        return float(np.log(self.bandwidth_hz.min(axis=0)).mean())

    @property
    def margins(self) -> Margins:
        """Margins of every loop while all others are closed."""
        return margins(1 / np.einsum("nfii->nif", self.S) - 1, self.scene.freq_hz[:, None])


def scaled(S: ComplexArray, inertia: FloatArray) -> ComplexArray:
    """J^-1/2 S J^1/2 of S (N, F, n_u, n_u) with inertia (N, n_u)."""
    root = np.sqrt(inertia)[:, None]
    return np.asarray(S / root[..., :, None] * root[..., None, :])


def largest_gain(S: ComplexArray) -> FloatArray:
    """Largest singular value (...) of matrices (..., n, n)."""
    squares = np.linalg.eigvalsh(np.swapaxes(S, -1, -2).conj() @ S)[..., -1]
    return np.asarray(np.sqrt(np.maximum(squares, 0.0)))


def peaks_db(size: FloatArray, freq_hz: FloatArray) -> FloatArray:
    """Largest of sizes (N, F) in dB, by the parabola of ln size over ln freq_hz through its line and its neighbours."""
    rows, line = np.arange(len(size)), np.clip(size.argmax(axis=1), 1, size.shape[1] - 2)
    y, x = (np.log(part[rows[:, None], line[:, None] + [-1, 0, 1]]) for part in (size, freq_hz))
    left, right = x[:, 0] - x[:, 1], x[:, 2] - x[:, 1]
    down, up = y[:, 0] - y[:, 1], y[:, 2] - y[:, 1]
    with np.errstate(divide="ignore", invalid="ignore"):
        curve = (up / right - down / left) / (right - left)
        slope = up / right - curve * right
        rise = np.where((curve < 0) & (down <= 0) & (up <= 0), -(slope**2) / (4 * curve), 0.0)
    return np.asarray(20 / np.log(10) * np.maximum(y[:, 1] + np.nan_to_num(rise), y.max(axis=1)))


def bandwidths(E: ComplexArray, freq_hz: FloatArray) -> FloatArray:
    """Hz (N, n_u) where |E| of E (N, F, n_u) first rises to -3 dB; the ends of the grid where it lies beyond."""
    size = np.abs(E)
    above = size >= THRESHOLD
    last = np.where(above.any(axis=1), above.argmax(axis=1), size.shape[1] - 1)
    first = np.maximum(last - 1, 0)
    rows = np.arange(len(E))[:, None]
    axes = np.arange(size.shape[2])[None]
    low, high = np.log(size[rows, first, axes]), np.log(size[rows, last, axes])
    share = np.clip((np.log(THRESHOLD) - low) / np.where(high > low, high - low, 1.0), 0.0, 1.0)
    ends = np.log(freq_hz)[rows, first], np.log(freq_hz)[rows, last]
    return np.asarray(np.exp(ends[0] + share * (ends[1] - ends[0])))


def closed_loop_poles(plants: Plants, gains: Gains, filters: Filters | None) -> ComplexArray:
    """z (N, n) of the loops; gains that differ from plant to plant are (N, n_u)."""
    N, m, n_u = plants.B.shape
    Af, Bf, Cf, Df = (np.zeros((0, 0)), np.zeros((0, n_u)), np.zeros((n_u, 0)), np.eye(n_u))
    if filters is not None:
        Af, Bf, Cf, Df = filters.matrices
    n_f, T = len(Af), 1 / plants.rate_hz
    kp, kd, ki = (np.broadcast_to(part, (N, n_u)) for part in (gains.kp, gains.kd, gains.ki))
    # e_k = -(k_p + k_d / T) y_k + k_d / T y_(k-1), the feedback e + k_i i, i its integral; states x, y_(k-1), i, x_f.
    of_x = -((kp + kd / T)[:, :, None] * plants.C)
    of_last = (kd / T)[:, :, None] * np.eye(n_u)
    E = np.concatenate([of_x, of_last, np.zeros((N, n_u, n_u + n_f))], axis=2)
    V = E.copy()
    V[:, :, m + n_u : m + 2 * n_u] += ki[:, :, None] * np.eye(n_u)
    U = Df @ V
    U[:, :, m + 2 * n_u :] += Cf
    A = np.zeros((N, m + 2 * n_u + n_f, m + 2 * n_u + n_f))
    A[:, :m, :m] = plants.A
    A[:, :m] += plants.B @ U
    A[:, m : m + n_u, :m] = plants.C
    A[:, m + n_u : m + 2 * n_u] = T * E
    A[:, m + n_u : m + 2 * n_u, m + n_u : m + 2 * n_u] += np.eye(n_u)
    A[:, m + 2 * n_u :] = Bf @ V
    A[:, m + 2 * n_u :, m + 2 * n_u :] += Af
    if not np.any(ki):  # an integral that nothing reads
        kept = np.r_[: m + n_u, m + 2 * n_u : len(A[0])]
        A = A[:, kept[:, None], kept]
    return np.asarray(np.linalg.eigvals(A))


@frozen_value
class Margins:
    """Margins of loops (Q, n_u): factor by which a gain may rise, phase in rad, delay in s.

    Infinite where no line has the crossing.
    """

    rise: FloatArray = labelled("factor by which the gain may rise", "", "postures axes")
    phase: FloatArray = labelled("phase margin", "rad", "postures axes")
    delay: FloatArray = labelled("delay margin", "s", "postures axes")


def margins(L: ComplexArray, freq_hz: FloatArray) -> Margins:
    """Margins of L (..., F) at freq_hz (..., F)."""
    ln, omega = np.log(np.abs(L)), 2 * np.pi * np.broadcast_to(freq_hz, L.shape)
    turn = np.angle(-L)
    step = np.diff(turn)
    share, crosses = _crossings(turn, np.abs(step) < np.pi)
    size = np.exp(-_between(ln, share))
    rise = np.where(crosses & (size > 1), size, np.inf).min(axis=-1)
    share, crosses = _crossings(ln, np.ones_like(step, bool))
    step = (step + np.pi) % (2 * np.pi) - np.pi
    left = turn[..., :-1] + share * step
    left = (left + np.pi) % (2 * np.pi) - np.pi
    phase = np.where(crosses, np.abs(left), np.inf).min(axis=-1)
    late = left % (2 * np.pi) / np.exp(_between(np.log(omega), share))
    return Margins(rise, phase, np.where(crosses, late, np.inf).min(axis=-1))


def _crossings(values: FloatArray, is_short: np.ndarray) -> tuple[FloatArray, np.ndarray]:
    """Share of the way (..., F - 1) to the next line at which values pass 0, and where they do."""
    first, second = values[..., :-1], values[..., 1:]
    crosses = (np.sign(first) != np.sign(second)) & is_short
    away = np.where(crosses, first - second, 1.0)
    return np.where(crosses, first / np.where(away == 0, 1.0, away), 0.0), crosses


def _between(values: FloatArray, share: FloatArray) -> FloatArray:
    return np.asarray(values[..., :-1] + share * np.diff(values))


@frozen_value
class MeasuredLoops:
    """Loops of n_u axes in one configuration, at F lines.

    peak_db: largest M_S over the lines.  at_edge: True if that is at an end of the band, so that the peak may lie
    beyond.  margins (1, n_u): infinite where no line has the crossing.
    """

    configuration: str
    axes: tuple[str, ...]
    freq_hz: FloatArray = labelled("frequency", "Hz")
    sensitivity_db: FloatArray = labelled("largest sensitivity", "dB", "freq_hz")
    peak_db: float = labelled("sensitivity peak", "dB")
    peak_std: float = labelled("its standard deviation", "dB")
    at_edge: bool
    margins: Margins


def measured_loops(records: Sequence[Record], estimator: EstimatorSpec, inertia: FloatArray) -> MeasuredLoops:
    """Loops in the records of a configuration; inertia (n_u,) as in M_S.  ValueError where they lack r."""
    if refused := refusal(records):
        raise ValueError(refused)
    first = records[0]
    spec = replace(estimator, quantity="position", method="auto", friction="none")
    response = estimate([_from_injected(record) for record in records], spec)
    S, known = response.G, response.uncertainty
    variance = np.zeros(S.shape) if known is None else known.variance
    D = scaled(S[None], inertia[None])[0]
    sizes, root = largest_gain(D), np.sqrt(inertia)
    line = int(sizes.argmax())
    left, _, right = np.linalg.svd(D[line])
    spread = np.abs(np.outer(left[:, 0], right[0])) ** 2 * variance[line] / root[:, None] ** 2 * root**2
    peak_std = 20 / np.log(10) * float(np.sqrt(spread.sum() / 2)) / float(sizes[line])
    nominal = margins(1 / np.einsum("fii->if", S) - 1, response.freq_hz)
    each = (np.atleast_2d(getattr(nominal, name)) for name in ("rise", "phase", "delay"))
    return MeasuredLoops(
        first.configuration.name, first.inputs, response.freq_hz, 20 * np.log10(sizes),
        float(20 * np.log10(sizes[line])), peak_std, line in (0, len(sizes) - 1), Margins(*each),
    )  # fmt: skip


def refusal(records: Sequence[Record]) -> str:
    """Why records do not show their loops; empty where they do."""
    for record in records:
        if record.r is None:
            return f"record {record.name} holds no injected torque (role r)"
        if record.input_units or not record.rate_is_known or not record.is_periodic:
            return f"record {record.name} has no torque in N*m, no rate or no period"
    return "" if len(records) >= len(records[0].inputs) else f"{len(records)} records do not separate all motors"


def _from_injected(record: Record) -> Record:
    """The record with r as input, and with the torques of the motors as outputs."""
    assert record.r is not None
    places = tuple(f"torque of {motor}" for motor in record.inputs)
    position: Motion = "position"
    return replace(
        record, outputs=places, quantities=(position,) * len(places), u=np.asarray(record.r), y=np.asarray(record.u),
        r=None, hold="band-limited", hold_samples=(), sliding=(), sampled=(),
    )  # fmt: skip
