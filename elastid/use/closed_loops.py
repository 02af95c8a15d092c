r"""Sensitivity of joint loops that the arm couples: peaks, bandwidths and stability of a controller on N plants.

.. math:: S(z) = [I + F(z) P(z)]^{-1}, \qquad M_S = \max_\omega \bar\sigma\bigl(J^{-1/2} S(e^{j \omega T_s}) J^{1/2}
          \bigr)

F: diagonal matrix of the controllers, with filters and delay; P: from torques to motor angles. S maps an injected
torque r to the motor torque u = S r. The inertias J of the axes make their torques comparable. M_S is an upper bound of
the peak |S_ii| of each axis (Skogestad and Postlethwaite, Multivariable Feedback Control, 2005, section 9.2): with 6 dB
every axis has a gain margin of 6 dB and a phase margin of 29 degrees. The bandwidth of an axis is the lowest frequency
at which the control error of its motor is -3 dB, without velocity feedforward:

.. math:: E_{ii} = 1 - [P S]_{ii} F_{r,i}, \qquad F_r = k_p (1 + k_i \textstyle\sum)\, H
"""

from dataclasses import dataclass, replace
from functools import cached_property, lru_cache

import numpy as np

from elastid.base.arrays import BoolArray, ComplexArray, FloatArray
from elastid.base.matrices import inverse
from elastid.record import JointLoop, unit_delay
from elastid.simulation.controller import Filters
from elastid.use.plants import Plants
from elastid.use.posture_values import largest_gain

LIMIT_DB = 6.0  # largest M_S
THRESHOLD = 10 ** (-3 / 20)  # |E_ii| at the bandwidth
SQUARINGS = 30  # of A: the norm of A^(2^30) is below 1/2 only if all |z| < 1 - 1e-9, approximately


def grid(plants: Plants, lines: int, per_mode: int) -> FloatArray:
    """Return freq_hz (N, F): logarithmic up to half the rate, with `per_mode` more lines near each mode of a plant."""
    with np.errstate(divide="ignore", invalid="ignore"):
        s = np.log(plants.eigensystem[0].astype(complex)) * plants.rate_hz
    freq_hz, zeta = np.abs(s) / (2 * np.pi), -s.real / np.maximum(np.abs(s), 1e-300)
    top = 0.499 * plants.rate_hz
    is_mode = (s.imag > 1e-6 * np.abs(s)) & (zeta < 0.5) & (zeta > 0) & (freq_hz < top)
    base = np.geomspace(max(freq_hz[is_mode].min(initial=0.2 * top) / 300, top / 5000), top, lines)
    spread = np.sinh(np.linspace(-3, 3, per_mode)) / np.sinh(3)
    n_modes = int(is_mode.sum(axis=1).max(initial=0))
    rows = []
    for modes_hz, z, mask in zip(freq_hz, zeta, is_mode, strict=True):
        centres, widths = modes_hz[mask], np.clip(8 * z[mask], 0.02, 0.4)
        mode_lines = (centres[:, None] * (1 + widths[:, None] * spread)).ravel()
        padding = np.geomspace(base[0], top, (n_modes - len(centres)) * per_mode + 2)[1:-1] * (1 + 1e-6)
        rows.append(np.sort(np.clip(np.concatenate([base, mode_lines, padding]), base[0], top)))
    return np.array(rows)


@dataclass(frozen=True, eq=False)
class Scene:
    """N plants, their frequency grids freq_hz (N, F), and their responses P (N, F, n_u, n_u)."""

    plants: Plants
    freq_hz: FloatArray
    P: ComplexArray

    @classmethod
    @lru_cache(maxsize=4)  # of the estimate, coarse and fine, and of draws
    def of(cls, plants: Plants, lines: int = 220, per_mode: int = 13) -> "Scene":
        """Compute the responses on a `grid`."""
        freq_hz = grid(plants, lines, per_mode)
        return cls(plants, freq_hz, plants.response(freq_hz))

    @cached_property
    def delay(self) -> ComplexArray:
        """Delay of a sample, 1 / z (N, F)."""
        return unit_delay(self.freq_hz, self.plants.rate_hz)


