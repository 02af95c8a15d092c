r"""What to do next, made from the results: one to three actions, each with what it would gain.

.. math:: \Sigma' = \Sigma - \Sigma e_p e_p^T \Sigma / (\Sigma_{pp} + \sigma_p^2), \qquad
          \sigma_p'^2 = \sigma_p^2 / (1 + s_{qp} (m - 1))

for a prior of standard deviation sigma_p, and for m times the experiments in a configuration q that holds the share
s_qp of the information about p.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from elastid.base.numbers import percent
from elastid.fit.result import FitResult
from elastid.report.content import ReportContent
from elastid.report.overview import excess_sentence, half_width, is_wrong, widest
from elastid.report.parameter_rows import ParameterRow

MAX_ACTIONS = 3
# Relative standard deviation of the prior that is weighed, and the share of an interval that is worth a hint.
PRIOR_STD, MIN_GAIN = 0.05, 0.1
# Half-width below which nobody measures again.
SMALL_ENOUGH = 0.005


@dataclass(frozen=True)
class Action:
    """what: an imperative.  gain: what it would change, with numbers.  text: to copy, a command or lines of a study."""

    what: str
    gain: str
    text: str = ""


def next_steps(content: ReportContent, rows: tuple[ParameterRow, ...]) -> tuple[Action, ...]:
    """The most useful first: what the status asks for, what explains the residuals, what narrows the widest number.

    More experiments do not narrow an interval that holds an error of the model.
    """
    result, poor = content.result, widest(rows)
    found = [_of_status(result), _of_residuals(result)]
    if poor is not None and half_width(poor) > SMALL_ENOUGH and not is_wrong(result):
        found += [_of_prior(result, poor), None if result.exceeds_noise else _of_experiments(content, poor)]
    actions = [action for action in found if action is not None]
    if not actions:
        actions = [Action("Use the numbers.", "No interval or residual asks for another measurement.")]
    return tuple(actions[:MAX_ACTIONS])


def commands(content: ReportContent) -> tuple[tuple[str, str], ...]:
    """Meaning and command line of exports; the study is the one in the run folder."""
    return tuple(
        (words, f"elastid export study.yml --run . --to {target}")
        for words, target in (("robot file with the numbers", "robot"), ("MATLAB", "matlab"), ("MuJoCo", "mujoco"))
    )


def _of_status(result: FitResult) -> Action | None:
    if result.status in ("converged", "misfit"):
        return None
    meaning, _, advice = result.meaning.partition(": ")
    return Action(f"{(advice or meaning)[:1].upper()}{(advice or meaning)[1:]}.", "")  # the cause stands above it


def _of_residuals(result: FitResult) -> Action | None:
    first = next((one for one in result.indices if one.place == 1), None)
    if first is None or not excess_sentence(result):
        return _of_structure(result)
    if not first.members:
        return Action(f"Check the reading “{first.name}”.", excess_sentence(result))
    text = f"fit.parameters.{first.members[0]}: {{prior: {{std: {PRIOR_STD}}}}}"
    return Action(f"Free {first.name}, with a prior of {percent(PRIOR_STD)}.", excess_sentence(result), text)


def _of_structure(result: FitResult) -> Action | None:
    """Where the residuals exceed the noise and no number explains them: another model."""
    if not result.exceeds_noise:
        return None
    what = "Declare further joints as elastic, and let the search find those that the data show."
    return Action(what, "No number that was held explains the residuals.", "elastid compare --search study.yml")


def _of_prior(result: FitResult, poor: ParameterRow) -> Action | None:
    """The other number whose prior would narrow the widest one most; only of positive ones, whose prior is relative."""
    names = result.parameters.free_names
    covariance, i = result.covariance, names.index(poor.name)
    variance = float(covariance[i, i])
    if not np.isfinite(covariance).all() or variance <= 0:
        return None
    gains = [
        float(covariance[i, p] ** 2 / (covariance[p, p] + PRIOR_STD**2)) / variance if parameter.log and p != i else 0.0
        for p, parameter in enumerate(result.parameters.free)
    ]
    best = int(np.argmax(gains))
    if 1 - np.sqrt(max(1 - gains[best], 0.0)) < MIN_GAIN:
        return None
    narrowed = half_width(poor) * np.sqrt(max(1 - gains[best], 0.0))
    return Action(
        f"Give {names[best]} a prior of {percent(PRIOR_STD)}.",
        f"The interval of {poor.name} would go from ±{percent(half_width(poor))} to ±{percent(narrowed)}.",
        f"fit.parameters.{names[best]}: {{prior: {{std: {PRIOR_STD}}}}}",
    )


def _of_experiments(content: ReportContent, poor: ParameterRow) -> Action | None:
    """Twice the experiments where the widest number gets most of its information."""
    result = content.result
    column = result.parameters.free_names.index(poor.name)
    if not result.share.size or not np.isfinite(result.share[:, column]).any():
        return None
    q = int(np.nanargmax(result.share[:, column]))
    share, name = float(result.share[q, column]), result.configurations[q]
    narrowed = half_width(poor) / np.sqrt(1 + share)
    return Action(
        f"Measure twice as long in “{name}”{_realisations(content, name)}.",
        f"It holds {percent(share)} of the information on {poor.name}: ±{percent(half_width(poor))} would become "
        f"±{percent(narrowed)}.",
    )


def _realisations(content: ReportContent, name: str) -> str:
    if content.plan is None:
        return ""
    for configuration, count in zip(content.plan.configurations, content.plan.realisations, strict=True):
        if configuration.name == name:
            return f" ({2 * count} realisations instead of {count})"
    return ""
