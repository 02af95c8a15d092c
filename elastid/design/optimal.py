r"""Optimal design: the shares of candidates of known information in an experiment, with a bound on their optimality.

.. math:: \max_\lambda\ \varphi\Big(M_0 / N + \sum_i \lambda_i H_i\Big), \quad \lambda_i \ge 0, \ \sum_i \lambda_i = 1

phi = ln det(M_S) / s of the information M_S = [(M^-1)_SS]^-1 on the s parameters of interest (D-optimality). Its
exponential is concave and homogeneous, so that with g_i = Tr(grad phi H_i) no design is better than phi + ln max g_i;
where all parameters count g_i = Tr(M^-1 H_i) / d. Multiplicative updates lambda_i <- lambda_i g_i^c climb to it.
(Silvey, Titterington and Torsney 1978; Pukelsheim, Optimal Design of Experiments, chapters 6 and 12, for bound and
rounding.)

Several information matrices of each candidate, one for each guess of the parameters, are averaged.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from elastid.base.arrays import FloatArray, IntArray

MAX_GAP = 1e-3
# Updates between two evaluations of all candidates; in between only those that could carry weight are updated.
UPDATES_PER_ROUND = 25


@dataclass(frozen=True)
class DesignCriterion:
    """D-optimality.  interest (d, s): columns that select the parameters of interest (or combinations of them)."""

    interest: FloatArray

    def value(self, M: FloatArray) -> FloatArray:
        """phi (...) of information matrices M (S, ..., d, d), the mean over guesses; -inf where one is singular."""
        return np.asarray(self._of_covariance(self.interest.T @ self._solved(M)).mean(axis=0))

    def _solved(self, M: FloatArray) -> FloatArray:
        """M^-1 K (..., d, s); a singular M gets huge variances."""
        diagonal = np.einsum("...ii->...i", M)
        ridge = 1e-13 * np.maximum(diagonal, 1e-13 * diagonal.max(axis=-1, keepdims=True))
        K = self.interest
        regular = M + ridge[..., None] * np.eye(M.shape[-1])
        return np.asarray(np.linalg.solve(regular, np.broadcast_to(K, (*M.shape[:-2], *K.shape))))

    def _of_covariance(self, C: FloatArray) -> FloatArray:
        """-ln det(C) / s of (M^-1)_SS (..., s, s); rounding may leave that of a singular M without a logarithm."""
        sign, log = np.linalg.slogdet(C)
        return np.where((sign > 0) & np.isfinite(log), -log / C.shape[-1], -np.inf)

    def slope(self, M: FloatArray) -> CriterionSlope:
        """phi and its gradient X C^-1 X^T / s at M (S, d, d), X = M^-1 K, C = K^T X."""
        X = self._solved(M)
        C = self.interest.T @ X
        gradient = X @ np.linalg.solve(C, np.swapaxes(X, 1, 2)) / C.shape[-1]
        return CriterionSlope(float(self._of_covariance(C).mean()), gradient / len(M))


@dataclass(frozen=True)
class CriterionSlope:
    """value: phi.  gradient (S, d, d): no design exceeds value + ln max_i sum_s Tr(gradient_s H_si)."""

    value: float
    gradient: FloatArray


@dataclass(frozen=True)
class RelaxedDesign:
    """weights (Q,): the share of each candidate.  value: phi reached.  gap: no design is better by more than this.

    excess: max_i g_i - 1.
    """

    weights: FloatArray
    value: float
    gap: float
    excess: float

    @property
    def bound(self) -> float:
        """Upper bound of phi of all designs."""
        return self.value + self.gap


def relaxed_design(
    H: FloatArray, criterion: DesignCriterion, known: FloatArray | None = None, tolerance: float = MAX_GAP
) -> RelaxedDesign:
    """The shares of candidates with information H (S, Q, d, d) per experiment, until the gap is below tolerance.

    known (S, d, d): earlier information, divided by the number of experiments to be shared.
    M must be positive definite for equal shares.
    """
    packed = pack(H if known is None else H + known[:, None])
    weights = np.full(packed.shape[1], 1 / packed.shape[1])
    slope = criterion.slope(unpack(weights @ packed))
    max_updates = 10_000
    for updates in range(0, max_updates + 1, UPDATES_PER_ROUND):
        g = _gains(packed, slope)
        excess = float(g.max()) - 1
        if np.log1p(excess) <= tolerance or updates == max_updates:
            break
        active = np.flatnonzero((weights > 1e-4 * weights.max()) | (g > 1 - 2 * max(excess, tolerance)))
        weights, slope = _climb(packed[:, active], weights, active, criterion)
    return RelaxedDesign(weights, slope.value, float(np.log1p(excess)), excess)


def _climb(
    packed: FloatArray, weights: FloatArray, active: IntArray, criterion: DesignCriterion
) -> tuple[FloatArray, CriterionSlope]:
    """UPDATES_PER_ROUND multiplicative updates on the active candidates; the others lose their shares."""
    share = weights[active] / weights[active].sum()
    # A candidate that has become active again needs some weight to grow from.
    share = np.maximum(share, 1e-3 / len(share))
    share /= share.sum()
    slope = criterion.slope(unpack(share @ packed))
    power = 1.0
    for _ in range(UPDATES_PER_ROUND):
        g = _gains(packed, slope)
        while True:
            tried = share * g**power
            tried /= tried.sum()
            moved = criterion.slope(unpack(tried @ packed))
            if moved.value >= slope.value or power < 1e-3:
                break
            power /= 2
        share, slope = tried, moved
        power = min(1.3 * power, 2.0)
    everyone = np.zeros_like(weights)
    everyone[active] = share
    return everyone, slope


def whole_experiments(
    H: FloatArray, weights: FloatArray, count: int, criterion: DesignCriterion, known: FloatArray | None = None
) -> IntArray:
    """Numbers (Q,) of whole experiments of each candidate, `count` in all: shares rounded, then exchanged one by one.

    The best of several starts, one of them the rounded shares, the others drawn from the shares.
    known (S, d, d): earlier information, undivided.
    """
    packed = pack(H)
    base = np.zeros((len(H), packed.shape[-1])) if known is None else pack(known)
    slope = criterion.slope(unpack(base / count + weights @ packed))
    searched = np.argsort(-_gains(packed, slope) - weights, kind="stable")[:400]
    share = weights[searched] / weights[searched].sum()
    draw = np.random.default_rng(0)
    starts = [_apportioned(share, count), *draw.multinomial(count, share, 5)]
    ends = [_exchanged(start, packed[:, searched], base, criterion) for start in starts]
    numbers = np.zeros(len(weights), dtype=np.int64)
    numbers[searched] = max(ends, key=lambda end: end[1])[0]
    return numbers


def _exchanged(
    numbers: IntArray, packed: FloatArray, base: FloatArray, criterion: DesignCriterion
) -> tuple[IntArray, float]:
    """Numbers (Q,) that no exchange of one experiment for another improves, and phi with them."""
    numbers = numbers.astype(np.int64)
    value = float(criterion.value(unpack(base + numbers @ packed)))
    improved = True
    while improved:
        improved = False
        for leaves in np.flatnonzero(numbers):
            rest = base + numbers @ packed - packed[:, leaves]
            enters, reached = _best_addition(rest, packed, criterion, int(leaves))
            if reached > value + 1e-9:
                numbers[leaves] -= 1
                numbers[enters] += 1
                value, improved = reached, True
    return numbers, value


def _best_addition(rest: FloatArray, packed: FloatArray, criterion: DesignCriterion, leaves: int) -> tuple[int, float]:
    # The gradient half way: without the removed experiment M may be close to singular. The best 40 are exact.
    slope = criterion.slope(unpack(rest + packed[:, leaves] / 2))
    g = _gains(packed, slope)
    best = np.argsort(-g, kind="stable")[:40]
    values = criterion.value(unpack(rest[:, None] + packed[:, best]))
    winner = int(np.argmax(values))
    return int(best[winner]), float(values[winner])


def _apportioned(weights: FloatArray, count: int) -> IntArray:
    """Whole numbers that add up to count, close to count * weights (Pukelsheim's efficient rounding)."""
    numbers = np.zeros(len(weights), dtype=np.int64)
    heaviest = np.argsort(-weights, kind="stable")[:count]
    support = heaviest[weights[heaviest] > 0]
    share = weights[support] / weights[support].sum()
    numbers[support] = np.ceil((count - len(support) / 2) * share)
    while numbers.sum() < count:
        numbers[support[np.argmin(numbers[support] / share)]] += 1
    while numbers.sum() > count:
        numbers[support[np.argmax((numbers[support] - 1) / share)]] -= 1
    return numbers


def _gains(packed: FloatArray, slope: CriterionSlope) -> FloatArray:
    """g (Q,): relative gain of phi by a small increase of each candidate's share."""
    return np.asarray(np.maximum(np.einsum("sqp,sp->q", packed, pack(slope.gradient), optimize=True), 0.0))


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
