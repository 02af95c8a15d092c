r"""Comparison of several models of one robot on the same frequency responses, by their predictions of left-out ones.

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
"""

from __future__ import annotations

import math
from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace

import numpy as np

from elastid.base.errors import ElastidError, StudyError
from elastid.base.names import SEPARATOR, is_match, matching
from elastid.fit.fitted_robot import FittedRobot
from elastid.fit.identify import fit_parameters
from elastid.fit.parameter_choice import choose, is_group_key
from elastid.fit.problem.weights import weigh
from elastid.fit.spec import FactorSpec, FitSpec, ParameterSpec
from elastid.model.spec import ModelSpec
from elastid.response import Response
from elastid.robot import Robot
from elastid.validation.agreement import agreement
from elastid.validation.comparison import ComparedModel, Comparison, Refit
from elastid.validation.results import Fold


@dataclass(frozen=True)
class ComparedVariant:
    """A model to compare: the robot, its parameters to fit, and the formulation of its equations."""

    name: str
    robot: Robot
    fit: FitSpec
    model: ModelSpec


@dataclass(frozen=True)
class RefitTask:
    """One fit: of a variant to all responses but those of the configurations left out."""

    variant: ComparedVariant
    left_out: tuple[str, ...]


def refit(responses: Sequence[Response], task: RefitTask) -> Refit:
    """Fit a variant without some configurations and compare its prediction with them."""
    fitted = [response for response in responses if response.configuration.name not in task.left_out]
    out = [response for response in responses if response.configuration.name in task.left_out]
    variant = task.variant
    weights, names = variant.fit.weights, [response.configuration.name for response in fitted]
    spec = replace(variant.fit, weights=replace(weights, factors=_factors(weights.factors, names)))
    try:
        result = fit_parameters(fitted, variant.robot, spec, model=variant.model)
        modelled = FittedRobot.of(result, variant.robot, out, variant.model).responses
    except ElastidError as error:
        return Refit("failed", str(error), 0, math.inf, 0, {})
    pairs = zip(out, modelled, strict=True)
    scores = {m.configuration.name: _score(m, G, variant.fit) for m, G in pairs}
    return Refit(result.status, result.message, len(result.parameters.asked), result.cost, result.dof, scores)


def rank(
    configurations: Sequence[str], variants: Sequence[ComparedVariant], refits: Sequence[Sequence[Refit]]
) -> Comparison:
    """The comparison; refits of each variant: to all configurations, then without each part of them."""
    full = [by_part[0] for by_part in refits]
    fitted = [f for f in full if f.status != "failed"]
    best_fit = min(fitted, key=lambda f: f.cost, default=None)
    scale = 1.0 if best_fit is None else max(best_fit.cost / max(best_fit.dof, 1), 1e-300)
    aic = np.array([f.cost / scale + 2 * f.n_free if f.status != "failed" else math.inf for f in full])
    aic = aic - (aic.min() if np.isfinite(aic).any() else 0.0)
    rows = [
        _compared(variant.name, by_part, float(criterion), configurations)
        for variant, by_part, criterion in zip(variants, refits, aic, strict=True)
    ]
    rows.sort(key=lambda row: (row.mean_misfit, row.criterion))
    return Comparison(tuple(configurations), tuple(rows), _verdict(rows))


def restricted(spec: FitSpec, robot: Robot, own: Robot) -> FitSpec:
    """A study's fit without parameters that its own robot has and a variant lacks; StudyError where none is left."""
    variant_names, known = robot.parameters(robot.on_demand), own.parameters(own.on_demand)

    def is_gone(key: str) -> bool:
        is_left = key in variant_names if key in known else matching(key, variant_names)
        return bool(matching(key, known)) and not is_left

    left = {key: each for key, each in spec.parameters.items() if not is_gone(key.partition(SEPARATOR)[0])}
    if spec.parameters and not left:  # an empty list would mean every stiffness
        raise StudyError(
            "compare/variants",
            f"fit.parameters has no parameter of this model ({', '.join(spec.parameters)}); add one, such as the "
            "stiffnesses of the gears",
        )
    return replace(spec, parameters=left)


