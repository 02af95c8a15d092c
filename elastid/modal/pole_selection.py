r"""Selection of the poles that are modes: matching pursuit over candidates, then backward elimination by F tests.

A pole is a mode if its two real columns reduce the weighted squares of some element by more than noise does by chance,

.. math:: D_{rc} = \| Q_r^T e_c \|^2, \qquad \frac{D_{rc}}{2 s_{rc}^2} \sim F(4, 2 n_r)

with the noise variance s_rc^2 of the element on the n_r lines near the pole.  Four numbers are searched for: residue
and pole.  The probability is for the largest of as many trials as there are lines and elements.  Elements may have
noise in common: noise of an input has, at a resonance.
"""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import scipy.linalg

from elastid.base.arrays import BoolArray, ComplexArray, FloatArray
from elastid.modal.model import ModalFit, complex_columns


@dataclass(frozen=True)
class SelectionLimits:
    """Thresholds of a mode.  Of 144 records of noise none had a mode (`scripts/studies/modes.py`)."""

    records_with_false_modes: float = 0.002  # fraction of records of noise, before the judgement of damping
    trials_per_line: float = 2.0
    lines: int = 12  # least number to either side of a pole, on which the noise variance is measured
    half_widths: float = 3.0  # to either side of a pole, likewise
    outside: float = 3e-3  # fraction of a narrow pole's D on the lines near the four nearest
    max_poles: int = 60
    min_independent_fraction: float = 1e-4  # of a candidate's columns that must be new to the model
    batch_half_widths: float = 6.0  # between candidates that are added in one step


LIMITS = SelectionLimits()


def p_value(reductions: FloatArray, variances: FloatArray, lines: FloatArray, trials: float) -> FloatArray:
    """Return the probability (n,) that noise alone gives a pole with as large a reduction of squares.

    reductions (n, C): D of each element.  variances (n, C): s^2 times the number of correlated lines.  lines (n,): n_r.
    """
    from scipy.special import fdtrc

    ratio = (reductions / np.maximum(variances, 1e-300)).max(axis=1, initial=0.0) / 2
    return np.asarray(np.minimum(1.0, fdtrc(4.0, np.maximum(2 * lines, 2.0), ratio) * trials * reductions.shape[1]))


def reductions(fit: ModalFit, candidates: ComplexArray) -> FloatArray:
    """Return D (n, C) of each candidate (n,) as the only one added to the fit."""
    columns = fit.data.columns(candidates)
    columns = columns / np.linalg.norm(columns, axis=0)
    free = columns - fit.Q @ (fit.Q.T @ columns)
    projections = (free.T @ fit.residual).reshape(len(candidates), 2, -1)
    pairs = free.reshape(len(free), -1, 2)
    gram = np.einsum("fri,frj->rij", pairs, pairs)
    is_new = np.linalg.eigvalsh(gram)[:, 0] > LIMITS.min_independent_fraction**2
    gram[~is_new] = np.eye(2)
    residues = np.einsum("ric,rij,rjc->rc", projections, np.linalg.inv(gram), projections, optimize=True)
    return np.where(is_new[:, None], residues, 0.0)


def separate_reductions(fit: ModalFit) -> tuple[FloatArray, FloatArray]:
    """Return D (n, C) of each pole with all others in the model: on all lines, and without its highest line.

    A pole narrower than a line loses its four nearest lines, because a disturbance of three lines has no others.
    """
    n, omega, spacing = len(fit.poles), fit.data.basis.omega, fit.data.basis.spacing
    Q, R = fit.factors
    rows = np.linalg.pinv(R, 1e-12)[: 2 * n].reshape(n, 2, -1)
    # Q times these: components of each pole's columns that are orthogonal to all other columns.
    projections = np.linalg.pinv(rows @ rows.mT) @ rows
    total = np.sum((projections.mT @ fit.solution[0][: 2 * n].reshape(n, 2, -1)) ** 2, axis=1)
    columns = complex_columns(Q @ projections.reshape(2 * n, -1).T).reshape(-1, n, 2)
    nearest = np.arange(len(omega)) == np.argmax(np.sum(np.abs(columns) ** 2, axis=2), axis=0)[:, None]
    is_narrow = -2 * fit.poles.real <= spacing
    nearest[is_narrow] = np.abs(omega - fit.poles[is_narrow, None].imag) < 2 * spacing
    y, moments, without_nearest = fit.data.y, Q.T @ fit.data.y, np.zeros_like(total)
    for r, pair in enumerate(projections.mT):
        rows = np.tile(nearest[r], 2)
        U = Q[rows]
        inverse = np.linalg.pinv(np.eye(len(U)) - U @ U.T, 1e-12, hermitian=True)
        # Products with (I - U^T U)^-1 = I + U^T (I - U U^T)^-1 U, I - U^T U: Q^T Q of the other lines.
        slopes, all_poles = (x + U.T @ (inverse @ (U @ x)) for x in (pair, moments - U.T @ y[rows]))
        projection = pair.T @ all_poles
        coefficients = np.linalg.pinv(pair.T @ slopes, hermitian=True) @ projection
        without_nearest[r] = np.sum(projection * coefficients, axis=0)
        if nearest[r].sum() > 1:
            local = np.tile(_window(fit, r) & ~nearest[r], 2)
            residual = y[local] - Q[local] @ (all_poles - slopes @ coefficients)
            reduction = np.sum((scipy.linalg.orth(Q[local] @ slopes).T @ residual) ** 2)
            without_nearest[r] *= reduction >= LIMITS.outside * total[r].sum()
    return total, without_nearest


