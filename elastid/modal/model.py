r"""Fit of poles to a response: residues by linear least squares, poles by damped Gauss-Newton steps.

Lines have one weight for all elements, elements one scale, so that one QR decomposition serves all of them:

.. math:: \min_{\lambda} \sum_c \| P^\perp(\lambda)\, y_c \|^2, \qquad
          J_{c, r} = P^\perp D_r\, b_{c, r}, \qquad P^\perp = I - Q Q^T

D_r: derivatives of the two real columns of a pole; b: their coefficients, by the residue of the element c.
Corrected seminormal equations replace Q unless A is ill-conditioned.  (Golub and Pereyra, SIAM J. Numer. Anal. 10,
1973; Kaufman, BIT 15, 1975; Bjorck, Linear Algebra Appl. 88, 1987.)
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.linalg import cho_solve, lstsq, solve_triangular
from scipy.linalg.blas import dtrmm
from scipy.linalg.lapack import dpotrf

from elastid.base.arrays import ComplexArray, FloatArray
from elastid.modal.basis import Basis

ILL_CONDITIONED = 1e-5  # least diagonal of L for an orthogonal Q


def stack_real(columns: ComplexArray) -> FloatArray:
    """Return real parts above imaginary parts (2 F, ...) of columns (F, ...)."""
    return np.concatenate([columns.real, columns.imag])


def complex_columns(columns: FloatArray) -> ComplexArray:
    """Return complex columns (F, ...) from real parts above imaginary parts (2 F, ...)."""
    real, imaginary = np.split(columns, 2)
    return real + 1j * imaginary


def cholesky_factor(A: FloatArray, least: float) -> FloatArray | None:
    """Return L (n, n) of A^T A = L L^T; None if a diagonal entry is below the least."""
    L, failure = dpotrf(A.T @ A, lower=True)
    return None if failure or np.diag(L).min() < least else L


def tall_qr(A: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Factorise A (N, n) with columns of size 1 into Q (N, n) and R (n, n) by two Cholesky factorisations.

    An ill-conditioned A is factorised by Householder reflections, which take ten times as long.
    (Yamamoto, Nakatsukasa, Yanagisawa and Fukaya, ETNA 44, 2015: CholeskyQR2.)
    """
    Q, R = A, np.eye(A.shape[1])
    for _ in range(2):
        if (L := cholesky_factor(Q, ILL_CONDITIONED)) is None:
            return np.linalg.qr(A)
        Q, R = dtrmm(1.0, np.linalg.inv(L), Q, 1, 1, 1, overwrite_b=Q is not A), L.T @ R
    return Q, R


@dataclass(frozen=True)
class ModalData:
    """Weighted response: C elements as columns y (2 F, C), real above imaginary parts; y = weight G / scale.

    scale (C,): of the elements.  weight (F,): of the lines, so that a mean line and element have unit variance.
    variance (F, C): of the complex numbers in y.
    """

    basis: Basis
    y: FloatArray
    scale: FloatArray
    weight: FloatArray
    variance: FloatArray

    @classmethod
    def of(cls, basis: Basis, G: ComplexArray, variance: FloatArray) -> "ModalData":
        """Weigh G (F, n_y, n_u) by its variance (F, n_y, n_u)."""
        F = len(G)
        flat, log = G.reshape(F, -1), np.log(variance.reshape(F, -1))
        scale = np.exp(log.mean(axis=0) / 2)
        # A mean of logarithms: elements near a node of a mode hardly change the weight of its lines.
        weight = np.exp(-(log - log.mean(axis=0)).mean(axis=1) / 2)
        y = stack_real(weight[:, None] * flat / scale)
        return cls(basis, y, scale, weight, np.exp(log) * (weight[:, None] / scale) ** 2)

    @cached_property
    def residuals(self) -> FloatArray:
        """Weighted columns (2 F, 5) of the residual terms, real above imaginary parts."""
        return np.asfortranarray(stack_real(self.weight[:, None] * self.basis.residuals()))

    def columns(self, poles: ComplexArray, derivative: bool = False) -> FloatArray:
        """Return weighted columns (2 F, 2 n) of the poles (n,), or their derivatives by Re lambda.

        Column 2 r belongs to Re R_r, column 2 r + 1 to Im R_r.
        """
        F = len(self.weight)
        columns, step = np.empty((len(poles), 4, F)), 30_000 // F + 1  # a batch of poles whose columns fit in the cache
        for i in range(0, len(poles), step):
            batch = poles[i : i + step]
            (a, b), (c, d) = (self.basis.poles(x, derivative) for x in (batch, batch.conj()))  # a + j b, c + j d
            columns[i : i + step] = self.weight * np.stack([a + c, b + d, d - b, a - c], axis=1)
        return columns.reshape(2 * len(poles), 2 * F).T


