r"""Repeats of one excitation as one experiment: they show the noise, but do not tell the response from the transient.

Of records whose inputs are proportional, R_e = c_e R, every combination with sum c_e a_e = 0 has no input: it
determines a transient of its own and nothing else.  The one combination with all of the input,

.. math:: \bar Z = \frac{\sum_e P_e c_e Z_e}{\sum_e P_e c_e^2}, \quad
          C_{\bar Z} = \frac{\sum_e P_e^2 c_e^2 C_{Z,e}}{(\sum_e P_e c_e^2)^2}

has the noise of a mean of sum P_e c_e^2 periods and one transient, smooth as theirs.  So windows are as wide as for a
single experiment, and their residual holds the errors of the local model, which repeats would hide.

A repeat that starts a little later has R_e = exp(-j omega tau) R, which no common gain describes, but within a window
it is as dependent.  Such records stay apart, and do not count where windows are sized.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from elastid.base.arrays import ComplexArray
from elastid.frf.local.transient import SettledSpectra

# Inputs that differ by less than this part, after the best gain, are repeats.
_MAX_DIFFERENCE = 0.2
# Correlation of two inputs within a window from which on they count as one excitation; random phases have 0.3.
_MAX_CORRELATION = 0.5


def independent_excitations(R: ComplexArray, n_w: int) -> int:
    """Number of the inputs R (E, F, n_u) that differ within windows of n_w lines, by more than a complex factor."""
    E, F, _ = R.shape
    if E == 1:
        return 1
    parts = np.array_split(R, max(1, F // n_w), axis=1)
    grams = np.array([np.einsum("efu,gfu->eg", part, part.conj()) for part in parts])
    powers = np.einsum("cee->ce", grams).real
    both = np.sum(np.sqrt(powers[:, :, None] * powers[:, None, :]), axis=0)
    # Where the inputs are strong counts most.
    correlation = np.divide(np.abs(grams).sum(axis=0), both, out=np.zeros((E, E)), where=both > 0)
    leaders: list[int] = []
    for e in range(E):
        if all(correlation[e, leader] < _MAX_CORRELATION for leader in leaders):
            leaders.append(e)
    return len(leaders)


def merge_repeats(spectra: Sequence[SettledSpectra], closed: bool) -> list[SettledSpectra]:
    """One experiment for each excitation, in order; those that occur once stay as they are.

    closed: the reference excites; otherwise the inputs do.
    """
    groups: list[list[SettledSpectra]] = []
    for each in spectra:
        own = next((g for g in groups if _gain(_driver(g[0], closed), _driver(each, closed)) is not None), None)
        if own is None:
            groups.append([each])
        else:
            own.append(each)
    return [group[0] if len(group) == 1 else _merged(group, closed) for group in groups]


def _driver(spectra: SettledSpectra, closed: bool) -> ComplexArray:
    return spectra.R if closed and spectra.R is not None else spectra.U


def _gain(of: ComplexArray, other: ComplexArray) -> float | None:
    """c with other = c of up to a small difference, both (F, n_u); None where there is none."""
    power, own = np.sum(np.abs(of) ** 2), np.sum(np.abs(other) ** 2)
    if power == 0 or own == 0:
        return None
    c = float(np.sum(of.conj() * other).real / power)
    return c if np.sum(np.abs(other - c * of) ** 2) < _MAX_DIFFERENCE**2 * own else None


def _merged(group: Sequence[SettledSpectra], closed: bool) -> SettledSpectra:
    """The combination of records with proportional inputs that has all of the input."""
    gains = [_gain(_driver(group[0], closed), _driver(each, closed)) or 1.0 for each in group]
    pairs = [(each.n_periods * c, each) for c, each in zip(gains, group, strict=True)]
    total = sum(weight * c for (weight, _), c in zip(pairs, gains, strict=True))
    known = [weight * each.R for weight, each in pairs if each.R is not None]
    dof = sum(each.dof for each in group)
    return SettledSpectra(
        Y=np.sum([weight * each.Y for weight, each in pairs], axis=0) / total,
        U=np.sum([weight * each.U for weight, each in pairs], axis=0) / total,
        R=np.sum(known, axis=0) / total if len(known) == len(group) else None,
        n_periods=total,
        settled=all(each.settled for each in group),
        noise=np.sum([weight**2 * each.noise for weight, each in pairs], axis=0) / total**2,
        dof=dof,
    )
