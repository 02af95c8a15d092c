"""Configurations that the model explains far worse than the others, and those without which it explains the rest."""

from __future__ import annotations

from dataclasses import replace
from itertools import combinations

import numpy as np

from elastid.base.arrays import FloatArray
from elastid.base.note import Note
from elastid.fit.diagnosis.modification.reading import as_read, settled, thinned
from elastid.fit.diagnosis.two_robots import measured
from elastid.fit.problem.elastic import ElasticFit

# Residuals of a configuration over the median of all beyond which it is unlike the others.
MAX_RESIDUAL_RATIO = 5.0
# Without foreign configurations the others have at most this share of the cost that they have with them.
MAX_COST_RATIO = 0.1
# And at most so much of it with the parameters of each one's own.
MAX_COST_RATIO_ALONE = 0.5
# Steps that lower V by less than this part do not lead there.
MIN_DECREASE = 0.1
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


def find_foreign_configurations(fit: ElasticFit, x: FloatArray, alone: FloatArray | None = None) -> tuple[Note, ...]:
    """A note on one configuration, or two of a few, without which the model explains the others far better.

    alone: of `costs_alone`, where it is known; others that own parameters do not describe better are not looked at.
    """
    fit = measured(fit)
    thin, Q = thinned(fit), len(fit.parts)
    own = np.zeros(Q) if alone is None else np.diag(alone)
    common = np.array([part.normal.at(fit.theta(part, x))[0] for part in fit.parts])
    free = np.ones(len(x), dtype=bool)
    for size in range(1, 3 if Q <= MAX_CONFIGURATIONS_IN_PAIRS else 2):
        found: dict[tuple[int, ...], float] = {}
        for left_out in combinations(range(Q), size) if Q - size >= 2 else ():
            others = [i for i in range(Q) if i not in left_out]
            if own[others].sum() > MAX_COST_RATIO_ALONE * common[others].sum():
                continue
            rest = replace(thin, parts=tuple(thin.parts[i] for i in others))
            here = rest.evaluate(x).cost
            V = min(settled(as_read(), rest, start, free, MIN_DECREASE)[0] for start in (x, fit.parameters.x))
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