@dataclass(frozen=True)
class ModalFit:
    """Fit at fixed poles (n,), which are relative to the frequency scale, and its derivatives by the poles."""

    data: ModalData
    poles: ComplexArray

    @cached_property
    def columns(self) -> tuple[FloatArray, FloatArray, FloatArray | None]:
        """Columns A (2 F, p) of size 1, first two a pole; norms (p,), and L of A^T A; None for ill-conditioned A."""
        A = np.concatenate([self.data.columns(self.poles), self.data.residuals], axis=1)
        norms = np.linalg.norm(A, axis=0)
        A /= norms
        return A, norms, cholesky_factor(A, np.sqrt(ILL_CONDITIONED))

    @cached_property
    def factors(self) -> tuple[FloatArray, FloatArray]:
        """Q (2 F, p) and R (p, p) of the columns of size 1."""
        return tall_qr(self.columns[0])

    @cached_property
    def Q(self) -> FloatArray:
        """Orthonormal columns (2 F, rank); dependent columns are dropped."""
        Q, R = self.factors
        is_independent = np.abs(np.diag(R)) > 1e-10
        return Q if is_independent.all() else Q[:, is_independent]

    @cached_property
    def solution(self) -> tuple[FloatArray, FloatArray]:
        """Linear coefficients (p, C) of the columns of size 1, and residual (2 F, C), by seminormal equations."""
        (A, _, L), residual = self.columns, self.data.y
        if L is None:
            Q, R = self.factors
            return lstsq(R, Q.T @ residual, 1e-12)[0], residual - self.Q @ (self.Q.T @ residual)
        coefficients = np.zeros((A.shape[1], 1))
        for _ in range(2):
            correction = cho_solve((L, True), A.T @ residual)
            coefficients, residual = coefficients + correction, residual - A @ correction
        return coefficients, residual

    @property
    def residual(self) -> FloatArray:
        """Residual (2 F, C): y minus the model."""
        return self.solution[1]

    @cached_property
    def leverage(self) -> FloatArray:
        """Leverage (F,): fraction of a line's noise that the fit absorbs."""
        return np.asarray(np.sum(np.abs(complex_columns(self.Q)) ** 2, axis=1) / 2)

    @cached_property
    def cost(self) -> float:
        """Sum of squares of the residual."""
        return float(np.vdot(self.residual, self.residual))

    @property
    def residues(self) -> ComplexArray:
        """Residues R (n, C) over the frequency scale, in the elements' units."""
        real, imaginary = self.directions[:, 0].swapaxes(0, 1)
        return np.asarray((real + 1j * imaginary) * self.data.scale)

    @cached_property
    def slopes(self) -> FloatArray:
        """Derivatives D (2 F, 2 n) of the poles' columns."""
        return self.data.columns(self.poles, derivative=True)

    @cached_property
    def free_slopes(self) -> ComplexArray:
        """Complex derivatives P D (F, 2 n), orthogonal to the model."""
        return complex_columns(self.slopes - self.Q @ (self.Q.T @ self.slopes))

    @cached_property
    def directions(self) -> FloatArray:
        """Coefficients b (n, 2, 2, C) of a pole's two columns in D for Re lambda, and for Im lambda (times j)."""
        a = (self.solution[0] / self.columns[1][:, None])[: 2 * len(self.poles)].reshape(len(self.poles), 2, -1)
        return np.stack([a, np.stack([-a[:, 1], a[:, 0]], axis=1)], axis=1)

    @cached_property
    def normal_equations(self) -> tuple[FloatArray, FloatArray]:
        """Information matrix J^T J (2 n, 2 n), and descent direction J^T residual (2 n,), sums over all elements."""
        n, D, (A, _, L) = len(self.poles), self.slopes, self.columns
        of_model = self.Q.T @ D if L is None else solve_triangular(L, A.T @ D, lower=True)
        inner, b = (D.T @ D - of_model.T @ of_model).reshape(n, 2, n, 2), self.directions.reshape(4 * n, -1)
        blocks = (b @ b.T).reshape(n, 2, 2, n, 2, 2)
        gradient = np.einsum("rpic,ric->rp", self.directions, (D.T @ self.residual).reshape(n, 2, -1))
        return np.einsum("rpisqj,risj->rpsq", blocks, inner).reshape(2 * n, 2 * n), gradient.ravel()

    def refined(self, steps: int = 20, tolerance: float = 1e-3) -> "ModalFit":
        """Fit the poles by at most `steps` damped Gauss-Newton steps; tolerance: last step, in standard deviations."""
        fit, damping = self, 1e-3
        if not len(fit.poles):
            return fit
        for _ in range(steps):
            information, gradient = fit.normal_equations
            # Damping by the sum for Re and Im: a pole on the real axis has no information about its frequency.
            pole_information = np.maximum(np.diag(information).reshape(-1, 2).sum(axis=1), 1e-200).repeat(2)
            while True:
                step = np.linalg.solve(information + damping * np.diag(pole_information), gradient)
                # A pole moves by at most its half width, stays stable, and keeps a positive frequency.
                change = step.view(complex)
                change = change / max(1.0, float(np.abs(change / fit.poles.real).max()))
                real = fit.poles.real * np.exp(change.real / fit.poles.real)
                trial = ModalFit(fit.data, real + 1j * np.abs(fit.poles.imag + change.imag))
                if trial.cost <= fit.cost:
                    damping = max(damping / 3, 1e-10)
                    break
                damping *= 10
                if damping > 1e6:
                    return fit
            gain = float(np.sqrt(max(float(step @ gradient), 0.0)))
            previous, fit = fit.cost, trial
            if gain < tolerance or previous - fit.cost < 1e-10 * previous:
                break
        return fit

    def without(self, r: int) -> "ModalFit":
        """Return the model without a pole."""
        return ModalFit(self.data, np.delete(self.poles, r))

    def synthesis(self) -> ComplexArray:
        """Return G (F, C) of the model."""
        return complex_columns(self.data.y - self.residual) * self.data.scale / self.data.weight[:, None]
