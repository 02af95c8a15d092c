r"""Comparison of models of one robot on the same frequency responses, by cross-validation over configurations.

Each model is fitted to all configurations, and again without each fold. Its misfit on a validation configuration c, and
the information criterion of its fit to all configurations, are

.. math:: m_c = \frac{1}{n_c} \sum_k \frac{|\hat G - G|^2}{\sigma^2}, \qquad
          \mathrm{QAIC} = V / \hat c + 2 n_x

m_c: mean over the elements and lines of the fit, 1 with the noise of the weights alone. c: V / dof of the best fit,
which makes an error common to all models irrelevant; only differences of QAIC are meaningful (Burnham & Anderson, Model
Selection and Multimodel Inference, 2002, section 2.5). QAIC assumes independent residuals, which a model error
violates: if both criteria disagree, the cross-validation is more reliable.

Two models are distinguishable if the mean over configurations of m_c - m_c(best) exceeds its standard error and 0.1 %,
the relative difference between two fits of one model.
"""

import math
from collections.abc import Collection, Sequence
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

# Labels of the elastic coordinates of a model, in the order of the robot.
Elastic: TypeAlias = tuple[str, ...]


@dataclass(frozen=True)
class Refit:
    """Fit of one model: cost, free parameters and dof, and its predictions (folds) of validation configurations.

    status: of the fit, or `failed`, with the reason as message.
    """

    status: str
    message: str
    n_free: int
    cost: float
    dof: int
    folds: dict[str, Fold]


@frozen_value
class ComparedModel:
    """Model in the ranking.  misfit (n_c,): m_c, NaN if the fit failed; empty without cross-validation.

    criterion: QAIC minus the smallest QAIC.  rms_log_db, phase_rms_deg: over the validation configurations.
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
        """Mean misfit over the configurations; infinite if one is unknown."""
        return float(self.misfit.mean()) if self.misfit.size and np.isfinite(self.misfit).all() else math.inf

    def behind(self, best: "ComparedModel") -> tuple[float, float]:
        """Return the mean difference of the misfits from the best model's, and its standard error."""
        difference = self.misfit - best.misfit
        n = difference.size
        return float(difference.mean()), float(difference.std(ddof=1) / math.sqrt(n)) if n > 1 else math.inf


@dataclass(frozen=True)
class Trial:
    """Model tried in a step of the search, in which `coordinates` become free or rigid, with its `elastic` ones.

    before, after: mean misfit of validation configurations.  taken: True if the search continues from this model.
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
    """Ranking of models, the best prediction first (without cross-validation the lowest criterion), and a verdict.

    trials: of the search, in its order; empty for listed models.
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


@dataclass(frozen=True)
class ComparedVariant:
    """A model to compare: the robot, its parameters to fit, and the formulation of its equations."""

    name: str
    robot: Robot
    fit: FitSpec
    model: ModelSpec


def refit(responses: Sequence[Response], task: tuple[ComparedVariant, Sequence[str]]) -> Refit:
    """Fit a variant without a fold of configurations, and compare its predictions with their responses."""
    variant, fold = task
    fitted = [response for response in responses if response.configuration.name not in fold]
    validation = [response for response in responses if response.configuration.name in fold]
    weights, names = variant.fit.weights, [response.configuration.name for response in fitted]
    factors = tuple(
        replace(factor, configurations=members)
        for factor in weights.factors
        if (members := tuple(name for name in factor.configurations if name in names)) or not factor.configurations
    )
    spec = replace(variant.fit, weights=replace(weights, factors=factors))
    try:
        result = fit_parameters(fitted, variant.robot, spec, model=variant.model)
        modelled = FittedRobot.of(result, variant.robot, validation, variant.model).responses
    except ElastidError as error:
        return Refit("failed", str(error), 0, math.inf, 0, {})
    scores = {m.configuration.name: _score(m, G, variant.fit) for m, G in zip(validation, modelled, strict=True)}
    return Refit(result.status, result.message, len(result.parameters.of_interest), result.cost, result.dof, scores)


def rank(
    configurations: Sequence[str], variants: Sequence[ComparedVariant], refits: Sequence[Sequence[Refit]]
) -> Comparison:
    """Return the ranking; refits of each variant: to all configurations, then without each fold."""
    full = [of_variant[0] for of_variant in refits]
    best = min(full, key=lambda fit: fit.cost)  # a failed fit has an infinite cost
    scale = max(best.cost / max(best.dof, 1), 1e-300) if math.isfinite(best.cost) else 1.0
    aic = np.array([fit.cost / scale + 2 * fit.n_free for fit in full])
    aic = aic - (aic.min() if np.isfinite(aic).any() else 0.0)
    rows = [
        _compared(variant.name, of_variant, float(criterion), configurations)
        for variant, of_variant, criterion in zip(variants, refits, aic, strict=True)
    ]
    rows.sort(key=lambda row: (row.mean_misfit, row.criterion))
    return Comparison(tuple(configurations), tuple(rows), _verdict(rows))


def restrict(spec: FitSpec, variant: Robot, robot: Robot) -> FitSpec:
    """Return the fit section without the parameters that a variant lacks; StudyError if no parameter remains."""
    variant_names, names = variant.parameters(variant.on_demand), robot.parameters(robot.on_demand)

    def is_missing(key: str) -> bool:
        is_remaining = key in variant_names if key in names else match_names(key, variant_names)
        return bool(match_names(key, names)) and not is_remaining

    parameters = {key: entry for key, entry in spec.parameters.items() if not is_missing(key)}
    if spec.parameters and not parameters:  # an empty list would select every stiffness
        raise StudyError(
            "compare/variants",
            f"fit.parameters has no parameter of this model ({', '.join(spec.parameters)}). Add one, such as the "
            "stiffnesses of the gears",
        )
    return replace(spec, parameters=parameters)


def fix(spec: FitSpec, robot: Robot, names: Collection[str]) -> FitSpec:
    """Return the fit section with these parameters fixed at their start values, for a model without them."""
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
    if ratios := [math.sqrt(row.mean_misfit / best.mean_misfit) for row in rivals if row not in equal]:
        sentence += f"; the others are worse by more than the standard error, the next by a factor {min(ratios):.3g}"
    if simplest is not best:
        sentence += f". The simplest of these models is {simplest.name}, with {simplest.n_free} parameters"
    return sentence + "."
