r"""Covariance of poles, residues and shapes: each is linear in the errors of the response, whose scatter is that seen.

With the influence I_k of line k on a number, and residuals relative to the stated standard deviation and phase of G,

.. math:: \mathrm{var} = \frac{1}{2} \sum_k \sum_l \rho_{k-l}\, I_k^H C_k I_l, \qquad
          C_k = \mathrm{mean}_{l \approx k}\, \epsilon_l \epsilon_l^H

so that elements with noise in common, and a model that does not fit, widen the intervals.  rho: correlation of lines.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.ndimage import uniform_filter1d

from elastid.base.arrays import ComplexArray, FloatArray
from elastid.base.statistics import small_sample_factors
from elastid.modal.basis import unstacked
from elastid.modal.model import ModalFit

# Lines to either side over which residuals are averaged.
AVERAGED_LINES = 20
# Of noise in the residuals, and of the degrees of freedom of its level, at least.
LEAST_FREE, LEAST_DOF = 0.2, 4.0
# Lags of their autocorrelation, in correlated lines.
CORRELATION_LAGS = 2.0


@dataclass(frozen=True)
class Influences:
    """Of a fit: what an error of each line does to its numbers."""

    fit: ModalFit
    correlated_lines: float

    def covariance(self, influence: ComplexArray) -> FloatArray:
        """Covariance (p, p) of p real numbers by their influence (p, F, C) on weighted complex errors."""
        power = np.sum(np.abs(influence) ** 2, axis=(0, 2))
        # Lines that matter; most of a pole's influence is within its half widths.
        used = np.flatnonzero(power > 1e-4 * power.max())
        low, high = int(used[0]), int(used[-1]) + 1
        half = self._half
        own = np.sqrt(self.fit.data.variance / self._free[:, None]) * self._phase.conj()
        scaled = influence[:, low:high] * own[low:high]
        # Row k + half of the residuals belongs to line k; reflected at the ends.
        padded = np.pad(self._normalised, ((half, half), (0, 0)), "symmetric")[low : high + 2 * half]
        conjugate = scaled.conj()
        total, shifts = np.zeros((len(influence), len(influence))), range(2 * half + 1)
        for shift in shifts:
            # t (p, F): errors of the number if line k had the residuals of another line.
            t = np.einsum("pkc,kc->pk", conjugate, padded[shift : shift + high - low])
            total += 0.5 * (t @ t.conj().T).real
        total *= self._line_factor(scaled) / len(shifts)
        # Intervals are 1.96 standard deviations, of a variance that is itself from some lines: Student's quantile.
        weight = np.sum(np.abs(scaled) ** 2, axis=(0, 2))
        lines = len(shifts) + float(weight.sum() ** 2 / (weight @ weight)) - 1
        dof = 2 * lines * float(weight @ self._free[low:high]) / float(weight.sum()) / self._together
        return np.asarray(total * small_sample_factors(np.array(max(dof, LEAST_DOF))) ** 2)

    def _line_factor(self, influence: ComplexArray) -> float:
        """Variance with correlated lines over that without, by the autocorrelation of the residuals."""
        own, seen, stated = float(np.sum(np.abs(influence) ** 2)), 1.0, 1.0
        for lag, rho in enumerate(self._autocorrelation[: influence.shape[1] - 1], start=1):
            product = complex(np.vdot(influence[:, :-lag], influence[:, lag:])) / own
            seen += 2 * (product * rho).real
            stated += 2 * max(1 - lag / self.correlated_lines, 0.0) * product.real
        # A fit takes the correlation of errors of local methods out of the residuals.
        return max(seen, stated if self._together > 1 else 1.0, 1.0)

    @cached_property
    def _autocorrelation(self) -> ComplexArray:
        """rho (n,) at the lags 1, 2 ... over which lines are correlated as stated; none where they are not."""
        if self.correlated_lines <= 1:
            return np.empty(0, complex)
        size = np.abs(self._normalised)
        residual = self._normalised * np.minimum(1.0, 3.0 / np.maximum(size, 1e-300))
        power = float(np.vdot(residual, residual).real)
        lags = range(1, min(int(np.ceil(CORRELATION_LAGS * self.correlated_lines)), len(residual) // 4) + 1)
        return np.array([np.vdot(residual[lag:], residual[:-lag]) / power for lag in lags])

    @cached_property
    def _normalised(self) -> ComplexArray:
        """Residuals (F, C) over their stated standard deviation."""
        return np.asarray(unstacked(self.fit.residual) / np.sqrt(self.fit.data.variance) * self._phase.conj())

    @property
    def _together(self) -> float:
        """Lines whose errors are one: those of local methods; of segments, leakage at a resonance is independent."""
        return self.correlated_lines if self.fit.data.basis.correlation is None else 1.0

    @property
    def _half(self) -> int:
        """Lines to either side over which residuals are averaged."""
        return min(AVERAGED_LINES, len(self._normalised) // 2)

    @cached_property
    def _free(self) -> FloatArray:
        """Part (F,) of the noise that a fit leaves in the residuals about a line: of lines together it takes more."""
        taken = np.sum(np.abs(unstacked(self.fit.Q)) ** 2, axis=1) / 2 + self._pole_leverage()
        mean = uniform_filter1d(self._together * taken, 2 * self._half + 1, mode="reflect")
        return np.asarray(np.maximum(1 - mean, LEAST_FREE))

    @cached_property
    def _phase(self) -> ComplexArray:
        """Of the model (F, C): noise of an input turns with it from line to line, in all outputs alike."""
        model = self.fit.synthesis()
        return np.asarray(model / np.maximum(np.abs(model), np.finfo(float).tiny))

    def _pole_leverage(self) -> FloatArray:
        """Part (F,) of each line in the fit of the poles, over all elements."""
        fit, n = self.fit, len(self.fit.poles)
        if not n:
            return np.zeros(len(fit.data.weight))
        a = fit.coefficients[: 2 * n].reshape(n, 2, -1)
        energy = np.einsum("ric,ric->r", a, a)
        slopes = np.abs(unstacked(fit.free_slopes)) ** 2
        own = slopes.reshape(len(slopes), n, 2).sum(axis=2)
        share = own / np.maximum(own.sum(axis=0), 1e-300)
        # Two real parameters a pole of 2 C real rows a line.
        return np.asarray(share @ (energy > 0) / a.shape[2])

    @cached_property
    def _inverse(self) -> FloatArray:
        return np.asarray(np.linalg.pinv(self.fit.information, rcond=1e-14, hermitian=True))

    def of_pole(self, r: int) -> ComplexArray:
        """Influence (2, F, C) of weighted errors on Re and Im of a pole: its rows of (J^T J)^-1 J^T."""
        fit, n = self.fit, len(self.fit.poles)
        b = fit.directions
        rows = self._inverse[2 * r : 2 * r + 2].reshape(2, n, 2)
        weights = np.einsum("pnq,nqic->pnic", rows, b).reshape(2, 2 * n, -1)
        slopes = unstacked(fit.free_slopes)
        return np.stack([slopes @ each for each in weights])

    @cached_property
    def pole_covariances(self) -> tuple[FloatArray, ...]:
        """(2, 2) of Re and Im of each pole, over the frequency scale."""
        return tuple(self.covariance(self.of_pole(r)) for r in range(len(self.fit.poles)))

    def residue_std(self, r: int) -> FloatArray:
        """Standard deviation (C,), complex: E|dR|^2 is its square, of a pole's residue over the elements' scale.

        That at the pole as it is, and that by the pole, whose errors move all elements together.
        """
        fit = self.fit
        rows = slice(2 * r, 2 * r + 2)
        Q, R, norms = fit.factors
        pair = np.linalg.pinv(R, rcond=1e-12)[rows] @ Q.T / norms[rows, None]
        power = np.abs(unstacked(pair.T)) ** 2  # (F, 2)
        seen = uniform_filter1d(np.abs(self._normalised) ** 2, 2 * self._half + 1, axis=0, mode="reflect")
        local = np.einsum("fp,fc->c", power, seen / self._free[:, None] * fit.data.variance) / 2
        level = local * self._line_factor(unstacked(pair.T).T[:, :, None])
        slope = np.stack([np.linalg.lstsq(R, Q.T @ d, rcond=1e-12)[0] / norms for d in self._derivative(r).T])
        b, C = fit.directions[r], self.pole_covariances[r]
        # Of Re and Im R_c by Re and Im lambda: minus the part of J inside the model.
        moved = np.einsum("ik,pic->pkc", slope[:, rows], b)
        return np.asarray(np.sqrt(level + np.einsum("pkc,pq,qkc->c", moved, C, moved)))

    def _derivative(self, r: int) -> FloatArray:
        return self.fit.data.columns(self.fit.poles[[r]], derivative=True)