@dataclass(frozen=True, eq=False)
class Closed:
    """Loops of N plants closed by a controller with gains (n_u,) or (N, n_u)."""

    scene: Scene
    gains: JointLoop
    filters: Filters | None

    def _controller(self, has_damping: bool) -> ComplexArray:
        """Return F, or without damping F_r (N, F, n_u)."""
        delay = self.scene.delay
        stack = self.gains.gain_derivatives(lambda gain: np.atleast_2d(gain)[:, None])
        H = 1.0 if self.filters is None else self.filters.response(delay)
        return replace(stack, kd=has_damping * stack.kd).response(delay, self.scene.plants.rate_hz) * H

    @cached_property
    def F(self) -> ComplexArray:
        """Controllers (N, F, n_u)."""
        return self._controller(True)

    @cached_property
    def S(self) -> ComplexArray:
        """Sensitivity (N, F, n_u, n_u)."""
        P = self.scene.P
        return inverse((np.eye(P.shape[-1]) + self.F[..., :, None] * P).reshape(-1, *P.shape[2:])).reshape(P.shape)

    @cached_property
    def E(self) -> ComplexArray:
        """Control errors E_ii (N, F, n_u)."""
        return np.asarray(1 - np.einsum("...ij,...ji->...i", self.scene.P, self.S) * self._controller(False))

    @cached_property
    def size(self) -> FloatArray:
        """Largest singular value (N, F) of J^-1/2 S J^1/2."""
        return largest_gain(scaled(self.S, self.scene.plants.inertia))

    @cached_property
    def stable(self) -> BoolArray:
        """Flags (N,) of stable loops: powers of A converge to 0. (Eigenvalues take four times as long.)"""
        A = closed_loop_matrices(self.scene.plants, self.gains, self.filters)
        with np.errstate(over="ignore", invalid="ignore"):
            for _ in range(SQUARINGS):
                A = A @ A
                norm = np.linalg.norm(A, np.inf, (1, 2))
                if not np.any(norm >= 0.5):  # the norms of unstable loops become NaN
                    break
        return np.asarray(norm < 0.5)

    @property
    def peaks_db(self) -> FloatArray:
        """M_S (N,) in dB; infinite for an unstable loop."""
        return np.where(self.stable, 20 * np.log10(self.size.max(axis=1)), np.inf)

    @property
    def bandwidth_hz(self) -> FloatArray:
        """Bandwidth (N, n_u) of each axis."""
        return bandwidths(self.E, self.scene.freq_hz)


def scaled(S: ComplexArray, inertia: FloatArray) -> ComplexArray:
    """Return J^-1/2 S J^1/2 for S (N, F, n_u, n_u) and inertia J (N, n_u)."""
    root = np.sqrt(inertia)[:, None]
    return S / root[..., :, None] * root[..., None, :]


def bandwidths(E: ComplexArray, freq_hz: FloatArray) -> FloatArray:
    """Return the frequencies (N, n_u), Hz, where |E| first rises to -3 dB, or an end of the grid; E (N, F, n_u)."""
    size = np.abs(E)
    is_above = size >= THRESHOLD
    last = np.where(is_above.any(axis=1), is_above.argmax(axis=1), size.shape[1] - 1)
    first = np.maximum(last - 1, 0)
    rows = np.arange(len(E))[:, None]
    axes = np.arange(size.shape[2])[None]
    low, high = np.log(size[rows, first, axes]), np.log(size[rows, last, axes])
    fraction = np.clip((np.log(THRESHOLD) - low) / np.where(high > low, high - low, 1.0), 0.0, 1.0)
    ends = np.log(freq_hz)[rows, first], np.log(freq_hz)[rows, last]
    return np.asarray(np.exp(ends[0] + fraction * (ends[1] - ends[0])))


def closed_loop_matrices(plants: Plants, gains: JointLoop, filters: Filters | None) -> FloatArray:
    """Return the system matrix A (N, n, n) of the closed loops; gains (n_u,) or (N, n_u)."""
    N, _, n_u = plants.B.shape
    T, unit, zeros = 1 / plants.rate_hz, np.eye(n_u), np.zeros((n_u, n_u))
    kp, kd, ki = (np.broadcast_to(gain, (N, n_u))[:, :, None] * unit for gain in (gains.kp, gains.kd, gains.ki))
    # States y_(k-1) and T sum e of e_k = -(k_p + k_d / T) y_k + k_d / T y_(k-1).
    A, B = _blocks([[zeros, zeros], [kd, unit]]), _blocks([[unit], [-T * kp - kd]])
    C, D = _blocks([[kd / T, ki]]), -kp - kd / T
    if not np.any(ki):
        A, B, C = A[:, :n_u, :n_u], B[:, :n_u], C[:, :, :n_u]
    if filters is not None:
        Af, Bf, Cf, Df = filters.matrices
        A, B = _blocks([[A, np.zeros((A.shape[1], len(Af)))], [Bf @ C, Af]]), _blocks([[B], [Bf @ D]])
        C, D = _blocks([[Df @ C, Cf]]), Df * D  # both diagonal
    return _blocks([[plants.A + plants.B @ D @ plants.C, plants.B @ C], [B @ plants.C, A]])


def _blocks(rows: list[list[FloatArray]]) -> FloatArray:
    """Return block matrices (N, m, n) from blocks (N, ., .) or (., .)."""
    N = np.broadcast_shapes(*((1, *block.shape)[-3:-2] for row in rows for block in row))
    return np.block([[np.broadcast_to(block, (*N, *block.shape[-2:])) for block in row] for row in rows])
