r"""Search for the elastic coordinates of a robot, forward and backward, with the evidence of each step.

The search starts with elastic gears of the driven joints and all other coordinates rigid. A free coordinate, with its
parameters, is justified if

.. math:: \bar d > \frac{s_d}{\sqrt{n}}, \quad d_c = m_c(\mathrm{rigid}) - m_c(\mathrm{free})
          \qquad\text{and}\qquad \mathrm{QAIC}(\mathrm{free}) < \mathrm{QAIC}(\mathrm{rigid})

d_c: decrease of the misfit m_c of validation configuration c (`comparison`); mean and standard deviation s_d over the n
configurations. A decrease in one configuration only has a mean of exactly one standard error and is not justified.

The first of these steps that leads to a new, justified model is taken: a freed coordinate becomes rigid; the coordinate
with the best prediction becomes free; all others become free together, because two springs may be visible only
together; a gear becomes rigid. Gears are last, because the stiffness of a gear is biased as long as another spring is
missing. The search ends without such a step, and need not find the best of the 2^n models.
"""

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Literal, TypeAlias

from elastid.validation.comparison import ComparedModel, Elastic, Trial

Fit: TypeAlias = Callable[[Sequence[Elastic]], Mapping[Elastic, ComparedModel]]


def search(coordinates: Sequence[str], fit: Fit, start: Elastic = ()) -> Iterator[Trial]:
    """Yield every trial of the search, as soon as its step is decided.

    fit: returns at least the requested models, with a common scale of QAIC.  start: elastic coordinates at the start.
    """
    visited = [start]
    while True:
        current = visited[-1]
        rigid = [name for name in coordinates if name not in current]
        stiffer = {name: tuple(other for other in current if other != name) for name in current}
        # A freed coordinate becomes rigid, one more free, all free, or one of the start rigid.
        for candidates in (
            [model for name, model in stiffer.items() if name not in start],
            [tuple(name for name in coordinates if name in current or name == free) for free in rigid],
            [tuple(coordinates)] if len(rigid) > 1 else [],
            [model for name, model in stiffer.items() if name in start],
        ):
            new = [model for model in candidates if model not in visited]
            rows = fit([current, *new])
            step, misfit = _best_step(rows, current, new), rows[current].mean_misfit
            for model in new:
                changed = tuple(name for name in coordinates if (name in model) != (name in current))
                becomes: Literal["free", "rigid"] = "free" if len(model) > len(current) else "rigid"
                yield Trial(len(visited), becomes, changed, model, misfit, rows[model].mean_misfit, model == step)
            if step is not None:
                visited.append(step)
                break
        else:
            return


def final_model(trials: Sequence[Trial], start: Elastic = ()) -> Elastic:
    """Return the elastic coordinates at the end of the search."""
    return next((trial.elastic for trial in reversed(trials) if trial.taken), start)


def describe_search(coordinates: Sequence[str], trials: Sequence[Trial], start: Elastic = ()) -> str:
    """Return the end of the search as a sentence."""
    if not any(math.isfinite(misfit) for trial in trials for misfit in (trial.before, trial.after)):
        return "The search has no result: no model could be fitted without each configuration; see compare.json."
    elastic = final_model(trials, start)
    rigid = [name for name in coordinates if name not in elastic]
    if not elastic:
        return f"The data show no elasticity: {', '.join(rigid)} can be rigid."
    sentence = f"Elastic coordinates are {', '.join(elastic)}"
    return sentence + (f"; {', '.join(rigid)} can be rigid with these data." if rigid else ".")


def is_justified(rigid: ComparedModel, free: ComparedModel) -> bool:
    """Return whether the model with more elastic coordinates predicts better by a standard error, with a lower QAIC."""
    if not math.isfinite(free.mean_misfit) or not math.isfinite(rigid.mean_misfit):
        return math.isfinite(free.mean_misfit)
    gain, standard_error = rigid.behind(free)
    return gain > standard_error and free.criterion < rigid.criterion


def _best_step(rows: Mapping[Elastic, ComparedModel], start: Elastic, candidates: Sequence[Elastic]) -> Elastic | None:
    """Return the candidate with the best prediction whose step from `start` is justified; None without any."""

    def is_step(model: Elastic) -> bool:
        if len(model) > len(start):
            return is_justified(rows[start], rows[model])
        return not is_justified(rows[model], rows[start])

    steps = filter(is_step, candidates)
    return min(steps, key=lambda model: (rows[model].mean_misfit, rows[model].criterion), default=None)
