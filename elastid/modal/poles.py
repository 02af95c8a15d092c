r"""Poly-reference least-squares complex frequency estimator (p-LSCF): poles over model orders.

A right matrix fraction with real coefficients along :math:`z = e^{-j\omega\Delta t}`,

.. math:: G_o(\omega) = B_o(z)\, A(z)^{-1}, \quad A = \sum_{r=0}^{n} z^r \alpha_r\ (n_u \times n_u), \quad
          M = \sum_o T_o - S_o^T R_o^{-1} S_o, \quad M \alpha = 0,\ \alpha_n = I

with the numerators eliminated.  Roots of det A are poles :math:`\lambda = -\ln(z) / \Delta t`; with the highest
coefficient fixed, poles of noise are mostly unstable and are dropped.
(Peeters, Van der Auweraer, Guillaume and Leuridan, Shock and Vibration 11, 2004; Cauberghe, Guillaume, Verboven,
Vanlanduit and Parloo, Mechanical Systems and Signal Processing 19, 2005.)
"""

from dataclasses import dataclass

import numpy as np
import scipy.linalg

from elastid.base.arrays import BoolArray, ComplexArray, FloatArray, IntArray, frozen_value

# The highest line over half the rate of z, so that the model can have poles slightly above the band.
HIGHEST = 0.9
# Largest eigenvalue problem: n n_u rows.
MAX_ROWS = 160


@frozen_value
class StabilisationDiagram:
    """Poles (n,) of all orders.  A stable pole is also a pole of the previous order."""

    order: IntArray
    freq_hz: FloatArray
    zeta: FloatArray
    stable: BoolArray


@dataclass(frozen=True)
class PoleLimits:
    """Limits of poles that are compared from order to order."""

    frequency: float = 0.01  # relative change of a stable pole
    damping: float = 0.05  # relative change of a stable pole's damping ratio
    max_damping: float = 0.35  # damping ratio of a pole and of a mode
    distance: float = 0.5  # of poles in one cluster, in half widths -Re lambda
    min_orders: int = 3  # of a cluster


LIMITS = PoleLimits()


def poles_over_orders(
    freq_hz: FloatArray, G: ComplexArray, weights: FloatArray, max_order: int
) -> tuple[tuple[int, ComplexArray], ...]:
    """Return (order, poles (n,) in 1/s with positive frequency) of each order; G (F, n_y, n_u), weights (F,)."""
    n_y, n_u = G.shape[1:]
    max_order = max(2, min(max_order, MAX_ROWS // n_u, len(freq_hz) // 2))
    step_s = HIGHEST / (2 * freq_hz[-1])
    powers = np.exp(-2j * np.pi * freq_hz * step_s)[:, None] ** np.arange(max_order + 1)
    products = weights[:, None, None] ** 2 * np.einsum("fou,fov->fuv", G.conj(), G)
    R = scipy.linalg.toeplitz(((weights**2) @ powers).real)
    # sum_f w^2 z^(s-r) G_ov, blocks of r (numerator) and s, v (denominator); T likewise with the products.
    S = -_block_toeplitz(powers, weights[:, None, None] ** 2 * G).transpose(2, 0, 1, 3)  # (n_y, n+1, n+1, n_u)
    T = _block_toeplitz(powers, products).transpose(0, 2, 1, 3)  # (n+1, n_u, n+1, n_u)
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


def _block_toeplitz(powers: ComplexArray, G: ComplexArray) -> FloatArray:
    """Return Re sum_f z^(s-r) G (n+1, n+1, ...) in row r and column s; powers (F, n+1): z^k, G (F, ...)."""
    flat, n = G.reshape(len(G), -1), powers.shape[1]
    positive, negative = ((z.T @ flat).real.reshape(n, *G.shape[1:]) for z in (powers, powers.conj()))
    lag = np.arange(n)[None, :] - np.arange(n)[:, None]
    return np.asarray(np.where((lag >= 0)[:, :, None, None], positive[np.abs(lag)], negative[np.abs(lag)]))


def _roots(M: FloatArray, n_u: int, step_s: float) -> ComplexArray:
    """Return the stable poles (n,) in 1/s of M alpha = 0, alpha_n = I; M ((n+1) n_u, (n+1) n_u)."""
    # M of exact data is singular.
    regular = M[:-n_u, :-n_u] + max(1e-15 * np.trace(M), 1e-300) * np.eye(len(M) - n_u)
    alpha = np.linalg.solve(regular, -M[:-n_u, -n_u:])
    n = len(alpha) // n_u
    # z^n I + z^(n-1) alpha_(n-1) + ...
    companion = np.zeros((n * n_u, n * n_u))
    companion[:n_u] = -alpha.reshape(n, n_u, n_u)[::-1].transpose(2, 0, 1).reshape(n_u, n * n_u)
    companion[n_u:, :-n_u] = np.eye((n - 1) * n_u)
    z = np.linalg.eigvals(companion)
    z = z[(np.abs(z) > 1e-6) & (z.imag < 0)]
    poles = -np.log(z) / step_s
    return np.asarray(poles[(poles.real < 0) & (-poles.real < LIMITS.max_damping * np.abs(poles))])


def stabilisation(orders: tuple[tuple[int, ComplexArray], ...]) -> StabilisationDiagram:
    """Return all poles.  A stable one is within 1 % in frequency and 5 % in damping of a pole of the previous order."""
    columns, previous = [], np.empty((0, 2))
    for n, poles in orders:
        numbers = np.stack([np.abs(poles), -poles.real / np.abs(poles)], axis=1)
        gap = np.abs(numbers[:, None] - previous) / numbers[:, None]
        stable = np.any(np.all(gap < (LIMITS.frequency, LIMITS.damping), axis=2), axis=1)
        columns.append((np.full(len(poles), n), numbers[:, 0] / (2 * np.pi), numbers[:, 1], stable))
        previous = numbers
    return StabilisationDiagram(*map(np.concatenate, zip(*columns, strict=True)))


def clusters(orders: tuple[tuple[int, ComplexArray], ...]) -> ComplexArray:
    """Return the median (n,), 1/s, of each cluster of poles that several orders have in common."""
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
    common = [cluster for cluster in members if len(cluster) >= LIMITS.min_orders]
    return np.array([np.median(np.real(poles)) + 1j * np.median(np.imag(poles)) for poles in common], complex)
