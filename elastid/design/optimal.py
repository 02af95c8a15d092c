r"""Optimal design: the shares of candidates of known information in an experiment, with a bound on their optimality.

.. math:: \max_\lambda\ \varphi\Big(M_0 / N + \sum_i \lambda_i H_i\Big), \quad \lambda_i \ge 0, \ \sum_i \lambda_i = 1

phi = ln Phi_p of the information M_S = [(M^-1)_SS]^-1 on the parameters of interest, Phi_p the mean of power -p of its
eigenvalues, after Kiefer; p = 0 is D, their geometric mean, p = 1 is A, their harmonic mean, p -> infinity is E, the
smallest. Phi is concave and homogeneous, so that with g_i = Tr(grad phi H_i) no design is better than phi + ln max g_i;
for D g_i = Tr(M^-1 H_i) / d. Multiplicative updates lambda_i <- lambda_i g_i^c climb to it. (Silvey, Titterington and
Torsney 1978; Pukelsheim, Optimal Design of Experiments, chapters 6 and 12, for bound and rounding.) The smallest
eigenvalue has no gradient where it is best, where several are equal: E is a semidefinite program
(`bounded_shares`), and too large ones are softened and climb.

Several information matrices of each candidate, one for each guess of the parameters, are averaged or judged by the
worst guess.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal, TypeAlias

import numpy as np

from elastid.base.arrays import FloatArray, IntArray

Letter: TypeAlias = Literal["D", "A", "E"]
Over: TypeAlias = Literal["mean", "worst"]

MAX_GAP = 1e-3
# Power of the soft minimum over guesses in the search; the bound is computed with the true minimum.
GUESS_POWER = 300.0
# Updates between two evaluations of all candidates; in between only those that could carry weight are updated.
UPDATES_PER_ROUND = 25
# Of the dual; 1700 with 200 candidates take half a second, 600 with 8000 candidates 5 s. Beyond, updates climb.
MAX_UNKNOWNS = 2000


@dataclass(frozen=True)
class DesignCriterion:
    """letter: D, A or E.  interest (d, s): columns that select the parameters of interest (or combinations of them).

    softness: p < infinity for E, on the way to it.
    """

    letter: Letter
    interest: FloatArray
    over: Over = "mean"
    softness: float = np.inf

    def value(self, M: FloatArray) -> FloatArray:
        """phi (...) of information matrices M (S, ..., d, d), guesses taken together; -inf where one is singular."""
        phi = self._hard(np.linalg.eigvalsh(self.interest.T @ self._solved(M)).astype(np.float64))
        return np.asarray(phi.min(axis=0) if self.over == "worst" else phi.mean(axis=0))

    def _solved(self, M: FloatArray) -> FloatArray:
        """M^-1 K (..., d, s); a singular M gets huge variances."""
        diagonal = np.einsum("...ii->...i", M)
        ridge = 1e-13 * np.maximum(diagonal, 1e-13 * diagonal.max(axis=-1, keepdims=True))
        K = self.interest
        regular = M + ridge[..., None] * np.eye(M.shape[-1])
        return np.asarray(np.linalg.solve(regular, np.broadcast_to(K, (*M.shape[:-2], *K.shape))))

    def _hard(self, variances: FloatArray) -> FloatArray:
        """ln Phi from the eigenvalues (..., s) of (M^-1)_SS; rounding may leave one of a singular M negative."""
        with np.errstate(divide="ignore", invalid="ignore"):
            if self.letter == "D":
                phi = -np.mean(np.log(variances), axis=-1)
            elif self.letter == "A":
                phi = -np.log(variances.mean(axis=-1))
            else:
                largest = variances.max(axis=-1)
                phi = -np.log(largest)
                if np.isfinite(self.softness):
                    mean = np.mean((variances / largest[..., None]) ** self.softness, axis=-1)
                    phi = phi - np.log(mean) / self.softness
        return np.where(np.isfinite(phi) & (variances > 0).all(axis=-1), phi, -np.inf)

    def slope(self, M: FloatArray) -> CriterionValue:
        """Value, searched value and gradients at M (S, d, d)."""
        K = self.interest
        X = self._solved(M)
        variances, V = np.linalg.eigh(K.T @ X)
        phi = self._hard(variances)
        # The search for E has a soft minimum of the eigenvalues; its bound is computed with the true one.
        power = {"D": 0.0, "A": 1.0, "E": min(self.softness, 30.0)}[self.letter]
        relative = (variances / variances.max(axis=1, keepdims=True)) ** power
        share = relative / relative.sum(axis=1, keepdims=True)  # of each eigenvalue in the gradient
        # grad ln Phi_p = X V diag(share / variance) V^T X^T; for E scaled so that it bounds the smallest eigenvalue.
        scale = share / variances
        soft = phi
        if self.letter == "E" and np.isinf(self.softness):
            soft = phi - np.log(np.mean(relative, axis=1)) / power
            scale = scale * (variances.max(axis=1) / (share * variances).sum(axis=1))[:, None]
        XV = X @ V
        gradient = (XV * scale[:, None, :]) @ np.swapaxes(XV, 1, 2)
        if self.over == "mean" or len(phi) == 1:
            weight = np.full(len(phi), 1 / len(phi))
            return CriterionValue(float(phi.mean()), float(soft.mean()), 0.0, weight[:, None, None] * gradient)
        weight = np.exp(-GUESS_POWER * (soft - soft.min()))
        searched = float(soft.min() - np.log(weight.mean()) / GUESS_POWER)
        weight /= weight.sum()
        slack = float(weight @ phi - phi.min())
        return CriterionValue(float(phi.min()), searched, slack, weight[:, None, None] * gradient)


@dataclass(frozen=True)
class CriterionValue:
    """value: phi.  searched: the smooth function that is maximised.  slack: by how much the guesses' mean exceeds phi.

    gradient (S, d, d): no design exceeds value + slack + ln max_i sum_s Tr(gradient_s H_si).
    """

    value: float
    searched: float
    slack: float
    gradient: FloatArray


@dataclass(frozen=True)
class RelaxedDesign:
    """weights (Q,): the share of each candidate.  value: phi reached.  gap: no design is better by more than this.

    excess: max_i g_i - 1, for D the familiar max_i Tr(M^-1 H_i) / d - 1.
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
    bounded = None
    if criterion.letter == "E" and np.isinf(criterion.softness):
        bounded = bounded_shares(packed, criterion.interest, criterion.over == "worst", tolerance)
    if bounded is None:
        return _climbed(packed, criterion, tolerance)
    weights, bound = bounded
    value = float(criterion.value(unpack(weights @ packed)))
    certified = RelaxedDesign(weights, value, bound - value, float(np.expm1(bound - value)))
    if certified.gap <= tolerance:
        return certified
    return min(certified, _climbed(packed, criterion, tolerance), key=lambda design: design.gap)


