r"""Optimal powers: the distribution of each input's power over the lines, with a bound on its optimality.

.. math:: \max_P\ \varphi\Big(M_0 + \sum_q H_q(P)\Big), \qquad \sum_{kl} c_{okl} P_{kl} \le 1, \quad
          P_{kl} \ge \epsilon \bar P_{kl}

.. math:: H = 2\,\mathrm{Re} \sum_{kij} \frac{J_{kij} J_{kij}^H}{\sigma_{kij}^2}, \qquad
          \sigma_{kij}^2 = \frac{C_{ki}}{M} \sum_l \frac{|T_{klj}|^2}{P_{kl}} + f_{kij}

c_o: cost of a power in terms of limit o: the RMS of an input, the torque, velocity ... of a motor.  T = I + F G: the
torques to be injected at l for an acting torque at j alone.  C: variance of the equation error.  f: variance that does
not depend on power (floor of the weights, distortion).  P bar: the even powers within the limits; epsilon of them keep
the response itself measurable at every line.

Each 1 / sigma^2 is concave in P, and so is phi (`optimal`): with g = d phi / d P no P* in reach is better than
phi + <g, P* - P>, and <g, P*> <= max g / h for any price h = sum_o mu_o c_o of a power. The multiplicative updates
P <- P (g / h)^a, mu_o <- mu_o (c_o P)^a converge to an equal ratio of gain and price at all lines with more than the
least power. (Silvey, Titterington and Torsney 1978 for one limit; for one input in the noise limit this is the optimal
spectrum of Mehra, IEEE Trans. Automatic Control 19 (1974) 753.)
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from elastid.base.arrays import BoolArray, ComplexArray, FloatArray
from elastid.design.optimal import DesignCriterion
from elastid.fit.problem.least_squares import as_real

# phi is the log of a mean information: a gap of 0.01 is half a percent of a standard deviation.
MAX_GAP = 0.01
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
    tolerance: float = MAX_GAP,
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
        g = _gains(groups, P, slope.gradient)
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


def _gains(groups: Sequence[Sequence[Sequence[PowerSource]]], P: FloatArray, gradient: FloatArray) -> FloatArray:
    """d phi / d P (K, F, n_u)."""
    gains = []
    for group, powers in zip(groups, P, strict=True):
        pairs = [pair for configuration in group for pair in zip(configuration, gradient, strict=True)]
        gains.append(sum(source.gains(powers, slope) for source, slope in pairs))
    return np.array(gains)
