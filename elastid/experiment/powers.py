r"""Optimal powers: how what each input may have is shared out between the lines, with a bound that certifies itself.

.. math:: \max_P\ \varphi\Big(M_0 + \sum_q H_q(P)\Big), \qquad \sum_k P_{kl} = \bar P_l, \quad
          P_{kl} \ge \epsilon \bar P_l / F

.. math:: H = 2\,\mathrm{Re} \sum_{kij} \frac{J_{kij} J_{kij}^H}{\sigma_{kij}^2}, \qquad
          \sigma_{kij}^2 = \frac{C_{ki}}{M} \sum_l \frac{|T_{klj}|^2}{P_{kl}} + f_{kij}

T = I + F G: what must be injected at l for a torque at j alone.  C: variance of the equation error.  f: what power does
not lower (the floor of the weights, distortion). Each 1 / sigma^2 is concave in P, and so is phi (`optimal`): with
g = d phi / d P no P* in reach is better than phi + <g, P* - P>. P_kl <- P_kl g_kl^c, normalised input by input, climbs
to where g is the same at all lines of an input that carry more than the least power. epsilon keeps the response itself
measurable at every line. (The update is that of Silvey, Titterington and Torsney 1978; for one input in the noise limit
it finds the optimal spectrum of Mehra, IEEE Trans. Automatic Control 19 (1974) 753.) It knows no robot.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from elastid.arrays import BoolArray, ComplexArray, FloatArray
from elastid.experiment.optimal import Criterion, Slope
from elastid.fit.residuals import as_real

# phi is the log of a mean information: a gap of 0.01 is half a percent of a standard deviation.
TOLERANCE = 0.01
MAX_UPDATES = 600


@dataclass(frozen=True, eq=False)
class Source:
    """What one configuration tells at any powers.

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
        H: FloatArray = rows @ rows.T
        return H

    def gains(self, P: FloatArray, gradient: FloatArray) -> FloatArray:
        """d Tr(gradient H) / d P (F, n_u), for a gradient (n_x, n_x) without negative eigenvalues."""
        eigenvalues, V = np.linalg.eigh(gradient)
        half = V * np.sqrt(np.maximum(eigenvalues, 0.0))
        rows = half.T @ as_real(self.J).reshape(len(self.J), -1)
        seen = np.sum(rows**2, axis=0).reshape(*self.used.shape, 2).sum(axis=-1)
        per_column = np.einsum("fij,fi->fj", seen * self._weight(P) ** 2, self.error)
        gains: FloatArray = np.einsum("flj,fj->fl", self.spread, per_column) / P**2
        return gains

    def _weight(self, P: FloatArray) -> FloatArray:
        column = np.einsum("flj,fl->fj", self.spread, 1 / P)
        variance = self.error[:, :, None] * column[:, None, :] + self.fixed
        weight: FloatArray = np.where(self.used, 1 / variance, 0.0)
        return weight


@dataclass(frozen=True)
class Powers:
    """P (K, F, n_u) of each group of configurations.  value: phi there.  even: phi with the same power at all lines.

    gap: no sharing of the same powers is better by more than this.
    """

    P: FloatArray
    value: float
    even: float
    gap: float


def best_powers(
    groups: Sequence[Sequence[Sequence[Source]]],
    total: FloatArray,
    criterion: Criterion,
    known: FloatArray,
    least: float,
    tolerance: float = TOLERANCE,
) -> Powers:
    """The best sharing, where all configurations of a group have the same powers.

    groups: for each group its configurations, for each of these a Source for each of S guesses.  total (n_u,): what the
    powers of each input add up to.  known (S, n_x, n_x): information that is there already.  least: epsilon.
    """
    F = len(groups[0][0][0].error)
    even = np.broadcast_to(total / F, (len(groups), F, len(total)))
    share = np.full(even.shape, 1 / F)

    def powers(share: FloatArray) -> FloatArray:
        P: FloatArray = least * even + (1 - least) * total * share
        return P

    M = _information(groups, powers(share), known)
    slope = start = criterion.slope(M)
    exponent, gap = 1.0, np.inf
    for _ in range(MAX_UPDATES):
        g = _gains(groups, powers(share), slope) * (1 - least) * total
        # phi is the log of what Tr(gradient M) bounds, 1 here but for a smallest eigenvalue taken softly.
        here = float(np.sum(slope.gradient * M))
        gap = slope.slack + float(np.log(here + np.sum(g.max(axis=1)) - np.sum(share * g)))
        if gap <= tolerance or exponent < 1e-3:
            break
        tried = share * (g / g.max(axis=1, keepdims=True)) ** exponent
        tried /= tried.sum(axis=1, keepdims=True)
        M_tried = _information(groups, powers(tried), known)
        moved = criterion.slope(M_tried)
        if moved.searched < slope.searched:
            exponent /= 2
            continue
        share, slope, M = tried, moved, M_tried
        exponent = min(1.2 * exponent, 2.0)
    return Powers(powers(share), slope.value, start.value, gap)


def _information(groups: Sequence[Sequence[Sequence[Source]]], P: FloatArray, known: FloatArray) -> FloatArray:
    """M (S, n_x, n_x)."""
    M = known.copy()
    for group, powers in zip(groups, P, strict=True):
        for configuration in group:
            M += np.stack([source.information(powers) for source in configuration])
    return M


def _gains(groups: Sequence[Sequence[Sequence[Source]]], P: FloatArray, slope: Slope) -> FloatArray:
    """d phi / d P (K, F, n_u)."""
    gains = [
        sum(
            source.gains(powers, gradient)
            for configuration in group
            for source, gradient in zip(configuration, slope.gradient, strict=True)
        )
        for group, powers in zip(groups, P, strict=True)
    ]
    return np.array(gains)