def _climbed(packed: FloatArray, criterion: DesignCriterion, tolerance: float) -> RelaxedDesign:
    weights = np.full(packed.shape[1], 1 / packed.shape[1])
    slope = criterion.slope(unpack(weights @ packed))
    max_updates = 10_000
    for updates in range(0, max_updates + 1, UPDATES_PER_ROUND):
        g = _gains(packed, slope)
        excess = float(g.max()) - 1
        gap = slope.slack + float(np.log1p(excess))
        if gap <= tolerance or updates == max_updates:
            break
        active = np.flatnonzero((weights > 1e-4 * weights.max()) | (g > 1 - 2 * max(excess, tolerance)))
        before = slope.searched
        weights, slope = _climb(packed[:, active], weights, active, criterion)
        # Converged: the rest of the gap comes from the soft minima.
        if updates and abs(slope.searched - before) < min(1e-7, tolerance / 1e4):
            tolerance = np.inf
    return RelaxedDesign(weights, slope.value, gap, excess)


def _climb(
    packed: FloatArray, weights: FloatArray, active: IntArray, criterion: DesignCriterion
) -> tuple[FloatArray, CriterionValue]:
    """UPDATES_PER_ROUND multiplicative updates on the active candidates; the others lose their shares."""
    share = weights[active] / weights[active].sum()
    # A candidate that has become active again needs some weight to grow from.
    share = np.maximum(share, 1e-3 / len(share))
    share /= share.sum()
    slope = criterion.slope(unpack(share @ packed))
    power = 1.0 if criterion.letter == "D" and criterion.over == "mean" else 0.5
    for _ in range(UPDATES_PER_ROUND):
        g = _gains(packed, slope)
        while True:
            tried = share * g**power
            tried /= tried.sum()
            moved = criterion.slope(unpack(tried @ packed))
            if moved.searched >= slope.searched or power < 1e-3:
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
    if criterion.letter == "E":
        # The smallest eigenvalue alone is a poor guide from far away; means of increasing power approach it.
        for softness in (1.0, 2.0, 4.0, 8.0, 16.0, 32.0, 64.0):
            soft = replace(criterion, softness=softness)
            starts = [_exchanged(start, packed[:, searched], base, soft)[0] for start in starts]
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


