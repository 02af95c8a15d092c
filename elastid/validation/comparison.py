r"""Models of one robot compared on the same frequency responses, by their predictions of left-out ones; a search.

Each model is fitted to all configurations, and again without each part of them. Its misfit on a left-out configuration
c, and the information criterion of its fit to all, are

.. math:: m_c = \frac{1}{n_c} \sum_k \frac{|\hat G - G|^2}{\sigma^2}, \qquad
          \mathrm{QAIC} = V / \hat c + 2 n_x

m_c: mean over the elements and lines that count, 1 for the noise of the weights alone. c: V / dof of the model that
fits best, so that an error common to all models is no evidence; only differences of QAIC are meaningful (Burnham &
Anderson, Model Selection and Multimodel Inference, 2002, section 2.5). It assumes independent residuals of lines, which
a model error violates: where the two disagree, trust the left-out configurations.

Two models are distinguished where the mean over configurations of m_c - m_c(best) exceeds its standard error and
0.1 %, the relative difference between two fits of one model.

The search for elastic coordinates goes forward and backward, with the evidence of each step. It starts with the gears
of the driven joints elastic and all others rigid. Freeing a coordinate, with its parameters, is justified where

.. math:: \bar d > \frac{s_d}{\sqrt{n}}, \quad d_c = m_c(\mathrm{rigid}) - m_c(\mathrm{free})
          \qquad\text{and}\qquad \mathrm{QAIC}(\mathrm{free}) < \mathrm{QAIC}(\mathrm{rigid})

d_c: decrease of the misfit m_c of configuration c, left out of both fits; mean and standard deviation s_d over the n
configurations. A gain in a single configuration has a mean of just one standard error and
does not count. A step makes that freed coordinate rigid which is not justified and contributes least; if there is none,
it frees the justified one that predicts best; if there is none, all the rest at once, since two springs may show only
together; and only then it makes an unjustified gear rigid, since the stiffness of a gear is meaningless while a spring
is lacking elsewhere. It ends where no step leads to a model that was not visited before, and need not find the best of
the 2^n models.
"""

import math
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Literal, TypeAlias

import numpy as np

from elastid.base.arrays import FloatArray, frozen_value
from elastid.base.errors import ElastidError, StudyError
from elastid.base.names import match_names, posture_of
from elastid.fit.fitted_robot import FittedRobot
from elastid.fit.identify import fit_parameters
from elastid.fit.parameter_selection import choose
from elastid.fit.problem.weights import weigh
from elastid.fit.spec import FitSpec, ParameterSpec
from elastid.model.spec import ModelSpec
from elastid.response import Response
from elastid.robot import Robot
from elastid.validation.frf_error import Fold, agreement

# The coordinates that are elastic in a model, in the order of the robot, by their labels.
Elastic: TypeAlias = tuple[str, ...]


@dataclass(frozen=True)
class Refit:
    """Cross-validation of one model: cost, n_free and dof of the fit, and folds by configuration.

    status: that of the fit, or `failed`, with the reason as message.
    """

    status: str
    message: str
    n_free: int
    cost: float
    dof: int
    folds: dict[str, Fold]


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

    def behind(self, best: "ComparedModel") -> tuple[float, float]:
        """Return the mean difference of the misfits to the best model's, and its standard error."""
        difference = self.misfit - best.misfit
        n = difference.size
        return float(difference.mean()), float(difference.std(ddof=1) / math.sqrt(n)) if n > 1 else math.inf


@dataclass(frozen=True)
class Trial:
    """A model tried in a step: `coordinates` become free or rigid, which leaves `elastic` ones.

    before, after: misfit of left-out configurations, mean.  taken: true if the search continues from it.
    """

    step: int
    becomes: Literal["free", "rigid"]
    coordinates: tuple[str, ...]
    elastic: Elastic
    before: float
    after: float
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


def split_folds(names: Sequence[str], n_folds: int) -> tuple[tuple[str, ...], ...]:
    """Split configurations into n_folds folds (0: one posture in each); empty for a single posture.

    All amplitudes of a posture are in one fold, because each would predict the others.
    """
    postures = list(dict.fromkeys(map(posture_of, names)))
    n = min(n_folds or len(postures), len(postures))
    groups = [postures[i::n] for i in range(n)] if n > 1 else []
    return tuple(tuple(name for name in names if posture_of(name) in fold) for fold in groups)


Fit: TypeAlias = Callable[[Sequence[Elastic]], Mapping[Elastic, ComparedModel]]


