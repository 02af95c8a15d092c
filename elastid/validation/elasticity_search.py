r"""Where does the elasticity sit? A search backward and forward over the elastic coordinates, with the evidence.

It begins with the gears of the driven joints elastic and all others rigid. Freeing one, with its parameters, is worth
it where

.. math:: \bar d > \frac{s_d}{\sqrt{n}}, \quad d_c = m_c(\mathrm{rigid}) - m_c(\mathrm{free})
          \qquad\text{and}\qquad \mathrm{QAIC}(\mathrm{free}) < \mathrm{QAIC}(\mathrm{rigid})

d_c: by how much the misfit m_c of configuration c, left out of both fits, falls; mean and standard deviation s_d over
the n configurations. (m_c and QAIC: `comparison`.) What helps in a single configuration only has a mean of just one
standard error and is not worth it. A step makes rigid what was freed, is not worth it, and is missed least; where there
is none, it frees the coordinate that is worth it and predicts best; where there is none of these, all the rest at once,
since two springs may show only together; and only then it makes rigid the gear that is not worth it: while a spring is
lacking elsewhere, a gear may look like anything. It ends where no step is left that leads to a model not held before.

Found step by step, the model need not be the best of all: 2^n of them are not fitted.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Literal, TypeAlias

from elastid.validation.compare import Row

# The coordinates that are elastic in a model, in the order of the robot, by their labels.
Elastic: TypeAlias = tuple[str, ...]
Fitted: TypeAlias = Callable[[Sequence[Elastic]], Mapping[Elastic, Row]]


@dataclass(frozen=True)
class Trial:
    """A model tried in a step: `coordinates` become free or rigid, which leaves `elastic` ones and n_free parameters.

    before, after: misfit of left-out configurations, mean.  change, standard_error: after - before, paired over the
    configurations.  criterion: change of QAIC.  NaN where one of both has no fit.  taken: whether the search goes on
    from there.
    """

    step: int
    becomes: Literal["free", "rigid"]
    coordinates: tuple[str, ...]
    elastic: Elastic
    n_free: int
    before: float
    after: float
    change: float
    standard_error: float
    criterion: float
    taken: bool


def search(coordinates: Sequence[str], fitted: Fitted, start: Elastic = ()) -> Iterator[Trial]:
    """Every trial, as soon as its step is decided; `found` says where they lead.

    fitted: the rows of at least the models asked for, under one scale of QAIC.  start: what is elastic to begin with.
    """
    held: tuple[Elastic, ...] = (start,)
    while True:
        for candidates in _steps(coordinates, held[-1], start):
            new = [model for model in candidates if model not in held]
            rows = fitted([held[-1], *new])
            chosen = _chosen(rows, held[-1], new)
            for model in new:
                yield _trial(len(held), rows, held[-1], model, model == chosen)
            if chosen is not None:
                held = (*held, chosen)
                break
        else:
            return


def found(trials: Sequence[Trial], start: Elastic = ()) -> Elastic:
    """The coordinates that are elastic where the search ends."""
    return next((trial.elastic for trial in reversed(trials) if trial.taken), start)


def found_words(coordinates: Sequence[str], trials: Sequence[Trial], start: Elastic = ()) -> str:
    """The same as a sentence."""
    if not any(math.isfinite(misfit) for trial in trials for misfit in (trial.before, trial.after)):
        return "The search has nothing to go by: no model could be held against every configuration left out."
    elastic = found(trials, start)
    rigid = [name for name in coordinates if name not in elastic]
    if not elastic:
        return f"These data show no elasticity: {', '.join(rigid)} can be rigid."
    words = f"The elasticity sits in {', '.join(elastic)}"
    return words + (f"; {', '.join(rigid)} can be rigid by these data." if rigid else ".")


def is_worth_it(rigid: Row, free: Row) -> bool:
    """Whether a model with more free coordinates predicts better by more than its standard error, at a lower QAIC."""
    if not math.isfinite(free.mean_misfit):
        return False
    if not math.isfinite(rigid.mean_misfit):
        return True
    gain, standard_error = rigid.behind(free)
    return gain > standard_error and free.criterion < rigid.criterion


def _steps(coordinates: Sequence[str], model: Elastic, start: Elastic) -> Iterator[list[Elastic]]:
    """The models to try from this one: one more rigid, one more free, all free, one of the start rigid."""
    yield [_without(model, freed) for freed in model if freed not in start]
    yield [tuple(name for name in coordinates if name in model or name == free) for free in _others(coordinates, model)]
    yield [tuple(coordinates)] if len(_others(coordinates, model)) > 1 else []
    yield [_without(model, first) for first in model if first in start]


def _without(model: Elastic, rigid: str) -> Elastic:
    return tuple(name for name in model if name != rigid)


def _others(coordinates: Sequence[str], model: Elastic) -> list[str]:
    return [name for name in coordinates if name not in model]


def _chosen(rows: Mapping[Elastic, Row], now: Elastic, tried: Sequence[Elastic]) -> Elastic | None:
    """The one of the models tried that predicts best, of those to which the evidence leads."""
    good = [
        model
        for model in tried
        if (is_worth_it(rows[now], rows[model]) if len(model) > len(now) else not is_worth_it(rows[model], rows[now]))
    ]
    return min(good, key=lambda model: (rows[model].mean_misfit, rows[model].criterion), default=None)


def _trial(step: int, rows: Mapping[Elastic, Row], now: Elastic, model: Elastic, taken: bool) -> Trial:
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
