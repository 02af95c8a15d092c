r"""A modal model at given poles, all residues by least squares, and Gauss-Newton on the poles (variable projection).

Lines have one weight for all elements, elements one scale, so that one QR decomposition serves all of them:

.. math:: \min_{\lambda} \sum_c \| P^\perp(\lambda)\, y_c \|^2, \qquad
          J_{c, r} = P^\perp D_r\, b_{c, r}, \qquad P^\perp = I - Q Q^T

D_r: the derivatives of a pole's two real columns, b: their coefficients, by the residue of the element c.
(Golub and Pereyra, SIAM J. Numer. Anal. 10, 1973; Kaufman, BIT 15, 1975.)
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy.linalg

from elastid.base.arrays import ComplexArray, FloatArray
from elastid.modal.basis import Basis, stacked, unstacked


@dataclass(frozen=True)
class ModalData:
    """Elements as columns y (2 F, C), real over imaginary parts, of unit variance for a mean line and element.

    scale (C,): of the elements; weight (F,): of lines, so that y = weight G / scale.  variance (F, C): of the complex
    numbers behind y.
    """

    basis: Basis
    y: FloatArray
    scale: FloatArray
    weight: FloatArray
    variance: FloatArray

    @classmethod
    def of(cls, basis: Basis, G: ComplexArray, variance: FloatArray) -> ModalData:
        """G and variance (F, n_y, n_u)."""
        F = len(G)
        flat, log = G.reshape(F, -1), np.log(variance.reshape(F, -1))
        scale = np.exp(log.mean(axis=0) / 2)
        # Elements with little of a mode in them say little of the weight of a line.
        weight = np.exp(-(log - log.mean(axis=0)).mean(axis=1) / 2)
        y = stacked(weight[:, None] * flat / scale)
        return cls(basis, y, scale, weight, np.exp(log) * (weight[:, None] / scale) ** 2)

    @property
    def weights(self) -> FloatArray:
        """Of the stacked rows (2 F,)."""
        return np.concatenate([self.weight, self.weight])

    def columns(self, poles: ComplexArray, derivative: bool = False) -> FloatArray:
        """Weighted real columns (2 F, 2 n)."""
        return np.asarray(self.weights[:, None] * self.basis.real_columns(poles, derivative))


def orthogonal(A: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Q and R of columns (m, p) by Cholesky factors twice, by reflections where columns are nearly dependent.

    Products of matrices are several times as fast as reflections and as exact up to a condition of 1e8 (Yamamoto,
    Nakatsukasa, Yanagisawa and Fukaya, Electronic Transactions on Numerical Analysis 44, 2015).
    """
    Q, R = A, np.eye(A.shape[1])
    for _ in range(2):
        try:
            factor = np.linalg.cholesky(Q.T @ Q).T
        except np.linalg.LinAlgError:
            return np.linalg.qr(A)
        if np.diag(factor).min() < 1e-4:
            return np.linalg.qr(A)
        Q, R = Q @ scipy.linalg.solve_triangular(factor, np.eye(len(factor))), factor @ R
    return Q, R