def held(spec: FitSpec, robot: Robot, names: Collection[str]) -> FitSpec:
    """A study's fit with these parameters fixed at their starts, for a model without them."""
    free = {parameter.name for parameter in choose(spec, robot).free}
    still = {
        name: replace(spec.parameters.get(name, ParameterSpec()), fixed=True, tie=None, prior=None, per=None)
        for name in names
        if name in free
    }
    patterns = spec.parameters or {parameter.name: ParameterSpec() for parameter in choose(spec, robot).free}
    left = free - still.keys()
    remaining = {
        key: each
        for key, each in patterns.items()
        if not is_group_key(key) or any(is_match(name, key.partition(SEPARATOR)[0]) for name in left)
    }
    return replace(spec, parameters={**remaining, **still})


def _factors(factors: Sequence[FactorSpec], names: Sequence[str]) -> tuple[FactorSpec, ...]:
    """The factors of these configurations."""
    own = [(factor, tuple(name for name in factor.configurations if name in names)) for factor in factors]
    return tuple(replace(factor, configurations=some) for factor, some in own if some or not factor.configurations)


def _score(measured: Response, modelled: Response, spec: FitSpec) -> Fold:
    weights = weigh(measured, spec)
    used = weights.used
    error = np.abs(measured.G - modelled.G)[used] / weights.sigma[used]
    off = agreement(measured, modelled, left_out=True, peaks=False)
    misfit = float(np.mean(error**2)) if error.size else math.nan
    return Fold(off.configuration, misfit, off.overall_rms_log_db, off.overall_phase_rms_deg)


def _compared(name: str, refits: Sequence[Refit], criterion: float, configurations: Sequence[str]) -> ComparedModel:
    full, scores = refits[0], {c: score for each in refits[1:] for c, score in each.left_out.items()}
    nothing = Fold("", math.nan, math.nan, math.nan)
    by_configuration = [scores.get(c, nothing) for c in configurations] if len(refits) > 1 else []
    notes = [f"fit to all: {full.message}"] if full.status == "failed" else []
    failed = [each for each in refits[1:] if each.status == "failed"]
    notes += [f"{len(failed)} of {len(refits) - 1} fits failed: {failed[0].message}"] if failed else []
    if full.status not in ("converged", "failed"):
        notes.append(full.status.replace("_", " "))
    squares = np.array([[score.rms_log_db, score.phase_rms_deg] for score in by_configuration]).reshape(-1, 2) ** 2
    db, deg = np.sqrt(squares.mean(axis=0)) if len(squares) else (math.nan, math.nan)
    return ComparedModel(
        name=name,
        n_free=full.n_free,
        cost=full.cost,
        dof=full.dof,
        criterion=criterion,
        misfit=np.array([score.misfit for score in by_configuration]),
        rms_log_db=float(db),
        phase_rms_deg=float(deg),
        note="; ".join(notes),
    )


def _verdict(rows: Sequence[ComparedModel]) -> str:
    best = rows[0]
    if not math.isfinite(best.mean_misfit):
        if not math.isfinite(best.criterion):
            return "No model could be fitted: see the message of each."
        return (
            f"{best.name} has the smallest information criterion; the predictions of the models are unknown, because "
            "there is one configuration only and none to leave out"
        )
    rivals = [row for row in rows[1:] if math.isfinite(row.mean_misfit)]
    tolerance = 1e-3 * best.mean_misfit
    equal = [row for row in rivals if row.behind(best)[0] <= max(row.behind(best)[1], tolerance)]
    simplest = min([best, *equal], key=lambda row: row.n_free)
    sentence = f"{best.name} predicts left-out configurations best ({math.sqrt(best.mean_misfit):.3g} sigma rms)"
    if equal:
        sentence += f"; {', '.join(row.name for row in equal)} cannot be distinguished from it with these data"
    worse = [row for row in rivals if row not in equal]
    if worse:
        factors = [math.sqrt(row.mean_misfit / best.mean_misfit) for row in worse]
        low, high = min(factors), max(factors)
        by = f"a factor {low:.3g}" if len(worse) == 1 else f"factors {low:.3g} to {high:.3g}"
        sentence += f"; the others are worse by more than the standard error, by {by} of the error"
    if simplest is not best and simplest.n_free < best.n_free:
        sentence += f". The simplest model as good as that is {simplest.name}, with {simplest.n_free} parameters"
    return sentence + "."
