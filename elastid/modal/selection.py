r"""Choice of the poles that are modes: matching pursuit over stable poles, then backward elimination by F tests.

A pole is kept where its two real columns lower the weighted squares by more than noise does by chance,

.. math:: D_r = \sum_c \| Q_r^T e_c \|^2, \qquad \frac{D_r / C}{s_r^2} \sim F(2 C_e, 2 C_e n_r)

with the level of noise s_r^2 on the n_r lines about it, and as many independent elements C_e as their correlation
leaves; its probability is that of the largest of as many trials as there are lines.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from elastid.base.arrays import BoolArray, ComplexArray, FloatArray
from elastid.modal.basis import unstacked
from elastid.modal.model import ModalFit


@dataclass(frozen=True)
class SelectionLimits:
    """Thresholds of a mode.  Records of noise with a mode, scripts/studies/modes.py: see there."""

    records_with_false_modes: float = 0.002  # among records of noise, before the judgement of damping
    trials_per_line: float = 2.0
    lines: int = 12  # to either side of a pole at least, on which the level of noise is measured
    half_widths: float = 3.0  # likewise
    max_poles: int = 60
    new_share: float = 1e-4  # of a candidate's columns that must be new to the model
    batch_half_widths: float = 6.0  # between candidates that are taken together


LIMITS = SelectionLimits()


@dataclass(frozen=True)
class Noise:
    """elements: C_e, independent ones among C.  lines: over which errors are correlated."""

    elements: float
    correlated_lines: float

    @classmethod
    def of(cls, differences: ComplexArray, correlated_lines: float) -> Noise:
        """By normalised differences (n, C) of neighbouring lines, those of peaks clipped."""
        size = np.abs(differences)
        clipped = differences * np.minimum(1.0, 2.0 / np.maximum(size, 1e-300))
        clipped = clipped / np.sqrt(np.mean(np.abs(clipped) ** 2, axis=0) + 1e-300)
        n, C = clipped.shape
        squares = float(np.sum(np.abs(clipped.conj().T @ clipped / n) ** 2)) - C * (C - 1) / n
        return cls(float(np.clip(C**2 / max(squares, C), 1.0, C)), correlated_lines)


def p_value(drop: float, C: int, level: float, lines: float, noise: Noise, trials: float) -> float:
    """The probability that noise has a pole with such a drop D of squares somewhere; level: s_r^2, C: elements."""
    from scipy.special import fdtrc

    ratio = drop / C / noise.correlated_lines / max(level, 1e-300)
    C_e = noise.elements
    # The pole itself has been searched for: one complex number more.
    tail = float(fdtrc(2 * C_e + 2, max(2 * C_e * lines, 2.0), ratio * C_e / (C_e + 1)))
    return min(1.0, tail * trials)


def drops(fit: ModalFit, candidates: ComplexArray) -> FloatArray:
    """D (n,) of each candidate by itself."""
    columns = fit.data.columns(candidates)
    norms = np.linalg.norm(columns, axis=0)
    columns = columns / norms
    free = columns - fit.Q @ (fit.Q.T @ columns)
    inside = (free.T @ fit.residual).reshape(len(candidates), 2, -1)
    pairs = free.reshape(len(free), -1, 2)
    gram = np.einsum("fri,frj->rij", pairs, pairs)
    is_new = np.linalg.eigvalsh(gram)[:, 0] > LIMITS.new_share**2
    gram[~is_new] = np.eye(2)
    found = np.einsum("ric,rij,rjc->r", inside, np.linalg.inv(gram), inside, optimize=True)
    return np.where(is_new, found, 0.0)


def own_drops(fit: ModalFit) -> FloatArray:
    """D (n,) by which the squares grow without each pole, the others where they are."""
    n = len(fit.poles)
    _, R, norms = fit.factors
    inverse = np.linalg.pinv(R, rcond=1e-12)
    coefficients = (fit.coefficients * norms[:, None])[: 2 * n].reshape(n, 2, -1)
    rows = inverse[: 2 * n].reshape(n, 2, -1)
    covariance = np.einsum("rik,rjk->rij", rows, rows)
    inverse = np.linalg.pinv(covariance)
    return np.asarray(np.einsum("ric,rij,rjc->r", coefficients, inverse, coefficients, optimize=True))


def lone_shares(fit: ModalFit) -> FloatArray:
    """Share (n,) of the line with the most in the power of each pole by itself: near 1 for a pole on a single line."""
    n = len(fit.poles)
    Q, R, _ = fit.factors
    rows = np.linalg.pinv(R, rcond=1e-12)[: 2 * n]
    # The part of a pole's columns that the others do not have.
    free = unstacked(Q @ rows.T).reshape(-1, n, 2)
    power = np.sum(np.abs(free) ** 2, axis=2)
    return np.asarray(power.max(axis=0) / power.sum(axis=0))


def levels(fit: ModalFit) -> tuple[FloatArray, FloatArray]:
    """s^2 (n,) of complex residuals per element about each pole, at least 1, and the lines (n,) that it is from."""
    F, basis = len(fit.data.weight), fit.data.basis
    power = np.mean(np.abs(unstacked(fit.residual)) ** 2 / fit.data.variance, axis=1)
    leverage = np.sum(np.abs(unstacked(fit.Q)) ** 2, axis=1) / 2
    omega = basis.s.imag
    s_r, n_r = np.ones(len(fit.poles)), np.zeros(len(fit.poles))
    for r, pole in enumerate(fit.poles):
        about = int(np.searchsorted(omega, pole.imag))
        half = LIMITS.half_widths * -pole.real
        low = min(about - LIMITS.lines, int(np.searchsorted(omega, pole.imag - half)))
        high = max(about + LIMITS.lines, int(np.searchsorted(omega, pole.imag + half)))
        window = slice(max(0, min(low, F - 2 * LIMITS.lines)), max(2 * LIMITS.lines, min(high, F)))
        free = max(float(np.sum(1 - leverage[window])), 1.0)
        s_r[r] = max(1.0, float(np.sum(power[window])) / free)
        n_r[r] = free
    return s_r, n_r


def p_values(fit: ModalFit, noise: Noise) -> FloatArray:
    """The probability (n,) of each pole by chance, somewhere in the record."""
    if not len(fit.poles):
        return np.empty(0)
    s_r, n_r = levels(fit)
    drop, C, trials = own_drops(fit), fit.data.y.shape[1], LIMITS.trials_per_line * len(fit.data.weight)
    limits = [p_value(float(d), C, float(s), float(n), noise, trials) for d, s, n in zip(drop, s_r, n_r, strict=True)]
    # An outlier is a pole on one line: without it, none is left.
    rest = drop * (1 - lone_shares(fit))
    others = [p_value(float(d), C, float(s), float(n), noise, 1.0) for d, s, n in zip(rest, s_r, n_r, strict=True)]
    return np.maximum(limits, others)


def pursued(fit: ModalFit, candidates: ComplexArray, noise: Noise) -> ModalFit:
    """The model with the candidates that lower its squares most, in turn, as long as noise would not."""
    trials = LIMITS.trials_per_line * len(fit.data.weight)
    C = fit.data.y.shape[1]
    while len(candidates) and len(fit.poles) < LIMITS.max_poles:
        drop = drops(fit, candidates)
        chance = np.array([p_value(float(d), C, 1.0, 1e9, noise, trials) for d in drop])
        good = chance < LIMITS.records_with_false_modes
        if not good.any():
            break
        candidates, drop = candidates[good], drop[good]
        taken: list[complex] = []
        for i in np.argsort(-drop):
            pole = candidates[i]
            gap = LIMITS.batch_half_widths
            # Weak ones next to strong ones may be errors of these, and wait until they are refined.
            if all(abs(pole.imag - other.imag) > gap * max(-pole.real, -other.real) for other in taken):
                taken.append(pole)
            if len(taken) >= max(1, len(drop) // 4):
                break
        candidates = np.array([pole for pole in candidates if pole not in taken], complex)
        fit = ModalFit(fit.data, np.concatenate([fit.poles, np.array(taken)])).refined(6, 1e-1)
    return fit.refined()


def eliminated(fit: ModalFit, noise: Noise) -> ModalFit:
    """The model without the poles that noise has by chance, the likeliest first."""
    while len(fit.poles):
        chance = p_values(fit, noise)
        worst = int(np.argmax(chance))
        if chance[worst] < LIMITS.records_with_false_modes:
            break
        fit = fit.without(worst).refined(8, 1e-2)
    return fit.refined(30, 1e-4)


def residual_peaks(fit: ModalFit, count: int = 6) -> ComplexArray:
    """Candidates at the highest peaks of what the model leaves, of several dampings."""
    from scipy.signal import find_peaks

    power = np.mean(np.abs(unstacked(fit.residual)) ** 2, axis=1)
    smooth = np.convolve(power, np.ones(3) / 3, "same")
    tops, _ = find_peaks(smooth)
    tops = tops[np.argsort(-smooth[tops])][:count]
    omega, spacing = fit.data.basis.s.imag, float(np.median(np.diff(fit.data.basis.s.imag)))
    return np.array([1j * omega[k] - width * spacing for k in tops for width in (0.7, 2.0, 6.0)], complex)


def inside(fit: ModalFit) -> BoolArray:
    """Flags (n,) of poles between the first and the last line."""
    omega = fit.data.basis.s.imag
    size = np.abs(fit.poles)
    return np.asarray((size > omega[0]) & (size < omega[-1]))