@dataclass(frozen=True)
class ModalFit:
    """Poles (n,) over the scale of the basis, and all linear coefficients at them."""

    data: ModalData
    poles: ComplexArray

    @cached_property
    def factors(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Q, R and the norms of the columns: poles first, residuals last; columns without a part of their own go."""
        data = self.data
        A = np.concatenate([data.columns(self.poles), data.weights[:, None] * data.basis.residuals()], axis=1)
        norms = np.linalg.norm(A, axis=0)
        return *orthogonal(A / norms), norms

    @cached_property
    def Q(self) -> FloatArray:
        """Orthonormal columns (2 F, p)."""
        Q, R, _ = self.factors
        kept = np.abs(np.diag(R)) > 1e-10
        return Q if kept.all() else Q[:, kept]

    @cached_property
    def coefficients(self) -> FloatArray:
        """(p, C): two for each pole, then the residuals."""
        Q, R, norms = self.factors
        kept = np.abs(np.diag(R)) > 1e-10
        inside = Q.T @ self.data.y
        if kept.all():
            return np.asarray(scipy.linalg.solve_triangular(R, inside) / norms[:, None])
        return np.asarray(np.linalg.lstsq(R, inside, rcond=1e-12)[0] / norms[:, None])

    @cached_property
    def residual(self) -> FloatArray:
        """y less the model (2 F, C)."""
        return np.asarray(self.data.y - self.Q @ (self.Q.T @ self.data.y))

    @cached_property
    def cost(self) -> float:
        """Sum of squares of the residual."""
        return float(np.vdot(self.residual, self.residual))

    @property
    def residues(self) -> ComplexArray:
        """R (n, C) in the elements' units times the frequency scale."""
        n = len(self.poles)
        own = self.coefficients[: 2 * n]
        return np.asarray((own[0::2] + 1j * own[1::2]) * self.data.scale)

    @cached_property
    def free_slopes(self) -> FloatArray:
        """P D (2 F, 2 n): derivatives of the columns that the model does not follow."""
        D = self.data.columns(self.poles, derivative=True)
        return np.asarray(D - self.Q @ (self.Q.T @ D))

    @cached_property
    def directions(self) -> FloatArray:
        """b (n, 2, 2, C): coefficients of a pole's two columns in D, for Re and Im lambda; the latter times j."""
        a = self.coefficients[: 2 * len(self.poles)].reshape(len(self.poles), 2, -1)
        return np.stack([a, np.stack([-a[:, 1], a[:, 0]], axis=1)], axis=1)

    @cached_property
    def information(self) -> FloatArray:
        """J^T J (2 n, 2 n) over all elements."""
        inner = self.free_slopes.T @ self.free_slopes
        n = len(self.poles)
        b = self.directions
        blocks = np.einsum("rpic,sqjc->rpisqj", b, b, optimize=True)
        inner = inner.reshape(n, 2, n, 2)
        return np.asarray(np.einsum("rpisqj,risj->rpsq", blocks, inner).reshape(2 * n, 2 * n))

    @property
    def gradient(self) -> FloatArray:
        """J^T residual (2 n,)."""
        n = len(self.poles)
        inner = (self.free_slopes.T @ self.residual).reshape(n, 2, -1)
        return np.asarray(np.einsum("rpic,ric->rp", self.directions, inner).reshape(2 * n))

    def stepped(self, step: FloatArray) -> ModalFit:
        """The model at other poles; unstable ones are mirrored, frequencies stay positive."""
        poles = self.poles + step[0::2] + 1j * step[1::2]
        poles = -np.abs(poles.real) + 1j * np.abs(poles.imag)
        return ModalFit(self.data, poles)

    def refined(self, steps: int = 20, tolerance: float = 1e-3) -> ModalFit:
        """At the poles with the least squares, by Levenberg's damped Gauss-Newton; tolerance in standard deviations."""
        fit, damping = self, 1e-6
        if not len(fit.poles):
            return fit
        for _ in range(steps):
            information, gradient = fit.information, fit.gradient
            diagonal = np.maximum(np.diag(information), 1e-300)
            while True:
                step = np.linalg.lstsq(information + damping * np.diag(diagonal), gradient, rcond=1e-14)[0]
                # A pole moves by its own half width at most.
                size = np.hypot(step[0::2], step[1::2]) / np.maximum(-fit.poles.real, 1e-12)
                trial = fit.stepped(np.asarray(step / max(1.0, float(size.max()))))
                if trial.cost <= fit.cost:
                    damping = max(damping / 10, 1e-10)
                    break
                damping *= 10
                if damping > 1e6:
                    return fit
            gain = float(np.sqrt(max(float(step @ gradient), 0.0)))
            previous, fit = fit.cost, trial
            if gain < tolerance or previous - fit.cost < 1e-10 * previous:
                break
        return fit

    def without(self, r: int) -> ModalFit:
        """The model without a pole."""
        return ModalFit(self.data, np.delete(self.poles, r))

    def synthesis(self) -> ComplexArray:
        """G (F, C) of the model."""
        model = self.Q @ (self.Q.T @ self.data.y)
        return np.asarray(unstacked(model) * self.data.scale / self.data.weight[:, None])
