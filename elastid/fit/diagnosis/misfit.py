"""Misfit: whether a model that explains most of a response is wrong by more than its intervals hold.

By blocks of a configuration and a band, where three things hold at once: residuals exceed noise and distortion, V over
its expectation by MIN_EXCESS and beyond what chance explains; they are structured, so that blocks disagree about the
parameters MIN_DISAGREEMENT times as much as noise lets them, and MIN_STRUCTURE times as much as white residuals of
their size would; and they matter, since the interval of a parameter by the scatter over blocks is MIN_SHIFT times the
one by measured noise and declared floor.

By a number that the fit held, or a spring that the robot's file lacks, where all blocks may err alike or V is that of
the noise: a single one, or a common factor of several, whose freeing lowers V, in which the declared floor counts as
noise, by MIN_DROP, and moves a parameter by MIN_EFFECT of its standard deviations.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from elastid.fit.diagnosis.modification.sentences import phrase
from elastid.fit.modification_index import ModificationIndex
from elastid.fit.result import FitResult
from elastid.fit.uncertainty.covariance import Uncertainty

# Far beyond what fits of true models reach (scripts/studies/misfit.py): V 1.13 of its expectation, and the disagreement
# of blocks, whose noise is less well known than that of all lines together, 1.4.
MIN_EXCESS = 1.2
MIN_DISAGREEMENT = 1.5
MIN_STRUCTURE = 1.3
MIN_SHIFT = 1.5
# More than five standard deviations of one number. Of 330 true models, some with a variance of two degrees of freedom,
# no number reached 20; friction in a simulated arm of three axes reached 61, with an effect of 2.1 deviations. A spring
# that lacks lowers V by 44 to 87 where V shows nothing (scripts/studies/misfit.py, 5 % of noise).
MIN_DROP = 30.0
MIN_EFFECT = 3.0
# A message names so many parameters, those that are moved most.
MAX_NAMED = 3


def describe_misfit(result: FitResult, uncertainty: Uncertainty) -> str:
    """How the model is wrong, with its numbers; nothing where it is not, or where no noise is known."""
    return _by_blocks(result, uncertainty) or _by_held_number(result, uncertainty)


def telling_index(
    result: FitResult, uncertainty: Uncertainty, indices: Sequence[ModificationIndex]
) -> ModificationIndex | None:
    """The held number, freed alone, that shows the model to be wrong by more than the intervals, if one does."""
    if np.isnan(uncertainty.disagreement):  # no noise is known
        return None
    # Of one direction: where several numbers are free at once, noise alone moves parameters far.
    reach = MIN_EFFECT * np.sqrt(np.diag(result.covariance))
    telling = (
        one
        for one in indices
        if one.place == 0
        and len(set(one.steps.tolist())) == 1
        and one.drop > MIN_DROP
        and np.any(np.abs(one.effects) > reach)
    )
    return max(telling, key=lambda one: one.drop, default=None)


def _by_blocks(result: FitResult, uncertainty: Uncertainty) -> str:
    excess = result.cost / result.cost_expected
    in_error = result.exceeds_noise and excess > MIN_EXCESS
    moved = np.flatnonzero(uncertainty.shift > MIN_SHIFT)
    if not in_error or not uncertainty.disagreement > max(MIN_DISAGREEMENT, MIN_STRUCTURE * excess) or not moved.size:
        return ""
    worst = moved[np.argsort(-uncertainty.shift[moved])]
    names = ", ".join(result.parameters.free_names[i] for i in worst[:MAX_NAMED])
    more = f" and {len(worst) - MAX_NAMED} more" if len(worst) > MAX_NAMED else ""
    return (
        "the model is wrong by more than noise and floor explain: blocks of a configuration and a band disagree about "
        f"the parameters {uncertainty.disagreement:.3g} times as much as noise would let them, and move {names}{more} "
        f"by up to {uncertainty.shift[worst[0]]:.3g} of the standard deviations that noise and floor leave; the "
        "intervals are by blocks, and do not hold an error that all blocks share"
    )


def _by_held_number(result: FitResult, uncertainty: Uncertainty) -> str:
    one = telling_index(result, uncertainty, result.indices)
    if one is None:
        return ""
    with np.errstate(divide="ignore", invalid="ignore"):
        moved = np.nan_to_num(np.abs(one.effects) / np.sqrt(np.diag(result.covariance)))
    worst = int(np.argmax(moved))
    others = f", or {' or '.join(one.alike)}, which the data cannot tell from it," if one.alike else ""
    return (
        f"the model is wrong by more than the intervals say: {phrase(one)}{others} would lower V by {one.drop:.0f}, "
        f"and move {result.parameters.free_names[worst]} by {moved[worst]:.1f} of its standard deviations"
    )
