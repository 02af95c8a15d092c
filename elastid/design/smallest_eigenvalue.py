"""Shares that make the smallest eigenvalue of the information largest, with a bound: a semidefinite program."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from elastid.base.arrays import FloatArray


def pack(matrices: FloatArray) -> FloatArray:
    """Symmetric (..., d, d) as (..., d (d + 1) / 2), so that Tr(A B) is a dot product."""
    rows, columns = np.tril_indices(matrices.shape[-1])
    return np.ascontiguousarray(matrices[..., rows, columns] * np.where(rows == columns, 1.0, np.sqrt(2)))


def unpack(vectors: FloatArray) -> FloatArray:
    """Symmetric (..., d, d) of vectors (..., d (d + 1) / 2)."""
    d = round((np.sqrt(8 * vectors.shape[-1] + 1) - 1) / 2)
    rows, columns = np.tril_indices(d)
    matrices = np.empty((*vectors.shape[:-1], d, d))
    matrices[..., rows, columns] = vectors / np.where(rows == columns, 1.0, np.sqrt(2))
    matrices[..., columns, rows] = matrices[..., rows, columns]
    return matrices


MAX_STEPS = 60
# Part of the way to the edge of what is allowed that a step may go, and the least part of mu that it aims at.
WITHIN, LEAST_MU = 0.9, 0.1
# Beyond so many unknowns of the dual the Newton equations take longer than multiplicative updates.
MAX_UNKNOWNS = 700


@dataclass(frozen=True)
class BoundedShares:
    """weights (Q,) of the candidates.  value: phi with them, the log of the smallest eigenvalue.

    bound: no design exceeds it.
    """

    weights: FloatArray
    value: float
    bound: float


@dataclass(frozen=True)
class _Program:
    """H (Q, S p): packed information, guess after guess.  C (n, S p): K K^T in the guesses that share a t.  S: guesses.

    value: phi of information (S, d, d).
    """

    H: FloatArray
    C: FloatArray
    S: int
    value: Callable[[FloatArray], FloatArray]

    def matrices(self, vector: FloatArray) -> FloatArray:
        """(S, d, d)."""
        return unpack(vector.reshape(self.S, -1))


@dataclass(frozen=True)
class _Point:
    """W (S p): packed.  shares (Q,): lambda.  t (n,).  As a direction: their changes."""

    W: FloatArray
    shares: FloatArray
    t: FloatArray

    def plus(self, change: _Point, dual: float, primal: float) -> _Point:
        """The point after a step of these lengths."""
        return _Point(self.W + dual * change.W, self.shares + primal * change.shares, self.t + primal * change.t)


def bounded_shares(
    H: FloatArray, interest: FloatArray, worst: bool, value: Callable[[FloatArray], FloatArray], tolerance: float
) -> BoundedShares | None:
    """Shares of candidates with packed information H (S, Q, p), until the bound exceeds phi by less than tolerance.

    interest: K (d, s).  worst: the worst guess counts, not the mean.  None where there are too many unknowns, or where
    the information of equal shares is singular in floating point.
    """
    S, _, p = H.shape
    if S * p > MAX_UNKNOWNS:
        return None
    each = np.kron(np.eye(S), pack(interest @ interest.T))
    C = np.asarray(each.sum(axis=0, keepdims=True) if worst else each, dtype=np.float64)
    program = _Program(np.concatenate(list(H), axis=1), C, S, value)
    best = None
    try:
        point = _start(program, interest)
        for _ in range(MAX_STEPS):
            now = _bounded(program, point)
            best = now if best is None else _better(best, now)
            if best.bound - best.value <= tolerance:
                break
            point = _stepped(program, point)
    except np.linalg.LinAlgError:
        # At the edge of floating point: what has been reached stays certified.
        return best
    return best


def _better(one: BoundedShares, other: BoundedShares) -> BoundedShares:
    """The better shares with the lower bound."""
    return replace(max(one, other, key=lambda shares: shares.value), bound=min(one.bound, other.bound))


def _start(program: _Program, K: FloatArray) -> _Point:
    """Equal shares, and W in proportion to the inverse of their information: both are well inside."""
    M = program.matrices(program.H.mean(axis=0))
    W = pack(_inverse(M)).ravel()
    W = W / (2 * (program.H @ W).max())
    t = 1 / (len(program.C) * (program.C @ W))
    largest = np.linalg.eigvalsh(K.T @ np.linalg.solve(M, np.broadcast_to(K, (program.S, *K.shape)))).max()
    return _Point(W, np.full(len(program.H), 2 * t.max() * largest / len(program.H)), t)


def _bounded(program: _Program, point: _Point) -> BoundedShares:
    """The shares, added up to one, and the bound of W, enlarged until a candidate is at its limit."""
    weights = point.shares / point.shares.sum()
    value = float(program.value(program.matrices(weights @ program.H)))
    bound = np.log((program.H @ point.W).max()) - np.mean(np.log(len(program.C) * (program.C @ point.W)))
    return BoundedShares(weights, value, float(bound))


def _stepped(program: _Program, point: _Point) -> _Point:
    """The point after a predicted and corrected step towards a smaller mu."""
    H, C = program.H, program.C
    slack, W = 1 - H @ point.W, program.matrices(point.W)
    Z = program.matrices(point.shares @ H - point.t @ C)
    mu = (point.shares @ slack + np.sum(W * Z)) / (len(H) + program.S * W.shape[-1])
    inverse = _scaled_inverse(_equations(program, point, slack, _inverse(W), Z))
    nowhere = _Point(0 * point.W, 0 * point.shares, 0 * point.t)
    predicted = _direction(program, point, inverse, 0.0, nowhere)
    aim = max(LEAST_MU, (1 - min(_lengths(program, point, predicted))) ** 2)
    corrected = _direction(program, point, inverse, aim * mu, predicted)
    return point.plus(corrected, *_lengths(program, point, corrected))


def _equations(program: _Program, point: _Point, slack: FloatArray, inverse: FloatArray, Z: FloatArray) -> FloatArray:
    """The matrix (S p, S p) of the Newton equations for the change of W."""
    H, C = program.H, program.C
    equations = (H * (point.shares / slack)[:, None]).T @ H + (C * (point.t / (C @ point.W))[:, None]).T @ C
    p = H.shape[1] // program.S
    basis = unpack(np.eye(p))
    for s in range(program.S):
        guess = slice(s * p, (s + 1) * p)
        equations[guess, guess] += pack(_symmetric(inverse[s] @ basis @ Z[s]))
    return np.asarray(equations)


def _direction(program: _Program, point: _Point, inverse: FloatArray, mu: float, predicted: _Point) -> _Point:
    """The change towards mu, with the products of the predicted changes taken into account."""
    H, C = program.H, program.C
    slack, k = 1 - H @ point.W, C @ point.W
    complement = mu + predicted.shares * (H @ predicted.W)
    scale = 1 / len(C) - predicted.t * (C @ predicted.W)
    W = program.matrices(point.W)
    dZ = program.matrices(predicted.shares @ H - predicted.t @ C)
    aimed = mu * np.eye(W.shape[-1]) - program.matrices(predicted.W) @ dZ
    right = pack(_symmetric(_inverse(W) @ aimed)).ravel() - (complement / slack) @ H + (scale / k) @ C
    dW = inverse @ right
    shares = complement / slack - point.shares + point.shares / slack * (H @ dW)
    return _Point(dW, shares, scale / k - point.t - point.t / k * (C @ dW))


def _lengths(program: _Program, point: _Point, change: _Point) -> tuple[float, float]:
    """How far W, and shares and t, may follow their changes: at most 1."""
    H, C = program.H, program.C
    dual = [
        _most_negative(program.matrices(point.W), program.matrices(change.W)),
        float(np.min(-(H @ change.W) / (1 - H @ point.W))),
    ]
    Z, dZ = (program.matrices(one.shares @ H - one.t @ C) for one in (point, change))
    primal = [
        _most_negative(Z, dZ),
        float(np.min(change.shares / point.shares)),
        float(np.min(change.t / point.t)),
    ]
    return WITHIN / max(WITHIN, -min(dual)), WITHIN / max(WITHIN, -min(primal))


def _most_negative(X: FloatArray, change: FloatArray) -> float:
    """Smallest eigenvalue of L^-1 change L^-T, X = L L^T (S, d, d): X + a change is singular at a = -1 / it."""
    L = np.linalg.cholesky(X)
    half = np.linalg.solve(L, change)
    return float(np.linalg.eigvalsh(np.linalg.solve(L, np.swapaxes(half, 1, 2))).min())


def _scaled_inverse(matrix: FloatArray) -> FloatArray:
    """Inverse of a positive definite matrix, its diagonal scaled to one before."""
    scale = 1 / np.sqrt(np.diag(matrix))
    return np.asarray(scale[:, None] * _inverse(scale[:, None] * matrix * scale) * scale)


def _inverse(matrices: FloatArray) -> FloatArray:
    return np.linalg.inv(matrices).astype(np.float64)


def _symmetric(matrices: FloatArray) -> FloatArray:
    return (matrices + np.swapaxes(matrices, -1, -2)) / 2
