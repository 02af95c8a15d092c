r"""Covariance of poles and residues: each is linear in the errors of the response, whose scatter the residuals show.

With the influence I_k of line k on a number, and residuals relative to the stated standard deviation and phase of G,

.. math:: \mathrm{var} = \frac{1}{2} \sum_k \sum_l \rho_{k-l}\, I_k^H C_k I_l, \qquad
          C_k = \mathrm{mean}_{l \approx k}\, \epsilon_l \epsilon_l^H

so that common noise of elements, and a model that does not fit, widen the intervals.  rho: correlation of lines.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.ndimage import uniform_filter1d

from elastid.base.arrays import ComplexArray, FloatArray
from elastid.base.statistics import small_sample_factors
from elastid.modal.model import ModalFit, complex_columns

# Lines to either side over which residuals are averaged.
AVERAGED_LINES = 20
# Least fraction of the noise in the residuals, and least degrees of freedom of the noise variance.
LEAST_FREE, LEAST_DOF = 0.2, 4.0
# Lags of the residuals' autocorrelation, in correlated lines.
CORRELATION_LAGS = 2.0


@dataclass(frozen=True)
class Influences:
    """Influence of an error of each line on the numbers of a fit."""

    fit: ModalFit
    correlated_lines: float

    def covariance(self, influence: ComplexArray) -> FloatArray:
        """Return covariance (p, p) of p real numbers; influence (p, F, C): of weighted complex errors on them."""
        power = np.sum(np.abs(influence) ** 2, axis=(0, 2))
        # Most of a pole's influence is within its half widths; the other lines cost time only.
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
        # Student's quantile over 1.96, because the variance is itself estimated from a number of lines.
        weight = np.sum(np.abs(weighted) ** 2, axis=(0, 2))
        lines = len(shifts) + float(weight.sum() ** 2 / (weight @ weight)) - 1
        dof = 2 * lines * float(weight @ self._free[low:high]) / float(weight.sum()) / self._shared_error_lines
        return total * small_sample_factors(max(dof, LEAST_DOF)) ** 2

    def _line_factor(self, influence: ComplexArray) -> float:
        """Return the factor >= 1 by which correlated lines increase the variance of a number; influence (p, F, C)."""
        rho = self._autocorrelation[: influence.shape[1] - 1]
        if not rho.size:
            return 1.0
        spectrum = np.fft.fft(influence, 2 * influence.shape[1], axis=1)
        products = np.fft.ifft(np.sum(np.abs(spectrum) ** 2, axis=(0, 2)))[: influence.shape[1]]
        lags, products = np.arange(1, len(rho) + 1), products[1 : len(rho) + 1] / products[0].real
        factor = 1 + 2 * float(np.sum((products * rho).real))
        stated = 1 + 2 * float(np.maximum(1 - lags / self.correlated_lines, 0.0) @ products.real)
        # A fit removes the correlation of local methods' errors from the residuals.
        return max(factor, stated if self._shared_error_lines > 1 else 1.0, 1.0)

    @cached_property
    def _autocorrelation(self) -> ComplexArray:
        """Correlation rho (n,) of lines at the lags 1, 2 ... of the estimator; empty for independent lines."""
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
        """Number of lines with a common error by local methods; leakage of segments is independent at a resonance."""
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
        """Phase factors (F, C) of the model: noise of an input has them from line to line, the same in all outputs."""
        model = self.fit.synthesis()
        return model / np.maximum(np.abs(model), np.finfo(float).tiny)

    def _pole_leverage(self) -> FloatArray:
        """Return the leverage (F,) of each line in the fit of the poles, over all elements."""
        fit, n = self.fit, len(self.fit.poles)
        if not n:
            return np.zeros(len(fit.data.weight))
        slopes = np.abs(fit.free_slopes) ** 2
        of_elements = slopes.reshape(len(slopes), n, 2).sum(axis=2)
        fraction = of_elements / np.maximum(of_elements.sum(axis=0), 1e-300)
        # A pole has two real parameters, a line 2 C real rows.
        return np.asarray(fraction @ fit.directions.any(axis=(1, 2, 3)) / fit.directions.shape[3])

    @cached_property
    def _inverse(self) -> FloatArray:
        return np.asarray(np.linalg.pinv(self.fit.normal_equations[0], 1e-14, hermitian=True))

    def pole_influence(self, r: int) -> ComplexArray:
        """Return influence (2, F, C) of weighted errors on Re and Im of a pole: its rows of (J^T J)^-1 J^T."""
        fit, n = self.fit, len(self.fit.poles)
        rows = self._inverse[2 * r : 2 * r + 2].reshape(2, n, 2)
        weights = np.einsum("pnq,nqic->pnic", rows, fit.directions).reshape(2, 2 * n, -1)
        return np.stack([fit.free_slopes @ weight for weight in weights])

    @cached_property
    def pole_covariances(self) -> tuple[FloatArray, ...]:
        """Covariance (2, 2) of Re and Im of each pole, over the frequency scale squared."""
        return tuple(self.covariance(self.pole_influence(r)) for r in range(len(self.fit.poles)))

    def correlation(self, members: Sequence[tuple[int, FloatArray]]) -> FloatArray:
        """Return the correlation (2 m, 2 m) of two numbers each of m poles; members: index, slopes (2, 2) by a pole."""
        scale = self.fit.data.basis.scale
        rows = np.stack([scale * (slopes @ self.pole_influence(r).reshape(2, -1)) for r, slopes in members])
        rows = rows.reshape(2 * len(members), *self._normalised.shape)
        rows /= np.linalg.norm(rows, axis=(1, 2), keepdims=True)
        covariance = self.covariance(rows)
        scatter = np.sqrt(np.maximum(np.diag(covariance), np.finfo(float).tiny))
        return np.asarray(covariance / np.outer(scatter, scatter))

    def residue_std(self, r: int) -> FloatArray:
        """Return sqrt(E|dR|^2) (C,) of a pole's residue over the elements' scale.

        The variance is the sum of the variance at a fixed pole and of the contribution of the pole's error.
        """
        fit = self.fit
        rows = slice(2 * r, 2 * r + 2)
        (Q, R), norms = fit.factors, fit.columns[1]
        pair = np.linalg.pinv(R, 1e-12)[rows] @ Q.T / norms[rows, None]
        power = np.abs(complex_columns(pair.T)) ** 2  # (F, 2)
        local_power = uniform_filter1d(np.abs(self._normalised) ** 2, 2 * self._half + 1, axis=0, mode="reflect")
        local = np.einsum("fp,fc->c", power, local_power / self._free[:, None] * fit.data.variance) / 2
        variance = local * self._line_factor(complex_columns(pair.T).T[:, :, None])
        slope = (np.linalg.lstsq(R, Q.T @ fit.slopes[:, rows], 1e-12)[0] / norms[:, None]).T
        b, C = fit.directions[r], self.pole_covariances[r]
        # d (Re, Im) R_c / d (Re, Im) lambda: minus the component of J inside the model.
        shift = np.einsum("ik,pic->pkc", slope[:, rows], b)
        return np.asarray(np.sqrt(variance + np.einsum("pkc,pq,qkc->c", shift, C, shift)))
