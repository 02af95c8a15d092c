r"""Optimal design: the shares of candidates of known information in an experiment, with a bound on their optimality.

.. math:: \max_\lambda\ \varphi\Big(M_0 / N + \sum_i \lambda_i H_i\Big), \quad \lambda_i \ge 0, \ \sum_i \lambda_i = 1

phi = ln det(M_S) / s of the information M_S = [(M^-1)_SS]^-1 on the s parameters of interest (D-optimality). Its
exponential is concave and homogeneous, so that with g_i = Tr(grad phi H_i) no design is better than phi + ln max g_i;
where all parameters count g_i = Tr(M^-1 H_i) / d. Multiplicative updates lambda_i <- lambda_i g_i^c climb to it.
(Silvey, Titterington and Torsney 1978; Pukelsheim, Optimal Design of Experiments, chapters 6 and 12, for bound and
rounding.)

Several information matrices of each candidate, one for each guess of the parameters, are averaged.

Optimal powers: the distribution of each input's power over the lines, with a bound on its optimality.

.. math:: \max_P\ \varphi\Big(M_0 + \sum_q H_q(P)\Big), \qquad \sum_{kl} c_{okl} P_{kl} \le 1, \quad
          P_{kl} \ge \epsilon \bar P_{kl}

.. math:: H = 2\,\mathrm{Re} \sum_{kij} \frac{J_{kij} J_{kij}^H}{\sigma_{kij}^2}, \qquad
          \sigma_{kij}^2 = \frac{C_{ki}}{M} \sum_l \frac{|T_{klj}|^2}{P_{kl}} + f_{kij}

c_o: cost of a power in terms of limit o: the RMS of an input, the torque, velocity ... of a motor.  T = I + F G: the
torques to be injected at l for an acting torque at j alone.  C: variance of the equation error.  f: variance that does
not depend on power (floor of the weights, distortion).  P bar: the even powers within the limits; epsilon of them keep
the response itself measurable at every line.

Each 1 / sigma^2 is concave in P, and so is phi: with g = d phi / d P no P* in reach is better than
phi + <g, P* - P>, and <g, P*> <= max g / h for any price h = sum_o mu_o c_o of a power. The multiplicative updates
P <- P (g / h)^a, mu_o <- mu_o (c_o P)^a converge to an equal ratio of gain and price at all lines with more than the
least power. (Silvey, Titterington and Torsney 1978 for one limit; for one input in the noise limit this is the optimal
spectrum of Mehra, IEEE Trans. Automatic Control 19 (1974) 753.)
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from elastid.base.arrays import BoolArray, ComplexArray, FloatArray, IntArray
from elastid.fit.problem.least_squares import as_real

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


# phi is the log of a mean information: a gap of 0.01 is half a percent of a standard deviation.
MAX_POWER_GAP = 0.01
MIN_PRICE = 1e-12
MAX_UPDATES = 500


@dataclass(frozen=True, eq=False)
class PowerSource:
    """The information of one configuration as a function of powers.

    J (n_x, F, n_y, n_u): sqrt(2) dG/dx.  error (F, n_y): C / M.  spread (F, n_u, n_u): |T|^2, from input l to column j.
    fixed (F, n_y, n_u): f.  used (F, n_y, n_u): elements that the fit sees.
    """

    J: ComplexArray
    error: FloatArray
    spread: FloatArray
    fixed: FloatArray
    used: BoolArray

    def information(self, P: FloatArray) -> FloatArray:
        """H (n_x, n_x) at powers P (F, n_u), summed over the experiments of a realisation."""
        rows = as_real(self.J * np.sqrt(self._weight(P))).reshape(len(self.J), -1)
        return np.asarray(rows @ rows.T)

    def gains(self, P: FloatArray, gradient: FloatArray) -> FloatArray:
        """d Tr(gradient H) / d P (F, n_u), for a gradient (n_x, n_x) without negative eigenvalues."""
        eigenvalues, V = np.linalg.eigh(gradient)
        half = V * np.sqrt(np.maximum(eigenvalues, 0.0))
        rows = half.T @ as_real(self.J).reshape(len(self.J), -1)
        squares = np.sum(rows**2, axis=0).reshape(*self.used.shape, 2).sum(axis=-1)
        per_column = np.einsum("fij,fi->fj", squares * self._weight(P) ** 2, self.error)
        return np.asarray(np.einsum("flj,fj->fl", self.spread, per_column) / P**2)

    def _weight(self, P: FloatArray) -> FloatArray:
        column = np.einsum("flj,fl->fj", self.spread, 1 / P)
        variance = self.error[:, :, None] * column[:, None, :] + self.fixed
        return np.where(self.used, 1 / variance, 0.0)


@dataclass(frozen=True)
class Powers:
    """P (K, F, n_u) of each group of configurations.  value: phi there.  gap: no other powers exceed it by more."""

    P: FloatArray
    value: float
    gap: float


def best_powers(
    groups: Sequence[Sequence[Sequence[PowerSource]]],
    cost: FloatArray,
    criterion: DesignCriterion,
    known: FloatArray,
    least: float,
    tolerance: float = MAX_POWER_GAP,
) -> Powers:
    """Best powers of each group, whose configurations all have the same.

    groups: for each group its configurations, each with a PowerSource for each of S guesses.  cost (K, n_o, F, n_u):
    c of each group; every input and line must have one.  known (S, n_x, n_x): earlier information.
    least: epsilon.
    """
    even = even_powers(cost)
    best = Powers(even, float(criterion.value(_information(groups, even, known))), 0.0)
    if least >= 1:
        return best
    room = 1 - least * _used(cost, even)
    share, price, bound = (1 - least) * even, np.full(room.shape, 1 / room.size), np.inf
    for update in range(MAX_UPDATES):
        P = least * even + share
        M = _information(groups, P, known)
        slope = criterion.slope(M)
        if slope.value > best.value:
            best = replace(best, P=P, value=slope.value)
        g = _power_gains(groups, P, slope.gradient)
        ratio = g / np.einsum("ko,kofl->kfl", price, cost)
        reach = float(1 + ratio.max() * np.sum(price * room) - np.sum(g * share))  # Tr(gradient M) is 1
        bound = min(bound, slope.value + float(np.log(reach)))
        if bound - best.value <= tolerance:
            break
        exponent = (1 + update / 50) ** -0.5
        share = share * (ratio / ratio.max()) ** exponent
        used = _used(cost, share) / room
        price = np.maximum(price * (used / used.max()) ** exponent, MIN_PRICE)
        price /= np.sum(price * room)
        share = share / used.max(axis=1)[:, None, None]
    P = _filled(cost, best.P)
    value = max(best.value, float(criterion.value(_information(groups, P, known))))
    return Powers(P, value, max(bound - value, 0.0))


def _filled(cost: FloatArray, P: FloatArray) -> FloatArray:
    """Powers raised, input after input, until each comes to a limit: they use the rest that the last update left."""
    for i in range(P.shape[2]):
        mine = np.einsum("kof,kf->ko", cost[..., i], P[..., i])
        left = np.maximum(1 - _used(cost, P), 0.0)
        growth = np.divide(left, mine, out=np.full(mine.shape, np.inf), where=mine > 0).min(axis=1)
        P = P * np.where(np.arange(P.shape[2]) == i, 1 + growth[:, None], 1.0)[:, None, :]
    return P


def even_powers(cost: FloatArray) -> FloatArray:
    """P (K, F, n_u), the same at all lines of an input, with which every input goes as far as a limit allows."""
    per_input = cost.sum(axis=2)
    level = 1 / per_input.max(axis=1)
    for _ in range(30):
        used = np.einsum("kol,kl->ko", per_input, level)
        # Of the limits that bound an input (it has a tenth of what is used, or more), the one that is used most.
        counts = per_input * level[:, None, :] > 0.1 * used[..., None]
        level = level / np.max(np.where(counts, used[..., None], 0.0), axis=1) ** 0.5
    level = level / np.einsum("kol,kl->ko", per_input, level).max(axis=1, keepdims=True)
    return np.repeat(level[:, None, :], cost.shape[2], axis=1)


def _used(cost: FloatArray, P: FloatArray) -> FloatArray:
    """Part (K, n_o) of each limit that is used."""
    return np.asarray(np.einsum("kofl,kfl->ko", cost, P))


def _information(groups: Sequence[Sequence[Sequence[PowerSource]]], P: FloatArray, known: FloatArray) -> FloatArray:
    """M (S, n_x, n_x)."""
    M = known.copy()
    for group, powers in zip(groups, P, strict=True):
        for configuration in group:
            M += np.stack([source.information(powers) for source in configuration])
    return M


def _power_gains(groups: Sequence[Sequence[Sequence[PowerSource]]], P: FloatArray, gradient: FloatArray) -> FloatArray:
    """d phi / d P (K, F, n_u)."""
    gains = []
    for group, powers in zip(groups, P, strict=True):
        pairs = [pair for configuration in group for pair in zip(configuration, gradient, strict=True)]
        gains.append(sum(source.gains(powers, slope) for source, slope in pairs))
    return np.array(gains)
