r"""A modal model at given poles: its columns, all residues by least squares, Gauss-Newton on the poles.

Lines have one weight for all elements, elements one scale, so that one QR decomposition serves all of them:

.. math:: \min_{\lambda} \sum_c \| P^\perp(\lambda)\, y_c \|^2, \qquad
          J_{c, r} = P^\perp D_r\, b_{c, r}, \qquad P^\perp = I - Q Q^T

D_r: the derivatives of a pole's two real columns, b: their coefficients, by the residue of the element c.
(Golub and Pereyra, SIAM J. Numer. Anal. 10, 1973; Kaufman, BIT 15, 1975.)

Columns of a modal model along frequency: poles and the residuals of modes outside the band.

.. math:: G(s) = \sum_r \left( \frac{R_r}{s - \lambda_r} + \frac{\bar R_r}{s - \bar\lambda_r} \right)
          + \sum_p C_p\, s^{k+p}, \quad s = j\omega,\ p = -2, -1, 0, 1, 2

k: 0, 1, 2 for position, velocity, acceleration, so that p = -2 is the lower residual (a mass), p = 0 the upper one (a
compliance) and the others are their next terms.  A response by Welch's method is smoothed by the window of segments,

.. math:: \frac{1}{s - \lambda} \to \int_0^T \rho_w(\tau)\, e^{(\lambda - j\omega) \tau} d\tau, \qquad
          \rho_w(\tau) = \frac{\int w(t)\, w(t + \tau)\, dt}{\int w^2(t)\, dt}

where the input is white within the width of a line; the smoothed columns have no leakage.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.linalg.blas import dgemm, dtrmm

from elastid.base.arrays import ComplexArray, FloatArray
from elastid.record import MOTION_ORDER
from elastid.response import Response

RESIDUALS = (-2, -1, 0, 1, 2)
ILL_CONDITIONED = 1e-5  # diagonal of L, below which rounding spoils Q


@dataclass(frozen=True)
class Basis:
    """Columns at freq_hz (F,) for responses in a quantity of order k; correlation (n,): rho_w at samples of a segment.

    scale: of frequency in rad/s, so that columns have size 1.
    """

    freq_hz: FloatArray
    order: int
    scale: float
    correlation: FloatArray | None = None
    segment_s: float = 0.0

    @classmethod
    def of(cls, response: Response) -> "Basis":
        """Return the columns for a response, smoothed where its segments had a window."""
        correlation = window_correlation(response) if response.window else None
        scale = 2 * np.pi * float(response.freq_hz[-1])
        return cls(response.freq_hz, MOTION_ORDER[response.quantity], scale, correlation, response.segment_s)

    @cached_property
    def omega(self) -> FloatArray:
        """Angular frequencies (F,) relative to the scale."""
        return 2 * np.pi * self.freq_hz / self.scale

    @cached_property
    def spacing(self) -> float:
        """Median distance of DFT lines, as angular frequency relative to the scale."""
        return float(np.median(np.diff(self.omega)))

    def poles(self, poles: ComplexArray, derivative: bool = False) -> tuple[FloatArray, FloatArray]:
        """Return real and imaginary parts (n, F) of 1 / (s - lambda), poles (n,) over the scale, or its derivative."""
        if self.correlation is None:
            offset = poles.imag[:, None] - self.omega
            size = poles.real[:, None] ** 2 + offset**2
            real, imag = -poles.real[:, None] / size, offset / size
            return (real**2 - imag**2, 2 * real * imag) if derivative else (real, imag)
        n, lines = len(self.correlation), np.round(self.freq_hz * self.segment_s).astype(int)
        step = self.scale * self.segment_s / n
        time = step * np.arange(n)
        decay = self.correlation * np.exp(poles[:, None] * time)
        decay[:, 0] /= 2  # trapezoidal rule
        # The discrete sum has aliases in contrast to a continuous pole; they are as smooth as the residual terms.
        columns = step * np.fft.fft(decay * time if derivative else decay)[:, lines % n]
        return columns.real, columns.imag

    def residuals(self) -> ComplexArray:
        """Return columns (F, 5) of the residuals."""
        s = 1j * self.omega / np.sqrt(self.omega[0] * self.omega[-1])
        return np.stack([s ** (self.order + p) for p in RESIDUALS], axis=1)


def window_correlation(response: Response) -> FloatArray:
    """Return rho_w (n,) over one segment, with at least two samples in a period of the highest line."""
    from scipy.signal import get_window

    n = 2 << int(np.ceil(np.log2(response.freq_hz[-1] * response.segment_s + 2)))
    w = np.asarray(get_window(response.window, n), dtype=float)
    correlation = np.fft.irfft(np.abs(np.fft.rfft(w, 2 * n)) ** 2)[:n]
    return np.asarray(correlation / correlation[0])


def stack_real(columns: ComplexArray) -> FloatArray:
    """Return real parts over imaginary parts (2 F, ...)."""
    return np.concatenate([columns.real, columns.imag], axis=0)


def complex_columns(columns: FloatArray) -> ComplexArray:
    """Return complex (F, ...) of real over imaginary parts."""
    real, imaginary = np.split(columns, 2)
    return real + 1j * imaginary


def tall_qr(A: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return Q (N, n) and R (n, n) with A = Q R of columns of size 1, by two Cholesky factorizations.

    By Householder reflections, which take ten times as long, where A is too ill-conditioned. Yamamoto, Nakatsukasa,
    Yanagisawa and Fukaya, Roundoff error analysis of the CholeskyQR2 algorithm, ETNA 44 (2015).
    """
    Q, R = A, np.eye(A.shape[1])
    for _ in range(2):
        try:
            L = np.linalg.cholesky(Q.T @ Q)
        except np.linalg.LinAlgError:
            return np.linalg.qr(A)
        if np.diag(L).min() < ILL_CONDITIONED:
            return np.linalg.qr(A)
        Q, R = dtrmm(1.0, np.linalg.inv(L), Q, 1, 1, 1, overwrite_b=Q is not A), L.T @ R
    return Q, R


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
    def of(cls, basis: Basis, G: ComplexArray, variance: FloatArray) -> "ModalData":
        """Weigh G by its variance (F, n_y, n_u), as real columns."""
        F = len(G)
        flat, log = G.reshape(F, -1), np.log(variance.reshape(F, -1))
        scale = np.exp(log.mean(axis=0) / 2)
        # Elements with little of a mode in them say little of the weight of a line.
        weight = np.exp(-(log - log.mean(axis=0)).mean(axis=1) / 2)
        y = stack_real(weight[:, None] * flat / scale)
        return cls(basis, y, scale, weight, np.exp(log) * (weight[:, None] / scale) ** 2)

    @cached_property
    def residuals(self) -> FloatArray:
        """Weighted columns (2 F, 5), real over imaginary parts, of the residuals."""
        return np.asfortranarray(stack_real(self.weight[:, None] * self.basis.residuals()))

    def columns(self, poles: ComplexArray, derivative: bool = False) -> FloatArray:
        """Return weighted columns (2 F, 2 n) of real and imaginary parts of each pole's residue, or slopes by the pole.

        Column 2 r belongs to Re R_r, column 2 r + 1 to Im R_r; derivatives are those by Re lambda.
        """
        F = len(self.weight)
        columns, step = np.empty((len(poles), 4, F)), 30_000 // F + 1  # poles, whose columns stay in the cache
        for i in range(0, len(poles), step):
            batch = poles[i : i + step]
            (a, b), (c, d) = (self.basis.poles(x, derivative) for x in (batch, batch.conj()))  # a + j b, c + j d
            parts = np.stack([a + c, b + d, d - b, a - c], axis=1)
            columns[i : i + step] = self.weight * parts
        return columns.reshape(2 * len(poles), 2 * F).T


