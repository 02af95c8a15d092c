r"""Search for the elastic coordinates of a robot, stepwise forward and backward, with the evidence of each step.

It starts with the gears of the driven joints elastic and all others rigid. Freeing a coordinate, with its parameters,
is justified where

.. math:: \bar d > \frac{s_d}{\sqrt{n}}, \quad d_c = m_c(\mathrm{rigid}) - m_c(\mathrm{free})
          \qquad\text{and}\qquad \mathrm{QAIC}(\mathrm{free}) < \mathrm{QAIC}(\mathrm{rigid})

d_c: decrease of the misfit m_c of configuration c, left out of both fits; mean and standard deviation s_d over the n
configurations. (m_c and QAIC: `compare`.) A gain in a single configuration has a mean of just one standard error and
does not count. A step makes that freed coordinate rigid which is not justified and contributes least; if there is none,
it frees the justified one that predicts best; if there is none, all the rest at once, since two springs may show only
together; and only then it makes an unjustified gear rigid, since the stiffness of a gear is meaningless while a spring
is lacking elsewhere. It ends where no step leads to a model that was not visited before.

A stepwise search need not find the best of the 2^n models.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import TypeAlias

from elastid.validation.comparison import ComparedModel, Elastic, Trial

Fit: TypeAlias = Callable[[Sequence[Elastic]], Mapping[Elastic, ComparedModel]]


def search(coordinates: Sequence[str], fit: Fit, start: Elastic = ()) -> Iterator[Trial]:
    """Every trial, as soon as its step is decided; `final_model` is where they end.

    fit: gives at least the models asked for, under one scale of QAIC.  start: elastic at the start.
    """
    visited: tuple[Elastic, ...] = (start,)
    while True:
        for candidates in _steps(coordinates, visited[-1], start):
            new = [model for model in candidates if model not in visited]
            rows = fit([visited[-1], *new])
            chosen = _chosen(rows, visited[-1], new)
            for model in new:
                yield _trial(len(visited), rows, visited[-1], model, model == chosen)
            if chosen is not None:
                visited = (*visited, chosen)
                break
        else:
            return


def final_model(trials: Sequence[Trial], start: Elastic = ()) -> Elastic:
    """The coordinates that are elastic at the end of the search."""
    return next((trial.elastic for trial in reversed(trials) if trial.taken), start)


def describe_search(coordinates: Sequence[str], trials: Sequence[Trial], start: Elastic = ()) -> str:
    """The end of the search as a sentence."""
    if not any(math.isfinite(misfit) for trial in trials for misfit in (trial.before, trial.after)):
        return "The search has no result: no model could be fitted without each configuration; see compare.json."
    elastic = final_model(trials, start)
    rigid = [name for name in coordinates if name not in elastic]
    if not elastic:
        return f"The data show no elasticity: {', '.join(rigid)} can be rigid."
    words = f"Elastic coordinates are {', '.join(elastic)}"
    return words + (f"; {', '.join(rigid)} can be rigid with these data." if rigid else ".")


def is_justified(rigid: ComparedModel, free: ComparedModel) -> bool:
    """True if the model with more elastic coordinates predicts better by its standard error, at a lower QAIC."""
    if not math.isfinite(free.mean_misfit):
        return False
    if not math.isfinite(rigid.mean_misfit):
        return True
    gain, standard_error = rigid.behind(free)
    return gain > standard_error and free.criterion < rigid.criterion


def _steps(coordinates: Sequence[str], model: Elastic, start: Elastic) -> Iterator[list[Elastic]]:
    """The models to try from this one: a freed coordinate rigid, one more free, all free, one of the start rigid."""
    yield [_without(model, freed) for freed in model if freed not in start]
    yield [tuple(name for name in coordinates if name in model or name == free) for free in _others(coordinates, model)]
    yield [tuple(coordinates)] if len(_others(coordinates, model)) > 1 else []
    yield [_without(model, first) for first in model if first in start]


def _without(model: Elastic, rigid: str) -> Elastic:
    return tuple(name for name in model if name != rigid)


def _others(coordinates: Sequence[str], model: Elastic) -> list[str]:
    return [name for name in coordinates if name not in model]


def _chosen(rows: Mapping[Elastic, ComparedModel], now: Elastic, tried: Sequence[Elastic]) -> Elastic | None:
    """The model that predicts best of those tried whose step is justified; None without any."""
    good = [
        model
        for model in tried
        if (is_justified(rows[now], rows[model]) if len(model) > len(now) else not is_justified(rows[model], rows[now]))
    ]
    return min(good, key=lambda model: (rows[model].mean_misfit, rows[model].criterion), default=None)


def _trial(step: int, rows: Mapping[Elastic, ComparedModel], now: Elastic, model: Elastic, taken: bool) -> Trial:
    before, after = rows[now], rows[model]
    freed = len(model) > len(now)
    change, standard_error = after.behind(before)
    both = math.isfinite(before.criterion) and math.isfinite(after.criterion)
    return Trial(
        step=step,
        becomes="free" if freed else "rigid",
        coordinates=tuple(_others(model, now) if freed else _others(now, model)),
        elastic=model,
        n_free=after.n_free,
        before=before.mean_misfit,
        after=after.mean_misfit,
        change=change,
        standard_error=standard_error,
        criterion=after.criterion - before.criterion if both else math.nan,
        taken=taken,
    )
