r"""Poly-reference least-squares complex frequency estimator (p-LSCF): poles over model orders.

A right matrix fraction with real coefficients along :math:`z = e^{-j\omega\Delta t}`,

.. math:: G_o(\omega) = B_o(z)\, A(z)^{-1}, \quad A = \sum_{r=0}^{n} z^r \alpha_r\ (n_u \times n_u), \quad
          M = \sum_o T_o - S_o^T R_o^{-1} S_o, \quad M \alpha = 0,\ \alpha_n = I

with the numerators eliminated.  Roots of det A are poles :math:`\lambda = -\ln(z) / \Delta t`; with the highest
coefficient fixed those of noise are mostly unstable and fall out.
(Peeters, Van der Auweraer, Guillaume and Leuridan, Shock and Vibration 11, 2004; Cauberghe, Guillaume, Verboven,
Vanlanduit and Parloo, Mechanical Systems and Signal Processing 19, 2005.)

Choice of the poles that are modes: matching pursuit over stable poles, then backward elimination by F tests.

A pole is kept where its two real columns lower the weighted squares of some element by more than noise does by chance,

.. math:: D_{rc} = \| Q_r^T e_c \|^2, \qquad \frac{D_{rc}}{2 s_{rc}^2} \sim F(4, 2 n_r)

with the level of noise s_rc^2 of the element on the n_r lines about it, and four numbers that are searched for: residue
and pole.  Its probability is that of the largest of as many trials as there are lines and elements, whose noise may be
common: that of an input is, at a resonance.
"""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import scipy.linalg

from elastid.base.arrays import BoolArray, ComplexArray, FloatArray, IntArray, frozen_value
from elastid.modal.model import ModalFit, complex_columns, tall_qr

# The highest line over half the rate of z: poles somewhat above the band can be found.
HIGHEST = 0.9
# Eigenvalue problems of at most so many rows.
MAX_ROWS = 160


@frozen_value
class StabilisationDiagram:
    """Poles of all orders: order (n,), freq_hz (n,), zeta (n,), stable (n,) by the order before."""

    order: IntArray
    freq_hz: FloatArray
    zeta: FloatArray
    stable: BoolArray


@dataclass(frozen=True)
class PoleLimits:
    """Limits of poles that are compared from order to order, and thresholds of a mode.

    Of 144 records of noise none had a mode (`scripts/studies/modes.py`).
    """

    frequency: float = 0.01  # relative change of a stable one
    damping: float = 0.05
    max_damping: float = 0.35  # of a mode, too
    distance: float = 0.5  # of poles in one cluster, in half widths -Re lambda
    runs: int = 3  # orders that a cluster has at least
    records_with_false_modes: float = 0.002  # among records of noise, before the judgement of damping
    trials_per_line: float = 2.0
    lines: int = 12  # to either side of a pole at least, on which the level of noise is measured
    half_widths: float = 3.0  # likewise
    outside: float = 3e-3  # part of a narrow pole's D on the lines about the nearest four
    max_poles: int = 60
    min_independent_fraction: float = 1e-4  # of a candidate's columns that must be new to the model
    batch_half_widths: float = 6.0  # between candidates that are taken together


LIMITS = PoleLimits()