@dataclass(frozen=True)
class ModalFit:
    """Poles (n,) over the scale of the basis, and all linear coefficients at them."""

    data: ModalData
    poles: ComplexArray

    @cached_property
    def factors(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Q, R and the norms of the columns: poles first, residuals last; columns without a part of their own go."""
        data = self.data
        A = np.concatenate([data.columns(self.poles), data.residuals], axis=1)
        norms = np.linalg.norm(A, axis=0)
        return *tall_qr(np.divide(A, norms, out=A)), norms

    @cached_property
    def Q(self) -> FloatArray:
        """Orthonormal columns (2 F, p)."""
        Q, R, _ = self.factors
        is_independent = np.abs(np.diag(R)) > 1e-10
        return Q if is_independent.all() else Q[:, is_independent]

    @cached_property
    def coefficients(self) -> FloatArray:
        """(p, C): two for each pole, then the residuals."""
        Q, R, norms = self.factors
        if self.Q is Q:
            return np.linalg.solve(R, Q.T @ self.data.y) / norms[:, None]
        return np.linalg.lstsq(R, Q.T @ self.data.y, rcond=1e-12)[0] / norms[:, None]

    @cached_property
    def residual(self) -> FloatArray:
        """y less the model (2 F, C)."""
        return self.data.y - self.Q @ (self.Q.T @ self.data.y)

    @cached_property
    def leverage(self) -> FloatArray:
        """Leverage (F,): fraction of the noise of a line that the fit absorbs."""
        return np.asarray(np.sum(np.abs(complex_columns(self.Q)) ** 2, axis=1) / 2)

    @cached_property
    def cost(self) -> float:
        """Sum of squares of the residual."""
        return float(np.vdot(self.residual, self.residual))

    @property
    def residues(self) -> ComplexArray:
        """R (n, C) in the elements' units times the frequency scale."""
        coefficients = self.coefficients[: 2 * len(self.poles)]
        return np.asarray((coefficients[0::2] + 1j * coefficients[1::2]) * self.data.scale)

    @cached_property
    def free_slopes(self) -> FloatArray:
        """P D (2 F, 2 n): derivatives of the columns that the model does not follow."""
        D = self.data.columns(self.poles, derivative=True)
        return np.asarray(dgemm(-1.0, self.Q, self.Q.T @ D, 1.0, D, overwrite_c=True))

    @cached_property
    def directions(self) -> FloatArray:
        """b (n, 2, 2, C): coefficients of a pole's two columns in D, for Re and Im lambda; the latter times j."""
        a = self.coefficients[: 2 * len(self.poles)].reshape(len(self.poles), 2, -1)
        return np.stack([a, np.stack([-a[:, 1], a[:, 0]], axis=1)], axis=1)

    @cached_property
    def information(self) -> FloatArray:
        """J^T J (2 n, 2 n) over all elements."""
        n = len(self.poles)
        inner = (self.free_slopes.T @ self.free_slopes).reshape(n, 2, n, 2)
        b = self.directions.reshape(4 * n, -1)
        blocks = (b @ b.T).reshape(n, 2, 2, n, 2, 2)
        return np.asarray(np.einsum("rpisqj,risj->rpsq", blocks, inner).reshape(2 * n, 2 * n))

    @property
    def gradient(self) -> FloatArray:
        """J^T residual (2 n,)."""
        n = len(self.poles)
        inner = (self.free_slopes.T @ self.residual).reshape(n, 2, -1)
        return np.asarray(np.einsum("rpic,ric->rp", self.directions, inner).reshape(2 * n))

    def refined(self, steps: int = 20, tolerance: float = 1e-3) -> "ModalFit":
        """Fit the poles by least squares with damped Gauss-Newton steps; tolerance in standard deviations."""
        fit, damping = self, 1e-3
        if not len(fit.poles):
            return fit
        for _ in range(steps):
            information, gradient = fit.information, fit.gradient
            # Of both numbers of a pole: by the frequency alone, one on the real axis has no information.
            pole_information = np.maximum(np.diag(information).reshape(-1, 2).sum(axis=1), 1e-200).repeat(2)
            while True:
                step = np.linalg.solve(information + damping * np.diag(pole_information), gradient)
                # A pole moves by its own half width at most, stays stable, and its frequency positive.
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
        return complex_columns(self.Q @ (self.Q.T @ self.data.y)) * self.data.scale / self.data.weight[:, None]
