"""Misfit: whether a model that explains most of a response is wrong by more than its intervals hold.

Three things at once: residuals beyond noise and distortion, V over its expectation at least MIN_EXCESS and beyond what
chance explains; structured, in that blocks of a configuration and a band disagree about the parameters MIN_DISAGREEMENT
times as much as noise lets them; and they matter, in that the scatter over blocks moves a parameter by more than its
95 % interval under measured noise and declared floor.
"""

from __future__ import annotations

import numpy as np

from elastid.fit.result import QUANTILE, FitResult
from elastid.fit.uncertainty.covariance import Uncertainty
from elastid.fit.uncertainty.jackknife import is_in_error

# Over 1000 fits of true models V reached 1.13 of its expectation, and the disagreement of blocks, whose noise is less
# well known than that of all lines together, 1.4; their scatter 1.5 deviations (scripts/studies/misfit.py).
MIN_EXCESS = 1.2
MIN_DISAGREEMENT = 1.5
# A message names so many parameters, those that are moved most.
MAX_NAMED = 3


def describe_misfit(result: FitResult, uncertainty: Uncertainty, explained: float) -> str:
    """How the model is wrong, with its numbers and a remedy; nothing where it is not, or where no noise is known.

    explained: the share of the measured responses that the model explains.
    """
    excess = result.cost / result.cost_expected
    in_error = is_in_error(result.cost, result.cost_expected, result.dof) and excess > MIN_EXCESS
    if not in_error or not uncertainty.disagreement > MIN_DISAGREEMENT:
        return ""
    moved = np.flatnonzero(uncertainty.shift > QUANTILE)
    if not moved.size:
        return ""
    worst = moved[np.argsort(-uncertainty.shift[moved])]
    names = ", ".join(result.parameters.free_names[i] for i in worst[:MAX_NAMED])
    more = f" and {len(worst) - MAX_NAMED} more" if len(worst) > MAX_NAMED else ""
    floor = max(0.01, float(np.sqrt(max(1 - explained, 0.0))))
    return (
        "the model is wrong by more than noise and floor explain: blocks of a configuration and a band disagree about "
        f"the parameters {uncertainty.disagreement:.3g} times as much as noise would let them, and move {names}{more} "
        f"by up to {uncertainty.shift[worst[0]]:.3g} of the standard deviations that noise and floor leave; the "
        "intervals are by blocks, and do not hold an error that all blocks share; fit.weights.floor: "
        f"{floor:.1g} would declare all that the model does not explain"
    )
