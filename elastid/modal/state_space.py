r"""A small stable state-space model of any frequency response: frequency-domain subspace identification.

.. math:: \dot x = A x + B u, \quad y = C x + D u, \qquad G(s) = C (s I - A)^{-1} B + D

Under the bilinear map :math:`z = (\alpha + s) / (\alpha - s)` the stacked response has the range of the observability
matrix,

.. math:: \begin{bmatrix} G \\ z G \\ \vdots \\ z^{q-1} G \end{bmatrix} = O X + \Gamma
          \begin{bmatrix} I \\ z I \\ \vdots \\ z^{q-1} I \end{bmatrix}, \qquad O = [C^T, (C A)^T, ...]^T

so that A and C follow from singular vectors, unstable poles are mirrored, and B and D are by weighted least squares.
The order is the lowest that predicts every second line, left out, about as well as any.  With one input
or one output the poles are refined by nonlinear least squares.

(McKelvey, Akcay and Ljung, IEEE Trans. Automatic Control 41, 1996.)
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from elastid.base.arrays import ComplexArray, FloatArray, frozen_value
from elastid.base.display import Display, as_html, as_text, percent
from elastid.base.errors import DataError, check_kind
from elastid.base.escape import control_label
from elastid.modal.model import stacked
from elastid.modal.noise import line_variance
from elastid.response import FrequencyResponse

MIN_LINES, MAX_ORDER = 16, 24
# Squares of left-out lines over the least of all orders, and over those of the lines themselves, that are as good.
PREDICTS, ROUNDING = 1.1, 1e-18


@frozen_value
class StateSpace:
    """A (n, n), B (n, n_u), C (n_y, n), D (n_y, n_u), SI, real; stable.

    error (F,): |G - model| over |G|, RMS over elements, at freq_hz (F,), and stated (F,): by the noise of G.
    """

    A: FloatArray
    B: FloatArray
    C: FloatArray
    D: FloatArray
    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    freq_hz: FloatArray
    error: FloatArray
    stated: FloatArray

    __repr__, _repr_html_ = as_text, as_html

    @property
    def display(self) -> Display:
        """Order, size and error."""
        n_y, n_u = self.D.shape
        title = f"StateSpace of {len(self.A)} states, {n_y} x {n_u}, {self.freq_hz[0]:.4g} to {self.freq_hz[-1]:.4g} Hz"
        rows = [(percent(float(np.median(self.error)), 2), percent(float(self.error.max()), 2))]
        return Display(title, ("median error of G", "largest"), rows)

    @property
    def poles(self) -> ComplexArray:
        """Eigenvalues (n,) of A, 1/s."""
        return np.asarray(np.linalg.eigvals(self.A), dtype=complex)

    def response(self, freq_hz: FloatArray) -> ComplexArray:
        """G (F, n_y, n_u) at freq_hz (F,)."""
        s = 2j * np.pi * np.asarray(freq_hz, float)
        return _states(self.A, self.C, s).transpose(0, 2, 1).conj() @ self.B + self.D

    def to_control(self) -> Any:
        """The model as `control.StateSpace`."""
        import control  # takes a second or two

        labels = {"inputs": [*map(control_label, self.inputs)], "outputs": [*map(control_label, self.outputs)]}
        return control.ss(self.A, self.B, self.C, self.D, **labels)


def _states(A: FloatArray, C: FloatArray, s: ComplexArray) -> ComplexArray:
    """(C (s I - A)^-1)^H (F, n, n_y)."""
    pencil = s[:, None, None] * np.eye(len(A)) - A
    return np.asarray(np.linalg.solve(pencil.conj().transpose(0, 2, 1), C.T[None]))


def fit_state_space(
    response: FrequencyResponse, order: int | None = None, band_hz: tuple[float, float] | None = None
) -> StateSpace:
    """A stable state-space model of a response on its lines, or those in band_hz.

    order: number of states; by default the lowest that predicts left-out lines about as well as any.

    DataError for fewer than 16 lines, ValueError for an order that so many lines do not determine.
    """
    check_kind(response, FrequencyResponse, "response", "FrequencyResponse.from_control(data, ...) makes one")
    keep = response.freq_hz > 0
    if band_hz is not None:
        keep &= (response.freq_hz >= band_hz[0]) & (response.freq_hz <= band_hz[1])
    response = response.lines(keep)
    if response.n_lines < MIN_LINES:
        raise DataError(
            "modal/lines", f"{response.n_lines} lines above 0 Hz are too few; take {MIN_LINES} or more, or a wider band"
        )
    most = min(MAX_ORDER, response.n_lines // 4)
    if order is not None and not 1 <= order <= most:
        raise ValueError(f"order is {order}; {response.n_lines} lines determine orders of 1 to {most}")
    fit = _Fit.of(response, most)
    A, C = fit.observed(_predicting_order(response, most) if order is None else order)
    if 1 in response.G.shape[1:]:
        A, C = fit.refined(A, C)
    B, D, model = fit.driven(A, C)
    power = np.maximum(np.mean(np.abs(response.G) ** 2, axis=(1, 2)), np.finfo(float).tiny)
    error = np.sqrt(np.mean(np.abs(response.G - model) ** 2, axis=(1, 2)) / power)
    stated = np.sqrt(np.mean(fit.variance, axis=(1, 2)) / power)
    alpha, names = fit.alpha, (response.inputs, response.outputs)
    return StateSpace(A * alpha, B * alpha, C, D, *names, response.freq_hz, error, stated)


def _predicting_order(response: FrequencyResponse, most: int) -> int:
    """By models of every second line and their errors on the others."""
    is_used = np.arange(response.n_lines) % 2 == 0
    half, others = _Fit.of(response.lines(is_used), min(most, int(is_used.sum()) // 4)), response.lines(~is_used)
    s, variance = np.asarray(2j * np.pi * others.freq_hz / half.alpha), line_variance(others)
    costs = []
    for n in range(1, max(2, min(most, int(is_used.sum()) // 4) + 1)):
        A, C = half.observed(n)
        B, D, _ = half.driven(A, C)
        error = _states(A, C, s).transpose(0, 2, 1).conj() @ B + D - others.G
        costs.append(float(np.sum(np.abs(error) ** 2 / variance)))
    floor = ROUNDING * float(np.sum(np.abs(others.G) ** 2 / variance))
    return 1 + int(np.flatnonzero(np.array(costs) <= PREDICTS * min(costs) + floor)[0])


@dataclass(frozen=True)
class _Fit:
    """A response at s (F,) over alpha, and singular vectors U (q n_y, .) of its stacked powers."""

    s: ComplexArray
    alpha: float
    G: ComplexArray
    variance: FloatArray
    U: FloatArray

    @classmethod
    def of(cls, response: FrequencyResponse, most: int) -> _Fit:
        """With the map's middle at the middle of the band on a logarithmic scale."""
        G, omega = response.G, 2 * np.pi * response.freq_hz
        variance = line_variance(response)
        alpha = float(np.sqrt(omega[0] * omega[-1]))
        s = np.asarray(1j * omega / alpha)
        F, n_y, n_u = G.shape
        q = min(2 * most, max(2, F // 2)) + 1
        powers = ((1 + s) / (1 - s))[:, None] ** np.arange(q)
        # Rows of the stacked matrices, (q n_y, F n_u), weighted by the noise of each line.
        weight = 1 / np.sqrt(variance.mean(axis=(1, 2)))
        weight /= weight.max()
        stacked_G = np.einsum("f,fq,fyu->qyfu", weight, powers, G).reshape(q * n_y, F * n_u)
        stacked_U = np.einsum("f,fq,uv->qufv", weight, powers, np.eye(n_u)).reshape(q * n_u, F * n_u)
        R = np.linalg.qr(np.concatenate([stacked(stacked_U.T), stacked(stacked_G.T)], axis=1), mode="r")
        own = np.asarray(R)[q * n_u :, q * n_u :].T
        U, _, _ = np.linalg.svd(own)
        return cls(s, alpha, G, variance, U)

    def observed(self, n: int) -> tuple[FloatArray, FloatArray]:
        """A (n, n), over alpha, and C (n_y, n), continuous and stable."""
        n_y, observability = self.G.shape[1], self.U[:, :n]
        A_z = np.linalg.lstsq(observability[:-n_y], observability[n_y:], rcond=None)[0]
        C_z = observability[:n_y]
        # s = (z - 1) / (z + 1): the states' C of the bilinear map.
        inverse = np.linalg.pinv(np.eye(n) + A_z)
        A, C = inverse @ (A_z - np.eye(n)), np.sqrt(2) * C_z @ inverse
        values, vectors = np.linalg.eig(A)
        stable = -np.maximum(np.abs(values.real), 1e-9 * np.abs(values)) + 1j * values.imag
        return np.real(vectors @ np.diag(stable) @ np.linalg.pinv(vectors)), C

    def driven(self, A: FloatArray, C: FloatArray) -> tuple[FloatArray, FloatArray, ComplexArray]:
        """B, D and the model (F, n_y, n_u) by least squares, each element by its noise."""
        F, n_y, n_u = self.G.shape
        n, states = len(A), _states(A, C, self.s).transpose(0, 2, 1).conj()
        columns = np.concatenate([states, np.broadcast_to(np.eye(n_y), (F, n_y, n_y))], axis=2)
        X = np.empty((n + n_y, n_u))
        for u in range(n_u):
            weight = 1 / np.sqrt(self.variance[:, :, u])
            rows = stacked((weight[:, :, None] * columns).reshape(F * n_y, -1))
            X[:, u] = np.linalg.lstsq(rows, stacked((weight * self.G[:, :, u]).ravel()), rcond=None)[0]
        return X[:n], X[n:], np.asarray(columns @ X)

    def refined(self, A: FloatArray, C: FloatArray) -> tuple[FloatArray, FloatArray]:
        """The poles by nonlinear least squares, of one input or output: all residues are then of rank 1."""
        from scipy.optimize import least_squares

        values = np.linalg.eigvals(A)
        real, pairs = values[values.imag == 0].real, values[values.imag > 0]
        start = np.concatenate([np.log(-real), np.log(-pairs.real), np.log(pairs.imag)])

        def poles(x: FloatArray) -> ComplexArray:
            a, b, c = np.split(x, [len(real), len(real) + len(pairs)])
            return np.concatenate([-np.exp(a), -np.exp(b) + 1j * np.exp(c)])

        weight = 1 / np.sqrt(self.variance.reshape(len(self.s), -1))
        y = stacked(weight * self.G.reshape(len(self.s), -1))
        rows = np.concatenate([weight, weight])

        def residual(x: FloatArray) -> FloatArray:
            own = 1 / (self.s[:, None] - poles(x))
            mirrored = 1 / (self.s[:, None] - poles(x)[len(real) :].conj())
            pair = own[:, len(real) :]
            parts = [own[:, : len(real)], pair + mirrored, 1j * (pair - mirrored), np.ones((len(self.s), 1))]
            columns = stacked(np.concatenate(parts, axis=1))
            left = []
            for w, target in zip(rows.T, y.T, strict=True):
                Q, _ = np.linalg.qr(w[:, None] * columns)
                left.append(target - Q @ (Q.T @ target))
            return np.concatenate(left)

        found = least_squares(residual, start, x_scale="jac", max_nfev=30).x
        return self._modal(poles(found), len(real))

    def _modal(self, poles: ComplexArray, n_real: int) -> tuple[FloatArray, FloatArray]:
        """A in blocks of the poles, and C by least squares through the dual: B of ones for one input."""
        n_y = self.G.shape[1]
        blocks = [np.array([[p.real]]) for p in poles[:n_real]]
        blocks += [np.array([[p.real, p.imag], [-p.imag, p.real]]) for p in poles[n_real:]]
        n = sum(map(len, blocks))
        A, ones = np.zeros((n, n)), np.zeros((n, 1))
        k = 0
        for block in blocks:
            A[k : k + len(block), k : k + len(block)] = block
            ones[k] = 1.0
            k += len(block)
        if n_y == 1:
            return A, ones.T
        # One input: the transposed problem has C for B.
        dual = _Fit(self.s, self.alpha, self.G.transpose(0, 2, 1), self.variance.transpose(0, 2, 1), self.U)
        C = np.stack([dual.single(j).driven(A.T, ones.T)[0][:, 0] for j in range(n_y)])
        return A, C

    def single(self, j: int) -> _Fit:
        """Of one input alone."""
        return _Fit(self.s, self.alpha, self.G[:, :, [j]], self.variance[:, :, [j]], self.U)
