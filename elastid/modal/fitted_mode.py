r"""Poles of a fit as modes: their covariance, numbers with standard deviations, judgement and notes.

Covariance of poles, residues and shapes: each is linear in the errors of the response, whose scatter is that seen.

With the influence I_k of line k on a number, and residuals relative to the stated standard deviation and phase of G,

.. math:: \mathrm{var} = \frac{1}{2} \sum_k \sum_l \rho_{k-l}\, I_k^H C_k I_l, \qquad
          C_k = \mathrm{mean}_{l \approx k}\, \epsilon_l \epsilon_l^H

so that elements with noise in common, and a model that does not fit, widen the intervals.  rho: correlation of lines.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from scipy.ndimage import uniform_filter1d

from elastid.base.arrays import ComplexArray, FloatArray
from elastid.base.errors import Note
from elastid.base.statistics import small_sample_factors
from elastid.modal.model import ModalFit, complex_columns
from elastid.modal.poles import LIMITS as POLES
from elastid.response import Response


@dataclass(frozen=True)
class ModeLimits:
    """Judgement of poles that are more than noise.

    In 144 random structures under hammers, multisines, noise and sweeps, of 958 modes, two were missed and none false
    (`scripts/studies/modes.py`).
    """

    damping_significance: float = 2.5  # damping over its standard deviation
    freq_std: float = 0.05  # of the frequency, at most: a slow pole at the edge of the band is no mode
    min_input_singular_value: float = 0.01  # least singular value of the inputs over its largest: 40 dB,
    sufficient_coherence: float = 0.9  # unless the coherence shows that less suffices
    coherence: float = 0.2  # multiple, median over some lines of the best output
    coherence_lines: int = 21
    lines: int = 16  # of a response that has modes
    second_shape: float = 0.1  # singular value of a residue over its first, from which on a root is repeated
    second_shape_std: float = 6.0  # and over its standard deviation
    twin_distance: float = 1.5  # in half widths, of poles with one shape, of which the weaker mends the stronger
    twin_mac: float = 0.9
    max_twin_residue: float = 0.1  # of the stronger one's residue
    broad: float = 0.03  # damping, from which on a pole may be background that stronger modes leave
    min_peak_ratio: float = 0.1  # of the rms of G within its half powers, that a broad mode's peak has at least
    residue_std: float = 0.5  # of a broad mode's residue, relative
    undamped_std: float = 4.0  # standard deviations by which a damping is below 0
    lines_in_width: float = 1.5  # of a resonance between its half powers, below which its damping is doubtful
    unexplained: float = 0.1  # power fraction, from which on the conjugate response is tried
    phase_gain: float = 0.2  # of it, that the conjugate leaves at most
    max_pole_distance: float = 0.05  # of a pole from the frequency that it was chosen by, relative


LIMITS = ModeLimits()


@dataclass(frozen=True)
class FittedMode:
    """Frequency and damping with standard deviations, the residue (n_y, n_u) and its standard deviation.

    index: of the pole in the fit.  slopes (2, 2): d (f, zeta) / d (Re lambda, Im lambda), SI.
    """

    freq_hz: float
    freq_std: float
    zeta: float
    zeta_std: float
    residue: ComplexArray
    residue_std: FloatArray
    index: int = 0
    slopes: FloatArray = field(default_factory=lambda: np.eye(2))

    @classmethod
    def of(cls, response: Response, influences: "Influences", r: int, pole: complex) -> "FittedMode":
        """Return the pole r of a fit; pole: the same in 1/s, without windows."""
        fit, size, scale = influences.fit, abs(pole), influences.fit.data.basis.scale
        C = influences.pole_covariances[r] * scale**2
        # zeta = -Re lambda / |lambda|
        freq_slope = np.array([pole.real, pole.imag]) / size / (2 * np.pi)
        zeta_slope = np.array([-(pole.imag**2), pole.real * pole.imag]) / size**3
        freq_std, zeta_std = (float(np.sqrt(max(float(g @ C @ g), 0.0))) for g in (freq_slope, zeta_slope))
        shape = response.G.shape[1:]
        residue = (fit.residues[r] * scale).reshape(shape)
        std = (influences.residue_std(r) * fit.data.scale * scale).reshape(shape)
        slopes = np.stack([freq_slope, zeta_slope])
        return cls(size / (2 * np.pi), freq_std, -pole.real / size, zeta_std, residue, std, r, slopes)

    def is_within(self, response: Response, shift: float = 0.0) -> bool:
        """Return True within the band if frequency and damping have small intervals; narrow widths need no damping."""
        inside = response.freq_hz[0] <= self.freq_hz <= response.freq_hz[-1]
        inside = inside and self.freq_std <= LIMITS.freq_std * self.freq_hz
        is_damped = LIMITS.damping_significance * self.zeta_std < self.zeta or self.lines_in_width(response, shift) < 1
        return bool(inside and is_damped and self.zeta < POLES.max_damping)

    def lines_in_width(self, response: Response, shift: float = 0.0) -> float:
        """Return lines within the width 2 zeta f; with an exponential window of 1 / shift s 1 / (pi tau) more."""
        return (2 * self.zeta * self.freq_hz + shift / np.pi) / float(np.median(np.diff(response.freq_hz)))

    def is_background(self, response: Response) -> bool:
        """Return True for a broad pole of little height within its half powers, or of a shape that is not known."""
        if self.zeta < LIMITS.broad:
            return False
        size, half_width = float(np.linalg.norm(self.residue)), self.freq_hz * self.zeta
        G = response.G[np.abs(response.freq_hz - self.freq_hz) <= half_width]
        rms = float(np.linalg.norm(G)) / np.sqrt(max(len(G), 1))
        is_unknown = float(np.linalg.norm(self.residue_std)) > LIMITS.residue_std * size
        return bool(is_unknown or size / (2 * np.pi * half_width) < LIMITS.min_peak_ratio * rms)

    def is_near(self, poles_hz: Sequence[float]) -> bool:
        """Return True if one of these frequencies is within 5 %, or the half width: poles may move in a fit."""
        return any(abs(self.freq_hz / f - 1) < max(LIMITS.max_pole_distance, self.zeta) for f in poles_hz)

    def is_twin_of(self, other: "FittedMode") -> bool:
        """Return True for a weak pole within a resonance of the same shape: it follows an error of that one."""
        size, size_of_other = float(np.linalg.norm(self.residue)), float(np.linalg.norm(other.residue))
        width = LIMITS.twin_distance * max(self.freq_hz * self.zeta, other.freq_hz * other.zeta)
        overlap = abs(np.vdot(self.residue, other.residue)) / (size * size_of_other)
        is_weak = size < LIMITS.max_twin_residue * size_of_other
        return bool(is_weak and abs(self.freq_hz - other.freq_hz) < width and overlap**2 > LIMITS.twin_mac)


def without_twins(modes: Sequence[FittedMode]) -> list[FittedMode]:
    """Return the modes without weak poles within the resonance of a stronger one of the same shape."""
    return [mode for mode in modes if not any(mode.is_twin_of(near) for near in modes if near is not mode)]


def lost_notes(modes: Sequence[FittedMode], response: Response, poles_hz: Sequence[float] | None) -> tuple[Note, ...]:
    """Return a note on chosen frequencies without a pole."""
    missing = [f"{f:g}" for f in poles_hz or () if not any(mode.is_near([f]) for mode in modes)]
    if not missing:
        return ()
    unit = "Hz" if response.has_rate else "of the sampling rate"
    text = (
        f"no pole is at {', '.join(missing)} {unit}, which poles_hz names: fitted from there it moves to a resonance "
        "elsewhere; choose stable poles in the stabilisation diagram, and name those beside them, too"
    )
    return (Note("modal/poles", text, response.configuration.name),)


def window_notes(modes: Sequence[FittedMode], shift: float, response: Response) -> tuple[Note, ...]:
    """Return note on poles with significantly less damping than the removed exponential window."""
    count = sum(mode.zeta < -LIMITS.undamped_std * mode.zeta_std for mode in modes) if shift else 0
    if not count:
        return ()
    text = (
        f"an exponential window of {1 / shift:g} s has more damping than {count} of {len(modes)} poles, which "
        "cannot have gone through it; give the time constant that the analyser states, or none"
    )
    return (Note("modal/damping", text, response.configuration.name),)


def line_notes(modes: Sequence[FittedMode], response: Response) -> tuple[Note, ...]:
    """Return a note on modes with too few lines within the half-power width 2 zeta f: records are too short."""
    lines = np.array([mode.lines_in_width(response) for mode in modes])
    if not np.any(lines < LIMITS.lines_in_width):
        return ()
    worst, count = int(np.argmin(lines)), int(np.sum(lines < LIMITS.lines_in_width))
    mode = modes[worst]
    unit, per_line = ("Hz", " s") if response.has_rate else ("of the sampling rate", " samples")
    text = (
        f"{count} of {len(modes)} resonances have too few lines for their "
        f"damping. At {mode.freq_hz:.4g} {unit}, measure periods of {2 / (mode.zeta * mode.freq_hz):.3g}{per_line}, or "
        "lower resolution_hz for a long record"
    )
    return (Note("modal/damping", text, response.configuration.name),)


# Lines to either side over which residuals are averaged.
AVERAGED_LINES = 20
# Of noise in the residuals, and of the degrees of freedom of its level, at least.
LEAST_FREE, LEAST_DOF = 0.2, 4.0
# Lags of their autocorrelation, in correlated lines.
CORRELATION_LAGS = 2.0


@dataclass(frozen=True)
class Influences:
    """Influence of an error of each line on the numbers of a fit."""

    fit: ModalFit
    correlated_lines: float

    def covariance(self, influence: ComplexArray) -> FloatArray:
        """Return covariance (p, p) of p real numbers by their influence (p, F, C) on weighted complex errors."""
        power = np.sum(np.abs(influence) ** 2, axis=(0, 2))
        # Lines that matter; most of a pole's influence is within its half widths.
        significant = np.flatnonzero(power > 1e-4 * power.max())
        low, high = int(significant[0]), int(significant[-1]) + 1
        half = self._half
        scale = np.sqrt(self.fit.data.variance / self._free[:, None]) * self._phase.conj()
        weighted = influence[:, low:high] * scale[low:high]
        # Row k + half of the residuals belongs to line k; reflected at the ends.
        extended = np.pad(self._normalised, ((half, half), (0, 0)), "symmetric")[low : high + 2 * half]
        conjugate = weighted.conj()
        total, shifts = np.zeros((len(influence), len(influence))), range(2 * half + 1)
        for shift in shifts:
            # t (p, F): errors of the number if line k had the residuals of another line.
            t = np.einsum("pkc,kc->pk", conjugate, extended[shift : shift + high - low])
            total += 0.5 * (t @ t.conj().T).real
        total *= self._line_factor(weighted) / len(shifts)
        # Intervals are 1.96 standard deviations, of a variance that is itself from some lines: Student's quantile.
        weight = np.sum(np.abs(weighted) ** 2, axis=(0, 2))
        lines = len(shifts) + float(weight.sum() ** 2 / (weight @ weight)) - 1
        dof = 2 * lines * float(weight @ self._free[low:high]) / float(weight.sum()) / self._shared_error_lines
        return total * small_sample_factors(max(dof, LEAST_DOF)) ** 2

    def _line_factor(self, influence: ComplexArray) -> float:
        spectrum = np.fft.fft(influence, 2 * influence.shape[1], axis=1)
        products = np.fft.ifft(np.sum(np.abs(spectrum) ** 2, axis=(0, 2)))[: influence.shape[1]]
        rho = self._autocorrelation[: influence.shape[1] - 1]
        lags, products = np.arange(1, len(rho) + 1), products[1 : len(rho) + 1] / products[0].real
        factor = 1 + 2 * float(np.sum((products * rho).real))
        stated = 1 + 2 * float(np.maximum(1 - lags / self.correlated_lines, 0.0) @ products.real)
        # A fit takes the correlation of errors of local methods out of the residuals.
        return max(factor, stated if self._shared_error_lines > 1 else 1.0, 1.0)

    @cached_property
    def _autocorrelation(self) -> ComplexArray:
        """rho (n,) at the lags 1, 2 ... over which the estimator correlates lines; empty for independent lines."""
        if self.correlated_lines <= 1:
            return np.empty(0, complex)
        residual = self._normalised * np.minimum(1.0, 3.0 / np.maximum(np.abs(self._normalised), 1e-300))
        power = float(np.vdot(residual, residual).real)
        lags = range(1, min(int(np.ceil(CORRELATION_LAGS * self.correlated_lines)), len(residual) // 4) + 1)
        return np.array([np.vdot(residual[lag:], residual[:-lag]) / power for lag in lags])

    @cached_property
    def _normalised(self) -> ComplexArray:
        """Residuals (F, C) over their stated standard deviation."""
        return complex_columns(self.fit.residual) / np.sqrt(self.fit.data.variance) * self._phase.conj()

    @property
    def _shared_error_lines(self) -> float:
        """Lines with a common error by local methods; with segments, leakage at a resonance is independent."""
        return self.correlated_lines if self.fit.data.basis.correlation is None else 1.0

    @property
    def _half(self) -> int:
        return min(AVERAGED_LINES, len(self._normalised) // 2)

    @cached_property
    def _free(self) -> FloatArray:
        """Fraction (F,) of the noise that a fit leaves in the residuals near a line; correlated lines lose more."""
        leverage = self.fit.leverage + self._pole_leverage()
        mean = uniform_filter1d(self._shared_error_lines * leverage, 2 * self._half + 1, mode="reflect")
        return np.asarray(np.maximum(1 - mean, LEAST_FREE))

    @cached_property
    def _phase(self) -> ComplexArray:
        """Phase of the model (F, C): noise of an input turns with it from line to line, in all outputs alike."""
        model = self.fit.synthesis()
        return model / np.maximum(np.abs(model), np.finfo(float).tiny)

    def _pole_leverage(self) -> FloatArray:
        """Return part (F,) of each line in the fit of the poles, over all elements."""
        fit, n = self.fit, len(self.fit.poles)
        if not n:
            return np.zeros(len(fit.data.weight))
        a = fit.coefficients[: 2 * n].reshape(n, 2, -1)
        energy = np.einsum("ric,ric->r", a, a)
        slopes = np.abs(complex_columns(fit.free_slopes)) ** 2
        of_elements = slopes.reshape(len(slopes), n, 2).sum(axis=2)
        fraction = of_elements / np.maximum(of_elements.sum(axis=0), 1e-300)
        # Two real parameters a pole of 2 C real rows a line.
        return np.asarray(fraction @ (energy > 0) / a.shape[2])

    @cached_property
    def _inverse(self) -> FloatArray:
        return np.asarray(np.linalg.pinv(self.fit.information, rcond=1e-14, hermitian=True))

    def pole_influence(self, r: int) -> ComplexArray:
        """Return influence (2, F, C) of weighted errors on Re and Im of a pole: its rows of (J^T J)^-1 J^T."""
        fit, n = self.fit, len(self.fit.poles)
        b = fit.directions
        rows = self._inverse[2 * r : 2 * r + 2].reshape(2, n, 2)
        weights = np.einsum("pnq,nqic->pnic", rows, b).reshape(2, 2 * n, -1)
        slopes = complex_columns(fit.free_slopes)
        return np.stack([slopes @ weight for weight in weights])

    @cached_property
    def pole_covariances(self) -> tuple[FloatArray, ...]:
        """(2, 2) of Re and Im of each pole, over the frequency scale."""
        return tuple(self.covariance(self.pole_influence(r)) for r in range(len(self.fit.poles)))

    def joint_covariance(self, modes: Sequence[FittedMode]) -> FloatArray:
        """Return covariance (2 m, 2 m) of frequency and damping of m modes, in this order; std as each mode states it.

        The correlation is of all poles together.
        """
        if not modes:
            return np.zeros((0, 0))
        scale = self.fit.data.basis.scale
        rows = np.stack([scale * (mode.slopes @ self.pole_influence(mode.index).reshape(2, -1)) for mode in modes])
        rows = rows.reshape(2 * len(modes), *self._normalised.shape)
        rows /= np.linalg.norm(rows, axis=(1, 2), keepdims=True)
        covariance = self.covariance(rows)
        std = np.array([(mode.freq_std, mode.zeta_std) for mode in modes]).ravel()
        scatter = np.sqrt(np.maximum(np.diag(covariance), np.finfo(float).tiny))
        return np.asarray(covariance / np.outer(scatter, scatter) * np.outer(std, std))

    def residue_std(self, r: int) -> FloatArray:
        """Return standard deviation (C,), complex: E|dR|^2 is its square, of a pole's residue over the elements' scale.

        That at the pole as it is, and that by the pole, whose errors move all elements together.
        """
        fit = self.fit
        rows = slice(2 * r, 2 * r + 2)
        Q, R, norms = fit.factors
        pair = np.linalg.pinv(R, rcond=1e-12)[rows] @ Q.T / norms[rows, None]
        power = np.abs(complex_columns(pair.T)) ** 2  # (F, 2)
        local_power = uniform_filter1d(np.abs(self._normalised) ** 2, 2 * self._half + 1, axis=0, mode="reflect")
        local = np.einsum("fp,fc->c", power, local_power / self._free[:, None] * fit.data.variance) / 2
        variance = local * self._line_factor(complex_columns(pair.T).T[:, :, None])
        D = fit.data.columns(fit.poles[[r]], derivative=True)
        slope = (np.linalg.lstsq(R, Q.T @ D, rcond=1e-12)[0] / norms[:, None]).T
        b, C = fit.directions[r], self.pole_covariances[r]
        # Of Re and Im R_c by Re and Im lambda: minus the part of J inside the model.
        shift = np.einsum("ik,pic->pkc", slope[:, rows], b)
        return np.asarray(np.sqrt(variance + np.einsum("pkc,pq,qkc->c", shift, C, shift)))
