r"""D-optimal design: powers of lines, or fractions of candidates, with the largest information and a bound on it.

.. math:: \max_P\ \varphi\Big(M_0 + \sum_q H_q(P)\Big), \qquad \sum_{kl} c_{okl} P_{kl} \le 1, \quad
          P_{kl} \ge \epsilon \bar P_{kl}

phi = ln det(M_S) / s of the information M_S = [(M^-1)_SS]^-1 about the s parameters of interest, averaged over several
guesses of the parameters. P: power of each input l at each line k, with which the information grows as

.. math:: H = 2\,\mathrm{Re} \sum_{kij} \frac{J_{kij} J_{kij}^H}{\sigma_{kij}^2}, \qquad
          \sigma_{kij}^2 = \frac{C_{ki}}{M} \sum_l \frac{|T_{klj}|^2}{P_{kl}} + f_{kij}

c_o: cost of a power with respect to limit o, such as the rms of an input or the velocity of a motor.  T = I + F G:
injected torques at l for an acting torque at j.  C: variance of the equation error.  f: variance that does not depend
on power (model error, distortion).  P bar: even powers within the limits; the fraction epsilon of them makes the
response measurable at every line. For candidates with known information H_k, P are fractions of the experiments,
H = sum_k P_k H_k, with cost 1.

Each 1 / sigma^2 is concave in P, and so is phi. With g = d phi / d P, an upper bound of phi at any admissible P* is
phi + ln(1 + <g, P* - P>), because exp(phi) is concave and homogeneous, and <g, P*> <= max g / h for any price
h = sum_o mu_o c_o. The multiplicative updates P <- P (g / h)^a, mu_o <- mu_o (c_o P)^a converge to an equal ratio of
gain and price at all lines with more than the least power. (Silvey, Titterington and Torsney 1978 for one limit;
Mehra, IEEE Trans. Automatic Control 19 (1974) 753 for one input with dominating noise; Pukelsheim, Optimal Design of
Experiments, chapter 6, for the bound.)
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TypeAlias

import numpy as np

from elastid.base.arrays import BoolArray, ComplexArray, FloatArray, IntArray
from elastid.fit.problem.least_squares import as_real


@dataclass(frozen=True)
class DesignCriterion:
    """D-optimality.  interest K (d, s): columns that select the parameters of interest (or combinations of them)."""

    interest: FloatArray

    def value(self, M: FloatArray) -> FloatArray:
        """Return phi (...) of information matrices M (S, ..., d, d), mean over guesses; -inf for a singular one."""
        return np.asarray(self._criterion_of_covariance(self.interest.T @ self._solve(M)).mean(axis=0))

    def _solve(self, M: FloatArray) -> FloatArray:
        """Return M^-1 K (..., d, s), regularised for a singular M (..., d, d)."""
        diagonal = np.einsum("...ii->...i", M)
        ridge = 1e-13 * np.maximum(diagonal, 1e-13 * diagonal.max(axis=-1, keepdims=True))
        K = self.interest
        regular = M + ridge[..., None] * np.eye(M.shape[-1])
        return np.linalg.solve(regular, np.broadcast_to(K, (*M.shape[:-2], *K.shape)))

    def _criterion_of_covariance(self, C: FloatArray) -> FloatArray:
        """Return -ln det(C) / s of C = (M^-1)_SS (..., s, s); -inf if C is not positive definite due to rounding."""
        sign, log = np.linalg.slogdet(C)
        return np.where((sign > 0) & np.isfinite(log), -log / C.shape[-1], -np.inf)

    def slope(self, M: FloatArray) -> tuple[float, FloatArray]:
        """Return phi and its gradient X C^-1 X^T / s (S, d, d) at M (S, d, d), with X = M^-1 K and C = K^T X."""
        X = self._solve(M)
        C = self.interest.T @ X
        gradient = X @ np.linalg.solve(C, np.swapaxes(X, 1, 2)) / C.shape[-1]
        return float(self._criterion_of_covariance(C).mean()), gradient / len(M)


def optimal_weights(H: FloatArray, criterion: DesignCriterion, prior: FloatArray) -> "Powers":
    """Return optimal fractions (1, Q, 1) of experiments for candidates with information H (S, Q, d, d) each.

    prior (S, d, d): earlier information over the number of experiments.
    """
    group = [[CandidateInformation(of_guess) for of_guess in H]]
    return best_powers([group], np.ones((1, 1, H.shape[1], 1)), criterion, prior, 0.0, MAX_GAP / 4)


def best_experiments(
    H: FloatArray, count: int, criterion: DesignCriterion, prior: FloatArray
) -> tuple[IntArray, float]:
    """Select `count` whole experiments; return numbers (Q,) and the efficiency relative to optimal fractions.

    The best of several random roundings, each improved by exchanges.  H (S, Q, d, d).  prior (S, d, d): earlier
    information.
    """
    best = optimal_weights(H, criterion, prior / count)
    weights = best.P[0, :, 0]
    _, gradient = criterion.slope(prior / count + np.tensordot(weights, H, (0, 1)))
    order = np.argsort(-_gains(H, gradient) - weights, kind="stable")[:400]
    fraction = weights[order] / weights[order].sum()
    draw = np.random.default_rng(0)
    ends = [_exchange(start, H[:, order], prior, criterion) for start in draw.multinomial(count, fraction, 6)]
    numbers = np.zeros(len(weights), dtype=np.int64)
    numbers[order], value = max(ends, key=lambda end: end[1])
    return numbers, float(np.exp(min(0.0, value - np.log(count) - best.value - best.gap)))


def _exchange(
    numbers: IntArray, H: FloatArray, prior: FloatArray, criterion: DesignCriterion
) -> tuple[IntArray, float]:
    """Return numbers (Q,) that no exchange of one experiment improves, and phi."""
    numbers = numbers.astype(np.int64)
    value = float(criterion.value(prior + np.tensordot(numbers, H, (0, 1))))
    has_improved = True
    while has_improved:
        has_improved = False
        for removed in np.flatnonzero(numbers):
            M = prior + np.tensordot(numbers, H, (0, 1)) - H[:, removed]
            # The gradient half way, because M may be nearly singular. The best 40 candidates are evaluated exactly.
            _, gradient = criterion.slope(M + H[:, removed] / 2)
            best = np.argsort(-_gains(H, gradient), kind="stable")[:40]
            values = criterion.value(M[:, None] + H[:, best])
            i = int(np.argmax(values))
            if values[i] > value + 1e-9:
                numbers[removed] -= 1
                numbers[best[i]] += 1
                value, has_improved = float(values[i]), True
    return numbers, value


def _gains(H: FloatArray, gradient: FloatArray) -> FloatArray:
    """Return the derivative (Q,) of phi by the fraction of each candidate, at least 0."""
    return np.asarray(np.maximum(np.einsum("sqij,sij->q", H, gradient, optimize=True), 0.0))


# phi is the logarithm of a mean information: a gap of 0.01 is half a percent of a standard deviation.
MAX_GAP = 0.01
MIN_PRICE = 1e-12
MAX_UPDATES = 500


@dataclass(frozen=True, eq=False)
class PowerSource:
    """Information of one configuration as a function of powers.

    J (n_x, F, n_y, n_u): sqrt(2) dG/dx.  error (F, n_y): C / M.  spread (F, n_u, n_u): |T|^2, from input l to column j.
    fixed (F, n_y, n_u): f.  used (F, n_y, n_u): elements in the fit.
    """

    J: ComplexArray
    error: FloatArray
    spread: FloatArray
    fixed: FloatArray
    used: BoolArray

    def information(self, P: FloatArray) -> FloatArray:
        """Return the information H (n_x, n_x) at powers P (F, n_u), summed over the experiments of a realisation."""
        rows = as_real(self.J * np.sqrt(self._weight(P))).reshape(len(self.J), -1)
        return rows @ rows.T

    def gains(self, P: FloatArray, gradient: FloatArray) -> FloatArray:
        """Return d Tr(gradient H) / d P (F, n_u), for a gradient (n_x, n_x) without negative eigenvalues."""
        eigenvalues, V = np.linalg.eigh(gradient)
        rows = (V * np.sqrt(np.maximum(eigenvalues, 0.0))).T @ as_real(self.J).reshape(len(self.J), -1)
        squares = np.sum(rows**2, axis=0).reshape(*self.used.shape, 2).sum(axis=-1)
        per_column = np.einsum("fij,fi->fj", squares * self._weight(P) ** 2, self.error)
        return np.asarray(np.einsum("flj,fj->fl", self.spread, per_column) / P**2)

    def _weight(self, P: FloatArray) -> FloatArray:
        variance = self.error[:, :, None] * np.einsum("flj,fl->fj", self.spread, 1 / P)[:, None, :] + self.fixed
        return np.where(self.used, 1 / variance, 0.0)


@dataclass(frozen=True, eq=False)
class CandidateInformation:
    """Information of candidates as a function of their fractions P (Q, 1); H (Q, n_x, n_x) of each."""

    H: FloatArray

    def information(self, P: FloatArray) -> FloatArray:
        """Return the information H (n_x, n_x) of a mixture."""
        return np.tensordot(P[:, 0], self.H, 1)

    def gains(self, P: FloatArray, gradient: FloatArray) -> FloatArray:
        """Return d Tr(gradient H) / d P (Q, 1), equal at all P."""
        return np.maximum(np.tensordot(self.H, gradient, 2), 0.0)[:, None]


# Groups of configurations, each with the information for each of S guesses.
Groups: TypeAlias = Sequence[Sequence[Sequence[PowerSource | CandidateInformation]]]


@dataclass(frozen=True)
class Powers:
    """Powers P (K, F, n_u) of each group of configurations.  value: phi.  gap: upper bound of its possible increase."""

    P: FloatArray
    value: float
    gap: float


def best_powers(
    groups: Groups, cost: FloatArray, criterion: DesignCriterion, prior: FloatArray, min_fraction: float,
    tolerance: float = MAX_GAP,
) -> Powers:  # fmt: skip
    """Return the optimal powers of each group, common to its configurations.

    cost (K, n_o, F, n_u): c of each group, positive for every input and line.  prior (S, n_x, n_x): earlier
    information.  min_fraction: epsilon.
    """
    even_power = even_powers(cost)
    best = Powers(even_power, float(criterion.value(_information(groups, even_power, prior))), 0.0)
    if min_fraction >= 1:
        return best
    budget = 1 - min_fraction * _limit_use(cost, even_power)
    powers, price, upper_bound = (1 - min_fraction) * even_power, np.ones_like(budget), np.inf
    for update in range(MAX_UPDATES):
        P = min_fraction * even_power + powers
        value, gradient = criterion.slope(_information(groups, P, prior))
        if value > best.value:
            best = replace(best, P=P, value=value)
        g = _power_gains(groups, P, gradient)
        ratio = g / np.einsum("ko,kofl->kfl", price, cost)
        dual_bound = float(1 + ratio.max() * np.sum(price * budget) - np.sum(g * powers))  # Tr(gradient M) is 1
        upper_bound = min(upper_bound, value + float(np.log(dual_bound)))
        if upper_bound - best.value <= tolerance:
            break
        exponent = (1 + update / 50) ** -0.5 if price.size > 1 else 1.0  # with one limit each update increases phi
        powers = powers * (ratio / ratio.max()) ** exponent
        use = _limit_use(cost, powers) / budget
        price = np.maximum(price * (use / use.max()) ** exponent, MIN_PRICE)
        price /= np.sum(price * budget)
        powers = powers / use.max(axis=1)[:, None, None]
    return replace(best, gap=max(upper_bound - best.value, 0.0))


def even_powers(cost: FloatArray) -> FloatArray:
    """Return powers P (K, F, n_u) that are equal at all lines of an input, with every input at some limit."""
    per_input = cost.sum(axis=2)
    powers = 1 / per_input.max(axis=1)
    for _ in range(30):
        use = np.einsum("kol,kl->ko", per_input, powers)
        # The most used limit to which an input contributes at least a tenth.
        is_contribution = per_input * powers[:, None, :] > 0.1 * use[..., None]
        powers = powers / np.max(np.where(is_contribution, use[..., None], 0.0), axis=1) ** 0.5
    powers = powers / np.einsum("kol,kl->ko", per_input, powers).max(axis=1, keepdims=True)
    return np.repeat(powers[:, None, :], cost.shape[2], axis=1)


def _limit_use(cost: FloatArray, P: FloatArray) -> FloatArray:
    """Return the used fraction (K, n_o) of each limit."""
    return np.asarray(np.einsum("kofl,kfl->ko", cost, P))


def _information(groups: Groups, P: FloatArray, prior: FloatArray) -> FloatArray:
    """Return the information M (S, n_x, n_x) of all groups and the prior."""
    M = prior.copy()
    for group, powers in zip(groups, P, strict=True):
        for configuration in group:
            M += np.stack([source.information(powers) for source in configuration])
    return M


def _power_gains(groups: Groups, P: FloatArray, gradient: FloatArray) -> FloatArray:
    """Return d phi / d P (K, F, n_u)."""
    gains = []
    for group, powers in zip(groups, P, strict=True):
        pairs = [pair for configuration in group for pair in zip(configuration, gradient, strict=True)]
        gains.append(sum(source.gains(powers, slope) for source, slope in pairs))
    return np.array(gains)