def _gains(packed: FloatArray, slope: CriterionValue) -> FloatArray:
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


def bounded_shares(
    H: FloatArray, interest: FloatArray, worst: bool, tolerance: float
) -> tuple[FloatArray, float] | None:
    r"""Shares (Q,) of candidates with packed information H (S, Q, p) by a semidefinite program, and a bound of phi.

    .. math:: \max_{\lambda, t}\ \frac{1}{S} \sum_s \ln t_s, \qquad \sum_q \lambda_q H_{sq} \succeq t_s K K^T,
              \quad \lambda_q \ge 0, \ \sum_q \lambda_q = 1

    interest: K (d, s), so that 1 / t_s is the largest eigenvalue of K^T M_s^-1 K.  worst: one t for all guesses s.
    Clarabel solves it; from its dual matrices W_s follows the bound ln max_q sum_s Tr(W_s H_sq) - mean_s ln(S Tr(W_s K
    K^T)), valid wherever the solver has stopped (Pukelsheim, chapter 7).  None where there are too many unknowns, where
    the information of equal shares is singular in floating point, and where the solver fails.
    """
    # Both are slow to import, and needed for this criterion alone.
    import clarabel
    from scipy import sparse

    S, Q, p = H.shape
    if S * p > MAX_UNKNOWNS:
        return None
    # In coordinates in which the mean information of equal shares is the identity, and its smallest eigenvalue is 1.
    try:
        whitening = np.linalg.inv(np.linalg.cholesky(unpack(H.mean(axis=(0, 1)))))
    except np.linalg.LinAlgError:
        return None
    K = whitening @ interest
    scale = float(np.linalg.eigvalsh(K.T @ K).max())
    C = pack(K @ K.T) / scale
    H = pack(whitening @ unpack(H) @ whitening.T)
    T = 1 if worst else S
    # Unknowns: t (T,), their logarithms (T,), the shares (Q,).  right - constraints @ unknowns lies in the cones.
    matrices = [np.kron(np.ones((S, 1)) if worst else np.eye(S), C[:, None]), np.zeros((S * p, T)), -np.vstack([*H.mT])]
    logarithms = np.zeros((3 * T, 2 * T))
    for s in range(T):
        logarithms[3 * s, T + s] = logarithms[3 * s + 2, s] = -1.0
    constraints = sparse.vstack([
        sparse.csc_matrix(np.concatenate([np.zeros(2 * T), np.ones(Q)])[None]),
        sparse.hstack([sparse.csc_matrix((Q, 2 * T)), -sparse.eye(Q)]),
        sparse.csc_matrix(np.hstack(matrices)),
        sparse.hstack([sparse.csc_matrix(logarithms), sparse.csc_matrix((3 * T, Q))]),
    ])  # fmt: skip
    right = np.concatenate([[1.0], np.zeros(Q + S * p), np.tile([0.0, 1.0, 0.0], T)])
    cones = [clarabel.ZeroConeT(1), clarabel.NonnegativeConeT(Q)]
    cones += [clarabel.PSDTriangleConeT(len(K))] * S + [clarabel.ExponentialConeT()] * T
    goal = np.concatenate([np.zeros(T), -np.ones(T) / T, np.zeros(Q)])
    settings = clarabel.DefaultSettings()
    settings.verbose, settings.max_threads = False, 1
    settings.tol_gap_abs = settings.tol_gap_rel = tolerance / 10
    solver = clarabel.DefaultSolver(
        sparse.csc_matrix((len(goal), len(goal))), goal, sparse.csc_matrix(constraints), right, cones, settings
    )
    solution = solver.solve()
    weights = np.maximum(solution.x[2 * T :], 0.0)
    W = np.array(solution.z[1 + Q : 1 + Q + S * p]).reshape(S, p)
    largest, normal = np.einsum("sqp,sp->q", H, W).max(), W @ C
    if not (weights.sum() > 0 and np.isfinite(largest) and largest > 0 and (normal > 0).all()):
        return None
    mean = np.log(normal.sum()) if worst else np.mean(np.log(S * normal))
    return weights / weights.sum(), float(np.log(largest) - mean - np.log(scale))