def _variance_near(fit: ModalFit, pole: complex) -> FloatArray:
    """Return the stated variance (C,) of weighted elements near a pole: the mean over the lines in its half width."""
    omega = fit.data.basis.omega
    low, high = np.searchsorted(omega, (pole.imag + pole.real, pole.imag - pole.real))
    low = min(int(low), len(omega) - 1)
    return np.asarray(fit.data.variance[max(low - 1, 0) : max(int(high), low) + 1].mean(axis=0))


def _window(fit: ModalFit, r: int) -> BoolArray:
    """Return flags (F,) of the lines within three half widths of a pole, but at least twelve lines to either side."""
    omega, pole, line = fit.data.basis.omega, fit.poles[r], np.arange(len(fit.data.weight))
    center, half = int(np.searchsorted(omega, pole.imag)), LIMITS.half_widths * -pole.real
    low = min(center - LIMITS.lines, int(np.searchsorted(omega, pole.imag - half)))
    high = max(center + LIMITS.lines, int(np.searchsorted(omega, pole.imag + half)))
    return (line >= min(low, len(line) - 2 * LIMITS.lines)) & (line < max(2 * LIMITS.lines, high))


def noise_variances(fit: ModalFit) -> tuple[FloatArray, FloatArray]:
    """Return s^2 (n, C) of complex residuals near each pole, not below the stated variance, and n_r (n,)."""
    variance, n = fit.data.variance, len(fit.poles)
    power = np.abs(complex_columns(fit.residual)) ** 2
    s_r, n_r = np.ones((n, power.shape[1])), np.zeros(n)
    for r, pole in enumerate(fit.poles):
        window = _window(fit, r)
        n_r[r] = max(float(np.sum(1 - fit.leverage[window])), 1.0)
        # The stated variance is that at the pole, because lines may differ in noise.
        s_r[r] = _variance_near(fit, pole) * np.maximum(1.0, (power / variance)[window].sum(axis=0) / n_r[r])
    return s_r, n_r


def pursue_poles(fit: ModalFit, candidates: ComplexArray, correlated_lines: float) -> ModalFit:
    """Return the model with the candidates (n,) that reduce its squares by more than noise does, the largest first."""
    trials = LIMITS.trials_per_line * len(fit.data.weight)
    while len(candidates) and len(fit.poles) < LIMITS.max_poles:
        reduction = reductions(fit, candidates)
        noise = correlated_lines * np.stack([_variance_near(fit, pole) for pole in candidates])
        good = p_value(reduction, noise, np.full(len(reduction), 1e9), trials) < LIMITS.records_with_false_modes
        if not good.any():
            break
        candidates, reduction = candidates[good], reduction[good].sum(axis=1)
        neighbours: list[complex] = []
        gap = LIMITS.batch_half_widths
        for pole in candidates[np.argsort(-reduction)]:
            # A weak candidate next to a strong one may be an error of that pole and waits until it is refined.
            if all(abs(pole.imag - near.imag) > gap * max(-pole.real, -near.real) for near in neighbours):
                neighbours.append(pole)
            if len(neighbours) >= max(1, len(reduction) // 4):
                break
        candidates = np.array([pole for pole in candidates if pole not in neighbours], complex)
        fit = ModalFit(fit.data, np.concatenate([fit.poles, np.array(neighbours)])).refined(6, 1e-1)
    return fit.refined()


def eliminate_poles(fit: ModalFit, correlated_lines: float) -> ModalFit:
    """Return the model without the poles that noise may give by chance, the most likely first."""
    trials = LIMITS.trials_per_line * len(fit.data.weight)
    while len(fit.poles):
        (total, without_nearest), (s_r, n_r) = separate_reductions(fit), noise_variances(fit)
        noise = s_r * correlated_lines
        p = np.maximum(p_value(total, noise, n_r, trials), p_value(without_nearest, noise, n_r, 1.0))
        if p.max() < LIMITS.records_with_false_modes:
            break
        fit = fit.without(int(np.argmax(p))).refined(8, 1e-2)
    while (index := _unresolved_pole(fit)) is not None:
        fit = fit.without(index).refined(8, 1e-2)
    return fit.refined(30, 1e-4)


def _unresolved_pole(fit: ModalFit) -> int | None:
    """Return the index of the weaker of two poles that are narrower and closer than a line; None without such a pair.

    Such a pair is one mode whose frequency changed between inputs.
    """
    spacing, order = fit.data.basis.spacing, np.argsort(fit.poles.imag)
    for low, high in pairwise(order.tolist()):
        widths = -2 * fit.poles.real[[low, high]]
        if max(float(fit.poles.imag[high] - fit.poles.imag[low]), float(widths.max())) < spacing:
            reduction = separate_reductions(fit)[0].sum(axis=1)
            return int(low if reduction[low] < reduction[high] else high)
    return None


def residual_peaks(fit: ModalFit) -> ComplexArray:
    """Return candidates (n,), rad/s, at the six highest residual peaks, each with three dampings."""
    smooth = np.convolve(np.mean(np.abs(complex_columns(fit.residual)) ** 2, axis=1), np.ones(3), "same")
    tops = np.flatnonzero((smooth[1:-1] > smooth[:-2]) & (smooth[1:-1] >= smooth[2:])) + 1
    tops = tops[np.argsort(-smooth[tops])][:6]
    omega, spacing = fit.data.basis.omega, fit.data.basis.spacing
    return np.array([1j * omega[k] - width * spacing for k in tops for width in (0.7, 2.0, 6.0)], complex)
