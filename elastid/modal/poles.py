r"""Poly-reference least-squares complex frequency estimator (p-LSCF): poles over model orders.

A right matrix fraction with real coefficients along :math:`z = e^{-j\omega\Delta t}`,

.. math:: G_o(\omega) = B_o(z)\, A(z)^{-1}, \quad A = \sum_{r=0}^{n} z^r \alpha_r\ (n_u \times n_u), \quad
          M = \sum_o T_o - S_o^T R_o^{-1} S_o, \quad M \alpha = 0,\ \alpha_n = I

with the numerators eliminated.  Roots of det A are poles :math:`\lambda = -\ln(z) / \Delta t`; with the highest
coefficient fixed those of noise are mostly unstable and fall out.
(Peeters, Van der Auweraer, Guillaume and Leuridan, Shock and Vibration 11, 2004; Cauberghe, Guillaume, Verboven,
Vanlanduit and Parloo, Mechanical Systems and Signal Processing 19, 2005.)
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.linalg

from elastid.base.arrays import BoolArray, ComplexArray, FloatArray, IntArray, frozen_value

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
    """Of poles that are compared from order to order."""

    frequency: float = 0.01  # relative change of a stable one
    damping: float = 0.05
    max_damping: float = 0.35
    distance: float = 0.5  # of poles in one cluster, in half widths -Re lambda
    runs: int = 3  # orders that a cluster has at least


LIMITS = PoleLimits()


def poles_over_orders(
    freq_hz: FloatArray, G: ComplexArray, weights: FloatArray, max_order: int
) -> tuple[tuple[int, ComplexArray], ...]:
    """Poles (n,) in 1/s with positive frequency for each order; G (F, n_y, n_u), weights (F,) of its lines."""
    n_y, n_u = G.shape[1:]
    max_order = max(2, min(max_order, MAX_ROWS // n_u, len(freq_hz) // 2))
    step_s = HIGHEST / (2 * freq_hz[-1])
    z = np.exp(-2j * np.pi * freq_hz * step_s)
    powers = z[:, None] ** np.arange(max_order + 1)
    products = weights[:, None, None] ** 2 * np.einsum("fou,fov->fuv", G.conj(), G)
    R = _toeplitz(((weights**2) @ powers).real)
    # sum_f w^2 z^(s-r) G_ov, blocks of r (numerator) and s, v (denominator); likewise of products.
    weighted = weights[:, None, None] ** 2 * G
    S = _block_toeplitz(*_moments(powers, weighted))  # (n_y, n+1, n+1, n_u)
    T = _hermitian_toeplitz(*_moments(powers, products))  # (n+1, n_u, n+1, n_u)
    found = []
    for order in range(2, max_order + 1, 1 if max_order <= 30 else 2):
        n = order + 1
        M = T[:n, :, :n, :].reshape(n * n_u, n * n_u).copy()
        own = S[:, :n, :n].transpose(1, 0, 2, 3).reshape(n, n_y, n * n_u)
        factor = scipy.linalg.cho_factor(R[:n, :n] + 1e-12 * R[0, 0] * np.eye(n))
        solved = scipy.linalg.cho_solve(factor, own.reshape(n, -1)).reshape(own.shape)
        M -= np.tensordot(own, solved, axes=((0, 1), (0, 1)))
        found.append((order, _roots(M, n_u, step_s)))
    return tuple(found)


def _moments(powers: ComplexArray, G: ComplexArray) -> tuple[FloatArray, FloatArray]:
    """Real parts of sum_f z^k G and sum_f z^-k G, k = 0 .. n first."""
    flat = G.reshape(len(G), -1)
    ahead, back = powers.T @ flat, powers.conj().T @ flat
    shape = (powers.shape[1], *G.shape[1:])
    return ahead.real.reshape(shape), back.real.reshape(shape)


def _toeplitz(first: FloatArray) -> FloatArray:
    return np.asarray(scipy.linalg.toeplitz(first))


def _lags(n: int) -> tuple[IntArray, BoolArray]:
    lag = np.arange(n)[None, :] - np.arange(n)[:, None]
    return np.abs(lag), lag >= 0


def _block_toeplitz(ahead: FloatArray, back: FloatArray) -> FloatArray:
    """S (n_y, n+1, n+1, n_u): minus the moments at the lag s - r."""
    lag, positive = _lags(len(ahead))
    blocks = np.where(positive[:, :, None, None], ahead[lag], back[lag])
    return np.asarray(-blocks.transpose(2, 0, 1, 3))


def _hermitian_toeplitz(ahead: FloatArray, back: FloatArray) -> FloatArray:
    """T (n+1, n_u, n+1, n_u)."""
    lag, positive = _lags(len(ahead))
    blocks = np.where(positive[:, :, None, None], ahead[lag], back[lag])
    return np.asarray(blocks.transpose(0, 2, 1, 3))


def _roots(M: FloatArray, n_u: int, step_s: float) -> ComplexArray:
    """Stable poles of the least-squares denominator with alpha_n = I."""
    try:
        rest = np.linalg.lstsq(M[:-n_u, :-n_u], -M[:-n_u, -n_u:], rcond=1e-14)[0]
    except np.linalg.LinAlgError:
        return np.empty(0, complex)
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
    """All poles, stable where the order before has one within 1 % of its frequency and 5 % of its damping."""
    order, f, zeta, stable = [np.empty(0, int)], [np.empty(0)], [np.empty(0)], [np.empty(0, bool)]
    before = np.empty(0, complex)
    for n, poles in orders:
        size, damping = np.abs(poles), -poles.real / np.abs(poles)
        near = np.zeros(len(poles), bool)
        if len(before):
            f_gap = np.abs(size[:, None] - np.abs(before)) / size[:, None]
            own = -before.real / np.abs(before)
            z_gap = np.abs(damping[:, None] - own) / damping[:, None]
            near = np.any((f_gap < LIMITS.frequency) & (z_gap < LIMITS.damping), axis=1)
        order.append(np.full(len(poles), n))
        f.append(size / (2 * np.pi))
        zeta.append(damping)
        stable.append(near)
        before = poles
    return StabilisationDiagram(*(np.concatenate(each) for each in (order, f, zeta, stable)))


def clusters(orders: tuple[tuple[int, ComplexArray], ...]) -> tuple[ComplexArray, IntArray]:
    """Poles (n,) that orders have in common, the median of each cluster, and the number of orders (n,) that have it."""
    members: list[list[complex]] = []
    for _, poles in reversed(orders):
        last = np.array([cluster[-1] for cluster in members]) if members else np.empty(0, complex)
        taken = np.zeros(len(last), bool)
        for pole in poles[np.argsort(poles.imag)]:
            gap = np.abs(last - pole) / np.maximum(-pole.real, -last.real) + 10 * taken
            if len(last) and gap.min() < LIMITS.distance:
                members[int(np.argmin(gap))].append(complex(pole))
                taken[int(np.argmin(gap))] = True
            else:
                members.append([complex(pole)])
    kept = [cluster for cluster in members if len(cluster) >= LIMITS.runs]
    middle = [np.median(np.real(each)) + 1j * np.median(np.imag(each)) for each in kept]
    return np.array(middle, complex), np.array([len(each) for each in kept], int)
