"""Notes on causes: the change with its effect, and the remedy."""

from __future__ import annotations

import math

import numpy as np

from elastid.base.display import capitalise, percent
from elastid.base.errors import Note
from elastid.fit.diagnosis.hypothesis import Evidence, hypothesis_of_index
from elastid.fit.diagnosis.limits import LIMITS
from elastid.fit.diagnosis.priors import contradicted_tolerances, relative_change, tolerance_of
from elastid.fit.result_rows import ModificationIndex
from elastid.fit.status_terms import NO_CAUSE, REQUIRED

# Remedies; a command to copy is at the end, after a colon.
FREE_MOTORS = "Free the viscous friction of all motors, which the robot model lacks: `--set 'fit.parameters.fm_*={}'`"

CHECK_OR_PRIOR = (
    "Correct {name} in the robot model, or estimate it (prior: value of the robot model; std {size}, wide enough "
    "for this change): "
    "`--set 'fit.parameters.{name}={{prior: {{std: {usual:g}}}}}'`"
)


def explanations(evidence: Evidence) -> tuple[Note, ...]:
    """Return notes on the causes in the order of the ranking, or one that no cause explains enough."""
    result, sequence = evidence.result, [index for index in evidence.result.indices if index.place]
    causes = [index for index in sequence if index.explained_fraction >= LIMITS.min_stated_fraction]
    if result.is_within_declared and evidence.best.explained_fraction < LIMITS.min_cause_fraction:
        return ()
    is_without = not (sequence or evidence.inconsistency_notes) and result.status == "misfit" and result.exceeds_noise
    if sequence and contradicted_tolerances(result) and (causes or not evidence.is_unexplained):
        causes = causes or sequence[:1]
    elif (sequence and sequence[0].explained_fraction < LIMITS.min_cause_fraction) or is_without:
        best = "".join(f" (best: {phrase(i, evidence)}, {_percent(i.explained_fraction)})" for i in causes[:1])
        is_friction = any(map(_is_motor_friction, sequence[:1]))
        remedy = FREE_MOTORS if is_friction else result.test_of_causes
        return (Note("fit/likely-cause", f"{NO_CAUSE}{best}", remedy=remedy),)
    return tuple(Note("fit/likely-cause", fault(i, evidence), remedy=_remedy(i, evidence)) for i in causes)


def fault(index: ModificationIndex, evidence: Evidence) -> str:
    """Explain a cause: `likely cause: m_fore = 75 kg instead of 71 kg (+5.6 %); explains 99 % of ...`."""
    result = evidence.result
    by_name = {index.name: phrase(index, evidence) for index in reversed(result.indices)}
    alternatives = [by_name.get(name, name) for name in index.alike[: LIMITS.n_named]]
    equivalents = f", or {', or '.join(alternatives)} (indistinguishable)" if alternatives else ""
    tolerance = tolerance_of(index, result)
    of_tolerance = f"; its prior std in this fit is {tolerance}" if tolerance else ""
    name, change = index.most_moved(result.parameters.free_names)
    size = relative_change(math.log1p(max(change, 1e-9 - 1)))
    effect = f"changes {name} by {size}" if abs(change) > LIMITS.effect else ""
    cause = f"{phrase(index, evidence)}{equivalents}{of_tolerance}"
    if not evidence.is_unexplained:
        return f"{REQUIRED} {cause}{effect and f' ({effect})'}"
    certainty = "likely" if index.explained_fraction >= LIMITS.certain_fraction else "possible"
    facts = f"explains {_percent(index.explained_fraction)} of the residuals above the noise{effect and f', {effect}'}"
    return f"{'further' if index.place > 1 else certainty} cause: {cause}; {facts}"


def phrase(index: ModificationIndex, evidence: Evidence) -> str:
    """Return the change itself: `m_fore = 71.4 kg instead of 75 kg (-4.8 %)`, `a delay of 0.294 ms`."""
    hypothesis = hypothesis_of_index(index, evidence.hypotheses)
    if hypothesis is not None and hypothesis.phrase:
        text, where = hypothesis.phrase, index.name.partition("@")[2]
        scope = f" in configuration {where} alone" if where else ""
        return text.format(name=index.name) if isinstance(text, str) else f"{text(index)}{scope}"
    return number_phrase(index) if index.members else index.name


def number_phrase(index: ModificationIndex) -> str:
    """Return the change of a number, or of a common factor of several, with its values."""
    unit = "" if index.units[0] == "1" else f" {index.units[0]}"
    step = index.step
    change = relative_change(step) if index.log[0] else f"{step:+.3g}{unit}"
    if index.name.endswith("*"):
        return f"{index.name} {change}"
    nominal = f"{float(index.values[0]):.4g}{unit} ({change})"
    return f"{index.group} {index.name} = {index.changed[0]:.4g}{unit} instead of {nominal}"


def _remedy(index: ModificationIndex, evidence: Evidence) -> str:
    hypothesis = hypothesis_of_index(index, evidence.hypotheses)
    advice = (hypothesis and hypothesis.advice) or CHECK_OR_PRIOR
    if _is_motor_friction(index):
        return FREE_MOTORS
    step = max(np.abs(index.steps).tolist(), default=0.0)  # must be plausible under the prior
    usual = min(max(hypothesis.size.usual if hypothesis else 0.1, float(f"{1.1 * step:.1g}")), LIMITS.stiffness_std)
    # Parameters of a study are the entries of an inertia, not their common factor.
    is_factor = index.name.startswith("I_") and index.name not in evidence.assembly.linearisation.model.parameters
    name = f"{index.name}_*" if is_factor and not index.name.endswith("*") else index.name
    if name == "low_pass":  # of all positions; a negative time constant is a low pass of all torques
        name = "low_pass_y" if index.step > 0 else "low_pass_u"
    size = percent(usual) if index.log and index.log[0] else f"{usual:g} {index.units[0] if index.units else ''}"
    return capitalise(advice.format(name=name, where=index.name.partition("_")[2], usual=usual, size=size))


def _is_motor_friction(index: ModificationIndex) -> bool:
    """Return True if the cause is a motor's viscous friction that is 0 in the robot model; each motor has friction."""
    return index.name.startswith("fm_") and bool(index.members) and not np.any(index.values)


def _percent(fraction: float) -> str:
    return f"{min(100.0, 100 * fraction):.0f} %" if fraction < 0.995 else "99 % or more"
