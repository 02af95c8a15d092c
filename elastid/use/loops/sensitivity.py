r"""Sensitivity of joint loops that the arm couples: peaks, bandwidths, poles and limits of a controller on N plants.

.. math:: S(z) = [I + F(z) P(z)]^{-1}, \qquad M_S = \max_\omega \bar\sigma\bigl(J^{-1/2} S(e^{j \omega T_s}) J^{1/2}
          \bigr)

F: the controllers, filters and delay included, a diagonal matrix; P: from torques to the motors' angles. S is what
motors give of a torque that is injected: u = S r. J, the inertia of each axis, makes torques of all axes comparable,
and M_S the same at torques and angles for loops that are alike; no axis has a larger peak |S_ii| (Skogestad and
Postlethwaite, Multivariable Feedback Control, 2005, section 9.2): 6 dB leave each a gain margin of 6 dB and a
phase margin of 29 degrees. Bandwidth of an axis: lowest frequency at which the error of its motor behind a reference of
its position,

.. math:: E_{ii} = 1 - [P S]_{ii} F_{r,i}, \qquad F_r = k_p (1 + k_i \textstyle\sum)\, H

is -3 dB; the velocity of the reference is not fed forward.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from elastid.base.arrays import BoolArray, ComplexArray, FloatArray
from elastid.simulation.controller import Filters, Gains
from elastid.use.compliance import largest_gain
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
        return np.where(self.stable, 20 * np.log10(self.size.max(axis=1)), np.inf)

    @property
    def bandwidth_hz(self) -> FloatArray:
        """Bandwidth of each axis (N, n_u)."""
        return bandwidths(self.E, self.scene.freq_hz)

    @property
    def reached(self) -> float:
        """Mean over the axes of the logarithm of the bandwidth, the smallest of all plants."""
        return float(np.log(self.bandwidth_hz.min(axis=0)).mean())


def scaled(S: ComplexArray, inertia: FloatArray) -> ComplexArray:
    """J^-1/2 S J^1/2 of S (N, F, n_u, n_u) with inertia (N, n_u)."""
    root = np.sqrt(inertia)[:, None]
    return np.asarray(S / root[..., :, None] * root[..., None, :])


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
    N, _, n_u = plants.B.shape
    T, unit, none = 1 / plants.rate_hz, np.eye(n_u), np.zeros((n_u, n_u))
    kp, kd, ki = (np.broadcast_to(part, (N, n_u))[:, :, None] * unit for part in (gains.kp, gains.kd, gains.ki))
    # States y_(k-1) and T sum e of e_k = -(k_p + k_d / T) y_k + k_d / T y_(k-1).
    A, B = _blocks([[none, none], [kd, unit]]), _blocks([[unit], [-T * kp - kd]])
    C, D = _blocks([[kd / T, ki]]), -kp - kd / T
    if not np.any(ki):
        A, B, C = A[:, :n_u, :n_u], B[:, :n_u], C[:, :, :n_u]
    if filters is not None:
        Af, Bf, Cf, Df = filters.matrices
        A, B = _blocks([[A, np.zeros((A.shape[1], len(Af)))], [Bf @ C, Af]]), _blocks([[B], [Bf @ D]])
        C, D = _blocks([[Df @ C, Cf]]), Df @ D
    loop = [[plants.A + plants.B @ D @ plants.C, plants.B @ C], [B @ plants.C, A]]
    return np.asarray(np.linalg.eigvals(_blocks(loop)))


def _blocks(rows: list[list[FloatArray]]) -> FloatArray:
    """Block matrices (N, m, n) of blocks (N, ., .) or (., .)."""
    N = np.broadcast_shapes(*((1, *each.shape)[-3:-2] for row in rows for each in row))
    return np.asarray(np.block([[np.broadcast_to(each, (*N, *each.shape[-2:])) for each in row] for row in rows]))
