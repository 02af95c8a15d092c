r"""Local least squares at every line: a low-order rational model of response and transient in a window of bins.

.. math:: A_k(r) Z_e(k + r) = B_k(r) R_e(k + r) + T_{k,e}(r) + A_k(r) V_e(k + r), \quad A_k(0) = 1

B and T are polynomials in the offset r, with a separate T for each experiment e. A is a scalar polynomial common to all
outputs and experiments, which have the same poles (A = 1: the local polynomial method). Response and transient at the
line are B_k(0) and T_k(0). Rows are divided by |A| of the previous iteration (Sanathanan and Koerner): their noise is
then V instead of A V, which avoids the bias of the linear problem. (Pintelon, Schoukens, Vandersteen and Barbe, MSSP
24, 2010; McKelvey and Guerin, SYSID 2012, for the rational form.)

The window contains n_w available bins, centred at the line, and one-sided at the ends of the band. Offsets are relative
to the furthest bin, so that the regression is well conditioned.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, fields, replace

import numpy as np

from elastid.base.arrays import BoolArray, ComplexArray, FloatArray, IntArray, quotient

_BLOCK_NUMBERS = 4_000_000  # numbers in the arrays of one block of lines: 64 MB
_ORDER, _POLES = 2, 2  # degree of the numerator and denominator of a transient without response
_ROUNDING = 1e-11  # relative regularisation of A, above rounding errors
# Least dof ln(ratio of residual powers of the simpler and the richer model) in an output for the richer model. Noise
# alone exceeds it at one in 100 lines.
LOG_GAIN = 9.0


@dataclass(frozen=True)
class Windows:
    """Windows of F lines: index (F, n_w) into the available bins, offset (F, n_w) in [-1, 1], span (F,) in bins."""

    index: IntArray
    offset: FloatArray
    span: IntArray

    def on(self, lines: slice) -> "Windows":
        """Return the windows of some lines."""
        return Windows(self.index[lines], self.offset[lines], self.span[lines])


def windows(available: IntArray, lines: IntArray, n_w: int) -> Windows:
    """Return windows of n_w available bins (B,), increasing, around lines (F,), or windows of all bins.

    >>> windows(np.array([2, 4, 6, 8, 10]), np.array([2, 6]), 3).index.tolist()
    [[0, 1, 2], [1, 2, 3]]
    """
    n_w = min(n_w, len(available))
    index = np.clip(np.searchsorted(available, lines) - n_w // 2, 0, len(available) - n_w)[:, None] + np.arange(n_w)
    distance = available[index] - lines[:, None]
    return Windows(
        index=index,
        offset=distance / np.maximum(np.abs(distance).max(axis=1, keepdims=True), 1),
        span=(available[index[:, -1]] - available[index[:, 0]]).astype(np.int64),
    )


def window_power(R: ComplexArray, window: Windows) -> ComplexArray:
    """Return the mean over each window of the sum over experiments of R R^H (F, n_u, n_u), from R (E, B, n_u)."""
    n_w = window.index.shape[1]
    bins = np.einsum("ebu,ebv->buv", R, R.conj())
    # Without the last bin, because reduceat excludes the end, which can be the end of the array.
    sums = np.add.reduceat(bins, window.index[:, [0, -1]].ravel(), axis=0)[::2] if n_w > 1 else 0.0
    return np.asarray((sums + bins[window.index[:, -1]]) / n_w)


@dataclass(frozen=True)
class WindowTerms:
    r"""Terms of the fit in a window for n_u inputs: A(r) Z = B(r) R + T(r).

    order: degree of B and T.  poles: degree of A, 0 in the polynomial method.  transient: False without T.
    """

    n_u: int
    order: int
    poles: int
    transient: bool

    @property
    def columns(self) -> int:
        """Unknowns of B for each output."""
        return self.n_u * (self.order + 1)

    @property
    def transient_columns(self) -> int:
        """Unknowns of T for each output and experiment."""
        return self.order + 1 if self.transient else 0

    def degrees_of_freedom(self, n_w: int, experiments: int, n_z: int) -> float:
        """Return the complex degrees of freedom of each of n_z residuals, which share the unknowns of A."""
        return experiments * (n_w - self.transient_columns) - self.columns - self.poles / n_z

    def width(self, dof: float, experiments: int, n_z: int) -> int:
        """Return the smallest n_w with at least dof degrees of freedom and all unknowns of one element."""
        n_w = self.transient_columns + math.ceil((dof + self.columns + self.poles / n_z) / experiments - 1e-9)
        return max(n_w, self.order + self.poles + 1 + self.transient_columns)


@dataclass(frozen=True)
class LocalFit:
    r"""B(0) and T(0) at each line, the residual, and the factors of their covariance.

    B (F, n_z, n_u).  T (F, E, n_z), empty without transient.  scatter (F, n_z, n_z): sum of V V^H, with expectation
    dof C_V.  With input_factor L (F, n_u, n_u), M (F, d, n_z, n_u) = dB(0) / dA_p and A_cov (F, d, d) of A_1 ... A_d,

    .. math:: cov(vec\, B(0)) = L \otimes C_V + \sum_{pq} vec(M_p)\, A_{pq}\, vec(M_q)^H

    transient_factor (F, E): cov(T_e(0)) = T_left_e C_V.  condition (F,): of the regressors.
    """

    B: ComplexArray
    T: ComplexArray
    scatter: ComplexArray
    dof: float
    input_factor: ComplexArray
    M: ComplexArray
    A_cov: ComplexArray
    transient_factor: FloatArray
    condition: FloatArray


@dataclass(frozen=True)
class _Solution:
    """Weighted problem of the last iteration: regressors Q L, weighted Z and X = r^p Z, and a = A_1 ... A_d (f, d).

    Z (f, rows, n_z), X (f, d, rows, n_z).  V, V_X: their residuals.  scale (f, n_z): of outputs, for A.
    """

    Q: ComplexArray
    L: ComplexArray
    Z: ComplexArray
    X: ComplexArray
    V: ComplexArray
    V_X: ComplexArray
    a: ComplexArray
    scale: FloatArray


@dataclass(frozen=True)
class LadderFit:
    """Fit of the selected model at each line.

    models: fits of all models at all lines.  selected_index (F,): index of the selected model.  terms: of the last
    model, which determines the windows.
    """

    selected: LocalFit
    models: tuple[LocalFit, ...]
    selected_index: IntArray
    window: Windows
    terms: WindowTerms


_ARRAYS = tuple(field.name for field in fields(LocalFit) if field.name != "dof")


def fit_ladder(Z: ComplexArray, R: ComplexArray, window: Windows, ladder: Sequence[WindowTerms]) -> LadderFit:
    """Select a local model at every line, from Z (E, B, n_z) and the input R (E, B, n_u) at the available bins.

    ladder: models of increasing complexity. Each line has the first model, and a further one only if it reduces the
    residual of an output significantly (LOG_GAIN): poles fitted to noise make the residual too small, and unnecessary
    orders increase the variance.  dof of the selected fit: of the last model.
    """
    fits = tuple(_in_blocks(Z, R, window, terms) for terms in ladder)
    best, (dof, poles) = fits[0], (fits[-1].dof, ladder[-1].poles)
    power, selected = _power(best), np.zeros(len(window.index), np.int64)
    for i, fit in enumerate(fits[1:], 1):
        clear = np.max(fit.dof * np.log(power / _power(fit)), axis=1) > LOG_GAIN
        power, selected = np.where(clear[:, None], _power(fit), power), np.where(clear, i, selected)
        best = _select_fits(clear, _add_poles(fit, poles, dof), _add_poles(best, poles, dof))
    return LadderFit(best, fits, selected, window, ladder[-1])


def transient_half_width(n_y: int, n_z: int) -> int:
    """Return the half width in bins of the window of a transient, if half of the bins are unexcited."""
    return 2 * _transient_ladder()[-1].width(n_y + 5, 1, n_z) + 2


def fit_transient(Z: ComplexArray, transient_bins: IntArray, bins: IntArray, n_y: int) -> LocalFit | None:
    """Return T at bins (F,) from Z (B, n_z) at the unexcited bins (B,); None with too few unexcited bins."""
    if len(transient_bins) <= _ORDER + _POLES + 1:
        return None
    ladder = _transient_ladder()
    # n_y + 5 degrees of freedom for the noise estimate.
    window = windows(transient_bins, bins, ladder[-1].width(n_y + 5, 1, Z.shape[1]))
    return fit_ladder(Z[None], np.zeros((1, len(transient_bins), 0), np.complex128), window, ladder).selected


def _transient_ladder() -> tuple[WindowTerms, ...]:
    return tuple(WindowTerms(n_u=0, order=_ORDER, poles=poles, transient=True) for poles in (0, _POLES))


def _power(fit: LocalFit) -> FloatArray:
    """Return residual power (F, n_z) of each output."""
    return np.asarray(np.maximum(np.einsum("fzz->fz", fit.scatter).real, 1e-300) / fit.dof)


def _add_poles(fit: LocalFit, poles: int, dof: float) -> LocalFit:
    """Return the fit with arrays for `poles` poles, and scatter scaled to dof degrees of freedom."""
    n_more = poles - fit.M.shape[1]
    return replace(
        fit,
        M=np.pad(fit.M, ((0, 0), (0, n_more), (0, 0), (0, 0))),
        A_cov=np.pad(fit.A_cov, ((0, 0), (0, n_more), (0, n_more))),
        scatter=fit.scatter * (dof / fit.dof),
        dof=dof,
    )


def _select_fits(is_a: BoolArray, a: LocalFit, b: LocalFit) -> LocalFit:
    """Return fit a at the flagged lines (F,), fit b at the other lines."""
    arrays = {name: getattr(b, name).copy() for name in _ARRAYS}
    for name, array in arrays.items():
        array[is_a] = getattr(a, name)[is_a]
    return LocalFit(dof=a.dof, **arrays)


def _in_blocks(Z: ComplexArray, R: ComplexArray, window: Windows, terms: WindowTerms) -> LocalFit:
    E, _, n_z = Z.shape
    F, n_w = window.index.shape
    numbers = E * n_w * (terms.columns + E * terms.transient_columns + 2 * (terms.poles + 2) * n_z)
    step = max(1, _BLOCK_NUMBERS // numbers)
    fits = [fit_block(Z, R, window.on(slice(i, i + step)), terms) for i in range(0, F, step)]
    return LocalFit(dof=fits[0].dof, **{name: np.concatenate([getattr(fit, name) for fit in fits]) for name in _ARRAYS})


def fit_block(Z: ComplexArray, R: ComplexArray, window: Windows, terms: WindowTerms) -> LocalFit:
    """Fit one model at the lines of f windows, from Z (E, B, n_z) and R (E, B, n_u) at the available bins."""
    E, n_z = len(Z), Z.shape[2]
    f, n_w = window.index.shape
    Phi = _regressors(R[:, window.index], window.offset, terms)
    size = np.linalg.norm(Phi, axis=1, keepdims=True)
    size = np.where(size > 0, size, 1.0)
    # Rows are (experiment, bin) pairs.
    rows = np.moveaxis(Z[:, window.index], 0, 1).reshape(f, E * n_w, n_z)
    powers = np.tile(window.offset, (1, E))[:, None] ** np.arange(1, terms.poles + 1)[:, None]
    return _local_fit(_iterate(Phi / size, rows, powers), size, terms, E, terms.degrees_of_freedom(n_w, E, n_z))


def _iterate(Phi: ComplexArray, Z: ComplexArray, powers: FloatArray) -> _Solution:
    """Solve for A with rows weighted by 1 / |A| of the previous iteration, then for B and T; powers (f, d, rows)."""
    X = powers[..., None] * Z[:, None]
    iterations = 4 if powers.shape[1] else 0  # further iterations change A by less than the noise
    a = np.zeros(powers.shape[:2], np.complex128)
    V, tolerance = Z, 1e-9 * _rms(Z)
    for iteration in range(iterations + 1):
        scale = np.maximum(_rms(V), tolerance)
        A = np.abs(1 + np.einsum("fp,fpr->fr", a, powers))
        # Limit the weight of a bin near a pole.
        w = 1 / np.maximum(A, (0.1 if iteration < iterations else 1e-12) * A.max(axis=1, keepdims=True))
        Q, L = np.linalg.qr(Phi * w[..., None])
        W_Z, W_X = w[..., None] * Z, w[:, None, :, None] * X
        V, V_X = W_Z - Q @ (Q.mT.conj() @ W_Z), W_X - Q[:, None] @ (Q.mT.conj()[:, None] @ W_X)
        if iteration < iterations:
            a = _denominator(V, V_X, W_X, scale)
        V = V + np.einsum("fp,fprz->frz", a, V_X)
    return _Solution(Q, L, W_Z, W_X, V, V_X, a, scale)


def _regressors(R: ComplexArray, r: FloatArray, terms: WindowTerms) -> ComplexArray:
    """Return Phi (f, E n_w, columns + E transient columns) from R (E, f, n_w, n_u): R, r R, ..., then 1, r, ..."""
    E, f, n_w, _ = R.shape
    powers = r[..., None] ** np.arange(terms.order + 1)
    reference_columns = np.asarray(np.einsum("efwu,fwp->fewpu", R, powers).reshape(f, E * n_w, terms.columns))
    if not terms.transient:
        return reference_columns
    transient_columns = np.einsum("fwp,ed->fewdp", powers, np.eye(E)).reshape(f, E * n_w, -1)
    return np.concatenate([reference_columns, transient_columns.astype(np.complex128)], axis=2)


def _denominator(V: ComplexArray, V_X: ComplexArray, W_X: ComplexArray, scale: FloatArray) -> ComplexArray:
    """Return a (f, d), d > 0: least squares of V + sum_p a_p V_Xp, outputs by their scale; 0 below rounding errors."""
    f, d = V_X.shape[:2]
    X = np.moveaxis(V_X / scale[:, None, None, :], 1, 3).reshape(f, -1, d)
    size = np.linalg.norm(W_X / scale[:, None, None, :], axis=(2, 3))
    size[size == 0] = 1.0
    guard = np.broadcast_to(_ROUNDING * np.eye(d), (f, d, d))
    Q, L = np.linalg.qr(np.concatenate([X / size[:, None, :], guard], axis=1))
    target = np.concatenate([-(V / scale[:, None, :]).reshape(f, -1, 1), np.zeros((f, d, 1))], axis=1)
    return np.asarray(np.linalg.solve(L, Q.mT.conj() @ target)[..., 0] / size)


def _local_fit(solution: _Solution, size: FloatArray, terms: WindowTerms, E: int, dof: float) -> LocalFit:
    """Return the fit from a solution whose regressors were divided by size (f, 1, columns)."""
    Q, L, n_u = solution.Q, solution.L, terms.n_u
    diagonal = np.abs(np.einsum("fcc->fc", L))
    condition = quotient(diagonal.max(axis=1), diagonal.min(axis=1), np.inf)
    L = np.where(np.isfinite(condition)[:, None, None], L, np.eye(L.shape[1]))
    # The columns at r^0: the inputs, and one constant for each experiment's transient.
    constants = terms.columns + (terms.order + 1) * np.arange(E if terms.transient else 0)
    first = np.concatenate([np.arange(n_u), constants])
    # Their rows (f, wanted, rows) of the pseudo-inverse of the weighted regressors.
    inverse = (np.linalg.inv(L)[:, first] @ Q.mT.conj()) / np.swapaxes(size, 1, 2)[:, first]
    input_rows, transient_rows = inverse[:, :n_u], inverse[:, n_u:]
    AZ = solution.Z + np.einsum("fp,fprz->frz", solution.a, solution.X)
    scatter = np.swapaxes(solution.V, 1, 2) @ solution.V.conj()
    return LocalFit(
        B=np.swapaxes(input_rows @ AZ, 1, 2),
        T=transient_rows @ AZ,
        scatter=scatter,
        dof=dof,
        input_factor=input_rows @ input_rows.mT.conj(),
        M=np.swapaxes(input_rows[:, None] @ solution.X, 2, 3),
        A_cov=_denominator_covariance(solution.V_X, solution.scale, scatter / dof),
        transient_factor=np.sum(np.abs(transient_rows) ** 2, axis=2),
        condition=condition,
    )


def _denominator_covariance(V_X: ComplexArray, scale: FloatArray, C_V: ComplexArray) -> ComplexArray:
    """Return cov(A_1 ... A_d) (f, d, d) of weighted least squares whose weights are not the inverse of C_V."""
    d = V_X.shape[1]
    X = V_X / scale[:, None, None, :]
    normal = np.einsum("fprz,fqrz->fpq", X.conj(), X, optimize=True)
    size = np.sqrt(np.einsum("fpp->fp", normal).real)
    size = np.where(size > 0, size, 1.0)
    sizes = size[:, :, None] * size[:, None, :]
    normal = normal / sizes + _ROUNDING * np.eye(d)
    C = C_V / (scale[:, :, None] * scale[:, None, :])
    meat = np.einsum("fprz,fzy,fqry->fpq", X.conj(), C, X, optimize=True) / sizes
    inverse = np.linalg.inv(normal)
    return np.asarray(inverse @ meat @ inverse.mT.conj() / sizes)


def _rms(Z: ComplexArray) -> FloatArray:
    """Return the rms (f, n_z) over the rows of Z (f, rows, n_z); 1 for zeros."""
    rms = np.sqrt(np.mean(np.abs(Z) ** 2, axis=1))
    return np.where(rms > 0, rms, 1.0)