def poles_over_orders(
    freq_hz: FloatArray, G: ComplexArray, weights: FloatArray, max_order: int
) -> tuple[tuple[int, ComplexArray], ...]:
    """Return poles (n,) in 1/s with positive frequency for each order; G (F, n_y, n_u), weights (F,) of its lines."""
    n_y, n_u = G.shape[1:]
    max_order = max(2, min(max_order, MAX_ROWS // n_u, len(freq_hz) // 2))
    step_s = HIGHEST / (2 * freq_hz[-1])
    powers = np.exp(-2j * np.pi * freq_hz * step_s)[:, None] ** np.arange(max_order + 1)
    products = weights[:, None, None] ** 2 * np.einsum("fou,fov->fuv", G.conj(), G)
    R = scipy.linalg.toeplitz(((weights**2) @ powers).real)
    # sum_f w^2 z^(s-r) G_ov, blocks of r (numerator) and s, v (denominator); likewise of products.
    weighted = weights[:, None, None] ** 2 * G
    S = -_block_toeplitz(*_moments(powers, weighted)).transpose(2, 0, 1, 3)  # (n_y, n+1, n+1, n_u)
    T = _block_toeplitz(*_moments(powers, products)).transpose(0, 2, 1, 3)  # (n+1, n_u, n+1, n_u)
    roots = []
    for order in range(2, max_order + 1, 1 if max_order <= 30 else 2):
        n = order + 1
        M = T[:n, :, :n, :].reshape(n * n_u, n * n_u).copy()
        block = S[:, :n, :n].transpose(1, 0, 2, 3).reshape(n, n_y, n * n_u)
        factor = scipy.linalg.cho_factor(R[:n, :n] + 1e-12 * R[0, 0] * np.eye(n))
        solution = scipy.linalg.cho_solve(factor, block.reshape(n, -1)).reshape(block.shape)
        M -= np.tensordot(block, solution, axes=((0, 1), (0, 1)))
        roots.append((order, _roots(M, n_u, step_s)))
    return tuple(roots)


def _moments(powers: ComplexArray, G: ComplexArray) -> tuple[FloatArray, FloatArray]:
    """Return real parts of sum_f z^k G and sum_f z^-k G, k = 0 .. n first."""
    flat = G.reshape(len(G), -1)
    ahead, back = powers.T @ flat, powers.conj().T @ flat
    shape = (powers.shape[1], *G.shape[1:])
    return ahead.real.reshape(shape), back.real.reshape(shape)


def _block_toeplitz(ahead: FloatArray, back: FloatArray) -> FloatArray:
    """Return (n+1, n+1, ...): the moments at the lag s - r."""
    lag = np.arange(len(ahead))[None, :] - np.arange(len(ahead))[:, None]
    return np.asarray(np.where((lag >= 0)[:, :, None, None], ahead[np.abs(lag)], back[np.abs(lag)]))


def _roots(M: FloatArray, n_u: int, step_s: float) -> ComplexArray:
    # Of exact data M is singular.
    regular = M[:-n_u, :-n_u] + max(1e-15 * np.trace(M), 1e-300) * np.eye(len(M) - n_u)
    rest = np.linalg.solve(regular, -M[:-n_u, -n_u:])
    n = len(rest) // n_u
    # z^n I + z^(n-1) alpha_(n-1) + ...
    companion = np.zeros((n * n_u, n * n_u))
    companion[:n_u] = -rest.reshape(n, n_u, n_u)[::-1].transpose(2, 0, 1).reshape(n_u, n * n_u)
    companion[n_u:, :-n_u] = np.eye((n - 1) * n_u)
    z = np.linalg.eigvals(companion)
    z = z[(np.abs(z) > 1e-6) & (z.imag < 0)]
    poles = -np.log(z) / step_s
    return np.asarray(poles[(poles.real < 0) & (-poles.real < LIMITS.max_damping * np.abs(poles))])


def stabilisation(orders: tuple[tuple[int, ComplexArray], ...]) -> StabilisationDiagram:
    """Return all poles; stable: the previous order has one within 1 % of the frequency and 5 % of the damping ratio."""
    poles_of_orders, previous = [], np.empty((0, 2))
    for n, poles in orders:
        numbers = np.stack([np.abs(poles), -poles.real / np.abs(poles)], axis=1)
        gap = np.abs(numbers[:, None] - previous) / numbers[:, None]
        stable = np.any(np.all(gap < (LIMITS.frequency, LIMITS.damping), axis=2), axis=1)
        poles_of_orders.append((np.full(len(poles), n), numbers[:, 0] / (2 * np.pi), numbers[:, 1], stable))
        previous = numbers
    return StabilisationDiagram(*map(np.concatenate, zip(*poles_of_orders, strict=True)))


def clusters(orders: tuple[tuple[int, ComplexArray], ...]) -> ComplexArray:
    """Return poles (n,) that orders have in common, the median of each cluster."""
    members: list[list[complex]] = []
    for _, poles in reversed(orders):
        last = np.array([cluster[-1] for cluster in members]) if members else np.empty(0, complex)
        is_member = np.zeros(len(last), bool)
        for pole in poles[np.argsort(poles.imag)]:
            gap = np.abs(last - pole) / np.maximum(-pole.real, -last.real) + 10 * is_member
            if len(last) and gap.min() < LIMITS.distance:
                members[int(np.argmin(gap))].append(complex(pole))
                is_member[int(np.argmin(gap))] = True
            else:
                members.append([complex(pole)])
    large = [cluster for cluster in members if len(cluster) >= LIMITS.runs]
    return np.array([np.median(np.real(group)) + 1j * np.median(np.imag(group)) for group in large], complex)


def p_value(drops: FloatArray, noise_levels: FloatArray, lines: FloatArray, trials: float) -> FloatArray:
    """Return the probability (n,) that noise has a pole somewhere that lowers the squares so.

    drops (n, C): D of each element.  noise_levels: s^2 likewise, over correlated lines.  lines (n,): number of these.
    """
    from scipy.special import fdtrc

    ratio = (drops / np.maximum(noise_levels, 1e-300)).max(axis=1, initial=0.0) / 2
    return np.asarray(np.minimum(1.0, fdtrc(4.0, np.maximum(2 * lines, 2.0), ratio) * trials * drops.shape[1]))


def drops(fit: ModalFit, candidates: ComplexArray) -> FloatArray:
    """Return D (n, C) of each candidate by itself."""
    columns = fit.data.columns(candidates)
    columns = columns / np.linalg.norm(columns, axis=0)
    free = columns - fit.Q @ (fit.Q.T @ columns)
    inside = (free.T @ fit.residual).reshape(len(candidates), 2, -1)
    pairs = free.reshape(len(free), -1, 2)
    gram = np.einsum("fri,frj->rij", pairs, pairs)
    is_new = np.linalg.eigvalsh(gram)[:, 0] > LIMITS.min_independent_fraction**2
    gram[~is_new] = np.eye(2)
    residues = np.einsum("ric,rij,rjc->rc", inside, np.linalg.inv(gram), inside, optimize=True)
    return np.where(is_new[:, None], residues, 0.0)


def separate_determinations(fit: ModalFit) -> tuple[FloatArray, FloatArray]:
    """Return D (n, C) of each pole beside the others: on all lines, and without its highest line.

    Of a pole narrower than a line without the four nearest lines: a disturbance of three lines has no more.
    """
    n, omega, spacing = len(fit.poles), fit.data.basis.omega, fit.data.basis.spacing
    Q, R, norms = fit.factors
    rows = np.linalg.pinv(R, rcond=1e-12)[: 2 * n].reshape(n, 2, -1)
    # Q times these: part of each pole's columns orthogonal to all other columns.
    projections = np.linalg.pinv(rows @ rows.mT) @ rows
    total = np.sum((projections.mT @ (fit.coefficients * norms[:, None])[: 2 * n].reshape(n, 2, -1)) ** 2, axis=1)
    columns = complex_columns(Q @ projections.reshape(2 * n, -1).T).reshape(-1, n, 2)
    near = np.arange(len(omega)) == np.argmax(np.sum(np.abs(columns) ** 2, axis=2), axis=0)[:, None]
    about = np.zeros_like(near)
    for r in np.flatnonzero(-2 * fit.poles.real <= spacing).tolist():
        near[r], about[r] = np.abs(omega - fit.poles[r].imag) < 2 * spacing, _about(fit, r)
    # QR reduces the lines that no pole uses to as many rows as columns, with equal products.
    near, about = np.tile(near, 2), np.tile(about, 2)
    is_outside, Qy = ~np.any(near | about, axis=0), np.concatenate([Q, fit.data.y], axis=1)
    size = np.maximum(np.linalg.norm(Qy, axis=0), 1.0)
    T = tall_qr(Qy[is_outside] / size)[1] * size
    Q, all_y = np.split(np.concatenate([T, Qy[~is_outside]]), [Q.shape[1]], axis=1)
    near, about = (np.pad(flags[:, ~is_outside], ((0, 0), (len(T), 0))) for flags in (near, about))
    outside = np.zeros_like(total)
    for r in range(n):
        A = Q[~near[r]] @ np.concatenate([np.delete(R, [2 * r, 2 * r + 1], axis=1), R[:, 2 * r : 2 * r + 2]], axis=1)
        basis, y = tall_qr(A)[0], all_y[~near[r]]
        y = y - basis[:, :-2] @ (basis[:, :-2].T @ y)
        outside[r] = np.sum((basis[:, -2:].T @ y) ** 2, axis=0)
        if near[r].sum() > 2:
            at = about[r][~near[r]]
            local = np.sum((scipy.linalg.orth(basis[at, -2:]).T @ y[at]) ** 2)
            outside[r] *= local >= LIMITS.outside * total[r].sum()
    return total, outside


def _at(fit: ModalFit, pole: complex) -> FloatArray:
    """Return stated variance (C,) of weighted elements about a pole, the mean over the lines within its half width."""
    omega = fit.data.basis.omega
    low, high = np.searchsorted(omega, (pole.imag + pole.real, pole.imag - pole.real))
    low = min(int(low), len(omega) - 1)
    return np.asarray(fit.data.variance[max(low - 1, 0) : max(int(high), low) + 1].mean(axis=0))


def _about(fit: ModalFit, r: int) -> BoolArray:
    """Return flags (F,) of lines within three half widths of a pole, of twelve lines to either side at least."""
    omega, pole, F = fit.data.basis.omega, fit.poles[r], len(fit.data.weight)
    about, half = int(np.searchsorted(omega, pole.imag)), LIMITS.half_widths * -pole.real
    low = min(about - LIMITS.lines, int(np.searchsorted(omega, pole.imag - half)))
    high = max(about + LIMITS.lines, int(np.searchsorted(omega, pole.imag + half)))
    at = np.arange(F)
    return (at >= min(low, F - 2 * LIMITS.lines)) & (at < max(2 * LIMITS.lines, high))


def noise_levels(fit: ModalFit) -> tuple[FloatArray, FloatArray]:
    """Return s^2 (n, C) of complex residuals about each pole, at least as stated, and its number of lines (n,)."""
    variance, n = fit.data.variance, len(fit.poles)
    power = np.abs(complex_columns(fit.residual)) ** 2
    s_r, n_r = np.ones((n, power.shape[1])), np.zeros(n)
    for r, pole in enumerate(fit.poles):
        window = _about(fit, r)
        n_r[r] = max(float(np.sum(1 - fit.leverage[window])), 1.0)
        # Where lines differ in their noise, those at the pole count.
        s_r[r] = _at(fit, pole) * np.maximum(1.0, (power / variance)[window].sum(axis=0) / n_r[r])
    return s_r, n_r


def p_values(fit: ModalFit, correlated_lines: float) -> FloatArray:
    """Return the probability (n,) of each pole by chance, somewhere in the record."""
    if not len(fit.poles):
        return np.empty(0)
    s_r, n_r = noise_levels(fit)
    (total, outside), noise = separate_determinations(fit), s_r * correlated_lines
    return np.maximum(
        p_value(total, noise, n_r, LIMITS.trials_per_line * len(fit.data.weight)), p_value(outside, noise, n_r, 1.0)
    )


def pursue_poles(fit: ModalFit, candidates: ComplexArray, correlated_lines: float) -> ModalFit:
    """Return the model with those candidates (n,) that lower its squares most, in turn, and more than noise would."""
    trials = LIMITS.trials_per_line * len(fit.data.weight)
    while len(candidates) and len(fit.poles) < LIMITS.max_poles:
        drop = drops(fit, candidates)
        noise = correlated_lines * np.stack([_at(fit, pole) for pole in candidates])
        good = p_value(drop, noise, np.full(len(drop), 1e9), trials) < LIMITS.records_with_false_modes
        if not good.any():
            break
        candidates, drop = candidates[good], drop[good].sum(axis=1)
        neighbours: list[complex] = []
        gap = LIMITS.batch_half_widths
        for pole in candidates[np.argsort(-drop)]:
            # Weak ones next to strong ones may be errors of these, and wait until they are refined.
            if all(abs(pole.imag - near.imag) > gap * max(-pole.real, -near.real) for near in neighbours):
                neighbours.append(pole)
            if len(neighbours) >= max(1, len(drop) // 4):
                break
        candidates = np.array([pole for pole in candidates if pole not in neighbours], complex)
        fit = ModalFit(fit.data, np.concatenate([fit.poles, np.array(neighbours)])).refined(6, 1e-1)
    return fit.refined()


def eliminate_poles(fit: ModalFit, correlated_lines: float) -> ModalFit:
    """Return the model without the poles that noise has by chance, the likeliest first."""
    while len(fit.poles):
        chance = p_values(fit, correlated_lines)
        worst = int(np.argmax(chance))
        if chance[worst] < LIMITS.records_with_false_modes:
            break
        fit = fit.without(worst).refined(8, 1e-2)
    while (index := _unresolved_pole(fit)) is not None:
        fit = fit.without(index).refined(8, 1e-2)
    return fit.refined(30, 1e-4)


def _unresolved_pole(fit: ModalFit) -> int | None:
    """Return the weaker of two poles within a line that are narrower than lines: one mode, moved between references."""
    spacing, order = fit.data.basis.spacing, np.argsort(fit.poles.imag)
    for low, high in pairwise(order.tolist()):
        widths = -2 * fit.poles.real[[low, high]]
        if max(float(fit.poles.imag[high] - fit.poles.imag[low]), float(widths.max())) < spacing:
            drop = separate_determinations(fit)[0].sum(axis=1)
            return int(low if drop[low] < drop[high] else high)
    return None


def residual_peaks(fit: ModalFit) -> ComplexArray:
    """Return candidates (n,), rad/s, at the six highest residual peaks, each with three dampings."""
    smooth = np.convolve(np.mean(np.abs(complex_columns(fit.residual)) ** 2, axis=1), np.ones(3), "same")
    tops = np.flatnonzero((smooth[1:-1] > smooth[:-2]) & (smooth[1:-1] >= smooth[2:])) + 1
    tops = tops[np.argsort(-smooth[tops])][:6]
    omega, spacing = fit.data.basis.omega, fit.data.basis.spacing
    return np.array([1j * omega[k] - width * spacing for k in tops for width in (0.7, 2.0, 6.0)], complex)
