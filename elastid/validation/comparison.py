r"""Predictions of left-out configurations: refits, folds, ranked models; the stepwise search for elastic coordinates.

The search goes forward and backward, with the evidence of each step. It starts with the gears of the driven joints
elastic and all others rigid. Freeing a coordinate, with its parameters, is justified where

.. math:: \bar d > \frac{s_d}{\sqrt{n}}, \quad d_c = m_c(\mathrm{rigid}) - m_c(\mathrm{free})
          \qquad\text{and}\qquad \mathrm{QAIC}(\mathrm{free}) < \mathrm{QAIC}(\mathrm{rigid})

d_c: decrease of the misfit m_c of configuration c, left out of both fits; mean and standard deviation s_d over the n
configurations. (m_c and QAIC: `compare`.) A gain in a single configuration has a mean of just one standard error and
does not count. A step makes that freed coordinate rigid which is not justified and contributes least; if there is none,
it frees the justified one that predicts best; if there is none, all the rest at once, since two springs may show only
together; and only then it makes an unjustified gear rigid, since the stiffness of a gear is meaningless while a spring
is lacking elsewhere. It ends where no step leads to a model that was not visited before, and need not find the best of
the 2^n models.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Literal, TypeAlias

import numpy as np

from elastid.base.arrays import FloatArray, frozen_value
from elastid.base.names import posture_of
from elastid.validation.results import Agreement, Fold

# The coordinates that are elastic in a model, in the order of the robot, by their labels.
Elastic: TypeAlias = tuple[str, ...]


@dataclass(frozen=True)
class Refit:
    """How a fit without some configurations ended.  cost, n_free and dof: of the fit; left_out: by configuration.

    status: that of the fit, or `failed`, with the reason as message.
    """

    status: str
    message: str
    n_free: int
    cost: float
    dof: int
    left_out: dict[str, Fold]

    def fold(self, configuration: str) -> Fold:
        """Fold of a configuration left out."""
        unknown = Fold(configuration, math.nan, math.nan, math.nan, self.message)
        return self.left_out.get(configuration, unknown)


@frozen_value
class ComparedModel:
    """A model in the ranking.  misfit (n_c,): by configuration, NaN where none was left out or the fit failed.

    criterion: QAIC above the smallest.  rms_log_db, phase_rms_deg: over the left-out configurations.
    """

    name: str
    n_free: int
    cost: float
    dof: int
    criterion: float
    misfit: FloatArray
    rms_log_db: float
    phase_rms_deg: float
    note: str = ""

    @property
    def mean_misfit(self) -> float:
        """Mean misfit over the configurations; infinite where one of them is not known."""
        return float(self.misfit.mean()) if self.misfit.size and np.isfinite(self.misfit).all() else math.inf

    def behind(self, best: ComparedModel) -> tuple[float, float]:
        """Mean difference of the misfits to the best model's, and its standard error."""
        difference = self.misfit - best.misfit
        n = difference.size
        return float(difference.mean()), float(difference.std(ddof=1) / math.sqrt(n)) if n > 1 else math.inf


@dataclass(frozen=True)
class Trial:
    """A model tried in a step: `coordinates` become free or rigid, which leaves `elastic` ones and n_free parameters.

    before, after: misfit of left-out configurations, mean.  change, standard_error: after - before, paired over the
    configurations.  criterion: change of QAIC.  NaN where one of both has no fit.  taken: true if the search continues
    from it.
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


@dataclass(frozen=True)
class Comparison:
    """The models, the one that predicts best first (by the criterion where nothing was left out), and a verdict.

    trials: of the search that tried these models, in its order; none where they were given.
    """

    configurations: tuple[str, ...]
    rows: tuple[ComparedModel, ...]
    verdict: str
    trials: tuple[Trial, ...] = ()


def generalises(left_out_db: float, fitted_db: float) -> bool:
    """True if a model with these errors holds in left-out configurations: at most half as much more, plus 0.1 dB."""
    return left_out_db <= 1.5 * fitted_db + 0.1


def divide(names: Sequence[str], parts: int) -> tuple[tuple[str, ...], ...]:
    """The configurations in so many parts, each in one of them; 0: one a part. None for a single configuration.

    The amplitudes of a posture are in one part: either would predict the other.
    """
    postures = list(dict.fromkeys(map(posture_of, names)))
    n = min(parts or len(postures), len(postures))
    own = [postures[i::n] for i in range(n)] if n > 1 else []
    return tuple(tuple(name for name in names if posture_of(name) in part) for part in own)


def gather_folds(parts: Sequence[Sequence[str]], refits: Sequence[Refit]) -> tuple[Fold, ...]:
    """One fold for each configuration; parts: the configurations left out of each of the refits."""
    pairs = zip(parts, refits, strict=True)
    return tuple(refit.fold(name) for part, refit in pairs for name in part)


def describe_folds(folds: Sequence[Fold], fitted: Sequence[Agreement]) -> str:
    """The errors of the folds compared with those of the fit to all, with advice."""
    failed = [fold for fold in folds if math.isnan(fold.rms_log_db)]
    met = [fold for fold in folds if fold not in failed]
    if not met:
        return f"Cross-validation: every fit without some configurations failed; the first with: {failed[0].message}"
    of_all = {a.configuration: a.overall_rms_log_db for a in fitted}
    db = math.sqrt(np.mean([fold.rms_log_db**2 for fold in met]))
    of_fit = math.sqrt(np.mean([of_all[fold.configuration] ** 2 for fold in met]))
    worst = max(met, key=lambda fold: fold.rms_log_db)
    words = (
        f"Cross-validation: the fit to the others predicts a left-out configuration with {db:.2g} dB rms, the fit to "
        f"all has {of_fit:.2g} dB; worst is {worst.configuration} with {worst.rms_log_db:.2g} dB. "
    )
    words += (
        "The parameters do not depend on single configurations."
        if generalises(db, of_fit)
        else f"Some parameters depend on single configurations; measure more configurations like {worst.configuration}."
    )
    if failed:
        names = ", ".join(fold.configuration for fold in failed)
        words += f" The fit without {names} failed: {failed[0].message}"
    return words


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
    others = _others(coordinates, model)
    yield [tuple(_others(model, [freed])) for freed in model if freed not in start]
    yield [tuple(name for name in coordinates if name in model or name == free) for free in others]
    yield [tuple(coordinates)] if len(others) > 1 else []
    yield [tuple(_others(model, [first])) for first in model if first in start]


def _others(coordinates: Sequence[str], model: Sequence[str]) -> list[str]:
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
