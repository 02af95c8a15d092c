"""Readings of the responses that explain most of what V has beyond the noise, followed to an optimum.

A fit of responses that were read wrongly may end anywhere. So one evaluation at its optimum and one at its start
predict V of every reading, and the best of them take some steps on a few lines.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from elastid.base.arrays import BoolArray, FloatArray
from elastid.fit.diagnosis.modification.reading import Reading, evaluated_at, read, settled, thinned
from elastid.fit.diagnosis.modification.readings import readings
from elastid.fit.diagnosis.modification.scales import scaled
from elastid.fit.modification_index import ModificationIndex
from elastid.fit.problem.elastic import ElasticFit
from elastid.fit.result import FitResult
from elastid.fit.setup.assembly import RelinearisedOptimum

# So many readings are followed, of those whose V is predicted to be at most so many times that of the fit.
MAX_FOLLOWED = 3
MAX_PREDICTED_RATIO = 1.5
# A reading explains at least this share of the excess; readings whose V differ by less than this part are alike.
MIN_SHARE = 0.8
MAX_COST_RATIO = 1.1


def misreadings(optimum: RelinearisedOptimum, result: FitResult, noise_cost: float) -> tuple[ModificationIndex, ...]:
    """The best reading, and with it those that cannot be told from it; none where none explains enough."""
    fit, x = thinned(optimum.fit), optimum.end.x
    everything = np.ones(len(x), dtype=bool)
    here = evaluated_at(fit, x)
    costs = np.array([float(one.residual @ one.residual) for one in here])
    tried = _predicted(fit, [(x, ~result.at_bound), (fit.parameters.x, everything)], costs)
    found: dict[str, tuple[float, FloatArray, Reading]] = {}
    for cost, reading, start in sorted(tried, key=lambda one: one[0]):
        if len(found) >= MAX_FOLLOWED or cost > MAX_PREDICTED_RATIO * costs.sum():
            break
        if reading.name not in found:
            found[reading.name] = (*settled(reading, fit, start, everything), reading)
    noise = noise_cost * fit.n_residuals / max(optimum.fit.n_residuals, 1)
    excess = max(float(costs.sum()) - noise, 1e-300)

    def enough(cost: float) -> bool:
        return bool(costs.sum() - cost > MIN_SHARE * excess)

    if not any(enough(cost) for cost, _, _ in found.values()):
        for name, cost, there in scaled(fit, (fit.parameters.x, x)):
            found[name] = (cost, there, Reading(name, "scale", lambda _, values: values))
    good = sorted((one for one in found.values() if enough(one[0])), key=lambda one: one[0])
    if not good:
        return ()
    cost, there, best = good[0]
    alike = tuple(one[2].name for one in good[1:] if one[0] < MAX_COST_RATIO * cost)
    share = (float(costs.sum()) - cost) / excess
    whole = share * max(result.cost - noise_cost, 0.0)
    return (
        ModificationIndex(
            best.name, best.group, (), np.zeros(0), (), (), np.zeros(0), math.nan, whole, share, there - x, alike
        ),
    )


def _predicted(
    fit: ElasticFit, starts: Sequence[tuple[FloatArray, BoolArray]], costs: FloatArray
) -> list[tuple[float, Reading, FloatArray]]:
    """V of every reading after one step from each start."""
    found = []
    for x, free in starts:
        there = evaluated_at(fit, x)
        for reading in readings(there, costs):
            found.append((read(reading, there, fit.prior_slopes, free).cost, reading, x))
    return found