def search(coordinates: Sequence[str], fit: Fit, start: Elastic = ()) -> Iterator[Trial]:
    """Yield every trial, as soon as its step is decided; `final_model` is where they end.

    fit: gives at least the models asked for, under one scale of QAIC.  start: elastic at the start.
    """
    visited = [start]
    while True:
        current = visited[-1]
        others = [name for name in coordinates if name not in current]
        stiffer = {gone: tuple(name for name in current if name != gone) for gone in current}
        # A freed coordinate rigid, one more free, all free, one of the start rigid.
        for candidates in (
            [model for gone, model in stiffer.items() if gone not in start],
            [tuple(name for name in coordinates if name in current or name == free) for free in others],
            [tuple(coordinates)] if len(others) > 1 else [],
            [model for gone, model in stiffer.items() if gone in start],
        ):
            new = [model for model in candidates if model not in visited]
            rows = fit([current, *new])
            chosen, before = _best_step(rows, current, new), rows[current].mean_misfit
            for model in new:
                changed = tuple(name for name in coordinates if (name in model) != (name in current))
                becomes: Literal["free", "rigid"] = "free" if len(model) > len(current) else "rigid"
                yield Trial(len(visited), becomes, changed, model, before, rows[model].mean_misfit, model == chosen)
            if chosen is not None:
                visited.append(chosen)
                break
        else:
            return


def final_model(trials: Sequence[Trial], start: Elastic = ()) -> Elastic:
    """Return the coordinates that are elastic at the end of the search."""
    return next((trial.elastic for trial in reversed(trials) if trial.taken), start)


def describe_search(coordinates: Sequence[str], trials: Sequence[Trial], start: Elastic = ()) -> str:
    """Return the end of the search as a sentence."""
    if not any(math.isfinite(misfit) for trial in trials for misfit in (trial.before, trial.after)):
        return "The search has no result: no model could be fitted without each configuration; see compare.json."
    elastic = final_model(trials, start)
    rigid = [name for name in coordinates if name not in elastic]
    if not elastic:
        return f"The data show no elasticity: {', '.join(rigid)} can be rigid."
    words = f"Elastic coordinates are {', '.join(elastic)}"
    return words + (f"; {', '.join(rigid)} can be rigid with these data." if rigid else ".")


def is_justified(rigid: ComparedModel, free: ComparedModel) -> bool:
    """Return True if the model with more elastic coordinates predicts better by its standard error, at a lower QAIC."""
    if not math.isfinite(free.mean_misfit):
        return False
    if not math.isfinite(rigid.mean_misfit):
        return True
    gain, standard_error = rigid.behind(free)
    return gain > standard_error and free.criterion < rigid.criterion


def _best_step(rows: Mapping[Elastic, ComparedModel], start: Elastic, candidates: Sequence[Elastic]) -> Elastic | None:
    """Return the model that predicts best of those tried whose step from `start` is justified; None without any."""

    def is_step(model: Elastic) -> bool:
        if len(model) > len(start):
            return is_justified(rows[start], rows[model])
        return not is_justified(rows[model], rows[start])

    steps = filter(is_step, candidates)
    return min(steps, key=lambda model: (rows[model].mean_misfit, rows[model].criterion), default=None)


@dataclass(frozen=True)
class ComparedVariant:
    """A model to compare: the robot, its parameters to fit, and the formulation of its equations."""

    name: str
    robot: Robot
    fit: FitSpec
    model: ModelSpec


def refit(responses: Sequence[Response], task: tuple[ComparedVariant, Sequence[str]]) -> Refit:
    """Fit a variant without the left-out configurations, and compare its prediction with their responses."""
    variant, left_out = task
    fitted = [response for response in responses if response.configuration.name not in left_out]
    out = [response for response in responses if response.configuration.name in left_out]
    weights, names = variant.fit.weights, [response.configuration.name for response in fitted]
    factors = tuple(
        replace(factor, configurations=members)
        for factor in weights.factors
        if (members := tuple(name for name in factor.configurations if name in names)) or not factor.configurations
    )
    spec = replace(variant.fit, weights=replace(weights, factors=factors))
    try:
        result = fit_parameters(fitted, variant.robot, spec, model=variant.model)
        modelled = FittedRobot.of(result, variant.robot, out, variant.model).responses
    except ElastidError as error:
        return Refit("failed", str(error), 0, math.inf, 0, {})
    scores = {m.configuration.name: _score(m, G, variant.fit) for m, G in zip(out, modelled, strict=True)}
    return Refit(result.status, result.message, len(result.parameters.of_interest), result.cost, result.dof, scores)


def rank(
    configurations: Sequence[str], variants: Sequence[ComparedVariant], refits: Sequence[Sequence[Refit]]
) -> Comparison:
    """Return the comparison; refits of each variant: to all configurations, then without each part of them."""
    full = [by_part[0] for by_part in refits]
    best = min(full, key=lambda fit: fit.cost)  # a failed one has an infinite cost
    scale = max(best.cost / max(best.dof, 1), 1e-300) if math.isfinite(best.cost) else 1.0
    aic = np.array([fit.cost / scale + 2 * fit.n_free for fit in full])
    aic = aic - (aic.min() if np.isfinite(aic).any() else 0.0)
    rows = [
        _compared(variant.name, by_part, float(criterion), configurations)
        for variant, by_part, criterion in zip(variants, refits, aic, strict=True)
    ]
    rows.sort(key=lambda row: (row.mean_misfit, row.criterion))
    return Comparison(tuple(configurations), tuple(rows), _verdict(rows))


