r"""Variable projection: friction coefficients f for which G is the same in all realisations.

For each line, with the net torques U_n = U - Phi f and the projector Q that takes their span out of the K experiments,

.. math:: e = (U - G^{-1} Y)\, Q = \Phi Q\, f + noise, \qquad G = Y U_n^H (U_n U_n^H)^{-1}

G is eliminated by variable projection; since it depends on f, the regression is repeated. At lines without excitation,
the torque comes from feedback alone: G is interpolated, and Q = 1. Motors and their coefficients are the same in
all configurations. (Golub and Pereyra, SIAM J. Numer. Anal. 10, 1973; Kaufman, BIT 15, 1975.)
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from elastid.base.arrays import BoolArray, FloatArray, IntArray, mean_of_neighbours
from elastid.nonlinear.spectra import ConfigurationSpectra, compensation_torque

_BLOCKS = 5  # of lines, which replace realisations if there is only one


@dataclass(frozen=True)
class NormalEquations:
    """Sums over lines and configurations for each of M folds, weighted so that residuals about f have variance 1.

    A fold is a realisation, or a block of lines if there is one realisation.  A (M, n_f, n_f): X^H X.  b (M, n_f):
    X^H e.  c (M, n_m): e^H e.  amplitude (C, n_m): median over lines of |e - X f|, which sharp resonances hardly
    change.  dof_fraction: degrees of freedom of the residuals after the elimination of G, over their number.
    """

    A: FloatArray
    b: FloatArray
    c: FloatArray
    amplitude: FloatArray
    dof_fraction: float


def normal_equations(
    data: Sequence[ConfigurationSpectra], coefficients: FloatArray, motor_of: IntArray
) -> NormalEquations:
    """Sum the normal equations about coefficients (n_f,) of basis functions at motors motor_of (n_f,)."""
    n_m, n_f = data[0].U.shape[1], len(coefficients)
    realisations = np.unique(np.concatenate([spectra.realisation for spectra in data]))
    M = len(realisations) if len(realisations) > 1 else _BLOCKS
    A, b, c = np.zeros((M, n_f, n_f)), np.zeros((M, n_f)), np.zeros((M, n_m))
    amplitude, dof_fractions = np.zeros((len(data), n_m)), np.ones(len(data))
    for i, spectra in enumerate(data):
        e_c, X_c, counts = spectra.net(compensation_torque(coefficients, spectra.Phi, motor_of, n_m))
        excited, e_c = spectra.excited[counts], e_c[counts]
        dof_fractions[i] = 1 - n_m / spectra.U.shape[2] * excited.mean() if excited.size else 1.0
        fold = _folds(spectra, len(excited), realisations)
        for motor in range(n_m):
            group = np.flatnonzero(motor_of == motor)
            acting = group[coefficients[group] != 0]
            e, friction = e_c[:, motor], np.tensordot(coefficients[acting], X_c[np.ix_(counts, acting)], axes=(0, 1))
            power = np.mean(np.abs(e - friction) ** 2, axis=1)
            amplitude[i, motor] = np.sqrt(np.median(power)) if power.size else 0.0
            w = np.sqrt(weights(power, excited))[:, None]
            X = (w[:, None] * X_c[np.ix_(counts, group)]).swapaxes(0, 1).reshape(len(group), e.size)
            e = (w * e).ravel()
            for m in range(M):
                rows = np.flatnonzero(fold == m)
                # Real and imaginary parts side by side: X X^T is Re X^* X^T with a quarter of the work.
                e_m, X_m = e[rows].view(np.float64), np.take(X, rows, axis=1).view(np.float64)
                A[m][np.ix_(group, group)] += X_m @ X_m.T
                b[m, group] += X_m @ e_m
                c[m, motor] += float(e_m @ e_m)
    return NormalEquations(A, b, c, amplitude, float(dof_fractions.mean()))


def estimate_coefficients(
    data: Sequence[ConfigurationSpectra], motor_of: IntArray, iterations: int = 4
) -> tuple[FloatArray, NormalEquations]:
    """Estimate coefficients (n_f,) >= 0 of basis functions at motors motor_of (n_f,) by variable projection.

    iterations: each reduces the error of the coefficients by a factor of ten or more.
    """
    coefficients = np.zeros(len(motor_of))
    for _ in range(iterations):
        equations = normal_equations(data, coefficients, motor_of)
        A, pull = equations.A.sum(axis=0), equations.b.sum(axis=0)
        for group in (motor_of == motor for motor in np.unique(motor_of)):  # A is block diagonal in the motors
            coefficients[group] = solve(A[np.ix_(group, group)], pull[group])
    return coefficients, normal_equations(data, coefficients, motor_of)


def solve(A: FloatArray, b: FloatArray) -> FloatArray:
    """Return the f (n,) >= 0 that minimises f^T A f - 2 b^T f."""
    from scipy.optimize import nnls  # slow to load, for records without friction

    if not len(b):
        return b
    if len(b) == 1:
        return np.asarray(np.maximum(b, 0.0) / np.maximum(A[0], 1e-300))
    size = np.sqrt(np.maximum(A.diagonal(), 1e-300))
    power, V = np.linalg.eigh(A / (size[:, None] * size))
    root = np.sqrt(np.maximum(power, 0.0) + 1e-9)  # a small ridge: columns may be equal in the measured motion
    return np.asarray(nnls(root[:, None] * V.T, V.T @ (b / size) / root)[0] / size)


def inverse(A: FloatArray) -> FloatArray:
    """Return A^-1 (n, n) of a normal matrix of any units; 0 along unidentifiable directions."""
    size = np.sqrt(np.maximum(np.diag(A), 1e-300))
    return np.asarray(np.linalg.pinv(A / np.outer(size, size), rcond=1e-13, hermitian=True) / np.outer(size, size))


def cross_validated_power(
    A: FloatArray, b: FloatArray, c: FloatArray, solve: Callable[[FloatArray, FloatArray], FloatArray]
) -> float:
    """Sum the residual power of each fold at the solution of all other folds; A (M, n, n), b (M, n), c (M,)."""
    cost, total, pull = 0.0, A.sum(axis=0), b.sum(axis=0)
    for m in range(len(A)):
        f = solve(total - A[m], pull - b[m])
        cost += float(c[m] - 2 * b[m] @ f + f @ A[m] @ f)
    return cost


def _folds(data: ConfigurationSpectra, F: int, realisations: IntArray) -> IntArray:
    """Return the fold (F, K) of each residual at the F lines that constrain the coefficients."""
    K = data.U.shape[2]
    if len(realisations) > 1:
        return np.broadcast_to(np.searchsorted(realisations, data.realisation), (F, K))
    return np.broadcast_to((np.arange(F) * 4 * _BLOCKS // max(F, 1) % _BLOCKS)[:, None], (F, K))


def weights(power: FloatArray, excited: BoolArray) -> FloatArray:
    """Return 1 / power (F,) of the residuals, smoothed over neighbouring lines, excited or not."""
    smooth = np.empty_like(power)
    for kind in (excited, ~excited):
        if kind.any():
            smooth[kind] = mean_of_neighbours(power[kind])
    return np.asarray(1 / np.maximum(smooth, 1e-12 * smooth.max(initial=0.0) + 1e-300))


def residual_power(
    equations: NormalEquations, motor: int, members: IntArray,
    solver: Callable[[FloatArray, FloatArray], FloatArray] = solve
) -> float:  # fmt: skip
    """Return the cross-validated residual power of a motor with the basis functions of indices `members`."""
    A, b = equations.A[:, members[:, None], members], equations.b[:, members]
    return cross_validated_power(A, b, equations.c[:, motor], solver)


def residual_power_ratios(equations: NormalEquations, motors: int, motor_of: IntArray) -> FloatArray:
    """Return the cross-validated residual power ratio (n_m,) of the basis functions of each motor."""
    ratios = np.ones(motors)
    for motor in range(motors):
        rows = np.flatnonzero(motor_of == motor)
        if (total := residual_power(equations, motor, rows[:0])) > 0:
            ratios[motor] = residual_power(equations, motor, rows) / total
    return ratios
