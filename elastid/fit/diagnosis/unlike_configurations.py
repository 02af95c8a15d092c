"""Configurations that the model explains far worse than the others, and those without which it explains the rest."""

from __future__ import annotations

from dataclasses import replace
from itertools import combinations

import numpy as np

from elastid.base.arrays import FloatArray
from elastid.base.note import Note
from elastid.fit.diagnosis.modification.reading import as_read, settled, thinned
from elastid.fit.problem.elastic import ElasticFit

# Residuals of a configuration over the median of all beyond which it is unlike the others.
MAX_RESIDUAL_RATIO = 5.0
# Without foreign configurations the others have at most this share of the cost that they have with them.
MAX_COST_RATIO = 0.1
# Up to so many configurations, two of them are left out at once.
MAX_CONFIGURATIONS_IN_PAIRS = 6


def find_unlike_configurations(fit: ElasticFit, x: FloatArray) -> tuple[Note, ...]:
    """A note on each configuration that the model at x explains far worse than the others."""
    level = {}
    for part in fit.parts:
        if part.n_residuals:
            name = part.configuration
            level[name] = np.sqrt(part.normal.at(fit.theta(part, x))[0] / part.n_residuals)
    if len(level) < 3:
        return ()
    usual = float(np.median(list(level.values())))
    return tuple(
        Note(
            "unlike-configuration",
            f"its residuals are {one / usual:.0f} times those of the other configurations; is it of "
            "the same robot, with the same load, at the stated angles?",
            f"configuration {name}",
        )
        for name, one in level.items()
        if one > MAX_RESIDUAL_RATIO * usual
    )


def find_foreign_configurations(fit: ElasticFit, x: FloatArray) -> tuple[Note, ...]:
    """A note on one configuration, or two of a few, without which the model explains the others far better."""
    thin, Q = thinned(fit), len(fit.parts)
    free = np.ones(len(x), dtype=bool)
    for size in range(1, 3 if Q <= MAX_CONFIGURATIONS_IN_PAIRS else 2):
        found: dict[tuple[int, ...], float] = {}
        for left_out in combinations(range(Q), size) if Q - size >= 2 else ():
            rest = replace(thin, parts=tuple(part for i, part in enumerate(thin.parts) if i not in left_out))
            here = rest.evaluate(x).cost
            V = min(settled(as_read(), rest, start, free)[0] for start in (x, fit.parameters.x))
            if MAX_COST_RATIO * here >= V:
                found[left_out] = V / here
        if found:
            best = min(found, key=lambda one: found[one])
            names = " and ".join(fit.parts[i].configuration for i in best)
            return (
                Note(
                    "foreign-configuration",
                    f"without configuration {names} the model fits the others far better (V of these falls to "
                    f"{100 * found[best]:.2g} %): are they of the same robot, with the same load, at the "
                    "stated angles?",
                ),
            )
    return ()