def restrict(spec: FitSpec, variant: Robot, robot: Robot) -> FitSpec:
    """Return the fit section without the parameters that a variant lacks; raise StudyError if no parameter remains."""
    variant_names, own_names = variant.parameters(variant.on_demand), robot.parameters(robot.on_demand)

    def is_gone(key: str) -> bool:
        is_remaining = key in variant_names if key in own_names else match_names(key, variant_names)
        return bool(match_names(key, own_names)) and not is_remaining

    parameters = {key: entry for key, entry in spec.parameters.items() if not is_gone(key)}
    if spec.parameters and not parameters:  # an empty list would mean every stiffness
        raise StudyError(
            "compare/variants",
            f"fit.parameters has no parameter of this model ({', '.join(spec.parameters)}); add one, such as the "
            "stiffnesses of the gears",
        )
    return replace(spec, parameters=parameters)


def fix(spec: FitSpec, robot: Robot, names: Collection[str]) -> FitSpec:
    """Return a study's fit with these parameters fixed at their starts, for a model without them."""
    free = [parameter.name for parameter in choose(spec, robot).free]
    constants = {
        name: replace(spec.parameters.get(name, ParameterSpec()), fixed=True, tie=None, prior=None, per=None)
        for name in names
        if name in free
    }
    return replace(spec, parameters={**(spec.parameters or dict.fromkeys(free, ParameterSpec())), **constants})


def _score(measured: Response, modelled: Response, spec: FitSpec) -> Fold:
    weights = weigh(measured, spec)
    is_used = weights.is_used
    error = np.abs(measured.G - modelled.G)[is_used] / weights.sigma[is_used]
    frf_error = agreement(measured, modelled, is_validation=True)
    misfit = float(np.mean(error**2)) if error.size else math.nan
    return Fold(frf_error.configuration, misfit, frf_error.overall_rms_log_db, frf_error.overall_phase_rms_deg)


def _compared(name: str, refits: Sequence[Refit], criterion: float, configurations: Sequence[str]) -> ComparedModel:
    full, scores = refits[0], {c: score for run in refits[1:] for c, score in run.folds.items()}
    by_configuration = [scores.get(c, Fold()) for c in configurations] if len(refits) > 1 else []
    notes = [f"fit to all: {full.message}"] if full.status == "failed" else []
    failed = [run for run in refits[1:] if run.status == "failed"]
    notes += [f"{len(failed)} of {len(refits) - 1} fits failed: {failed[0].message}"] if failed else []
    if full.status not in ("converged", "failed"):
        notes.append(full.status.replace("_", " "))
    squares = np.array([[score.rms_log_db, score.phase_rms_deg] for score in by_configuration]).reshape(-1, 2) ** 2
    db, deg = np.sqrt(squares.mean(axis=0)) if len(squares) else (math.nan, math.nan)
    return ComparedModel(
        name, full.n_free, full.cost, full.dof, criterion, np.array([score.misfit for score in by_configuration]),
        float(db), float(deg), "; ".join(notes),
    )  # fmt: skip


def _verdict(rows: Sequence[ComparedModel]) -> str:
    best = rows[0]
    if not math.isfinite(best.mean_misfit):
        if not math.isfinite(best.criterion):
            return "No model could be fitted (see the messages)."
        return (
            f"{best.name} has the smallest information criterion. No cross-validation is possible, because there is "
            "only one configuration."
        )
    rivals = [row for row in rows[1:] if math.isfinite(row.mean_misfit)]
    tolerance = 1e-3 * best.mean_misfit
    equal = [row for row in rivals if row.behind(best)[0] <= max(row.behind(best)[1], tolerance)]
    simplest = min([best, *equal], key=lambda row: row.n_free)
    sentence = f"{best.name} predicts left-out configurations best ({math.sqrt(best.mean_misfit):.3g} sigma rms)"
    if equal:
        sentence += f"; {', '.join(row.name for row in equal)} cannot be distinguished from it with these data"
    if worse := [math.sqrt(row.mean_misfit / best.mean_misfit) for row in rivals if row not in equal]:
        sentence += f"; the others are worse by more than the standard error, the next by a factor {min(worse):.3g}"
    if simplest is not best:
        sentence += f". The simplest model as good as that is {simplest.name}, with {simplest.n_free} parameters"
    return sentence + "."
