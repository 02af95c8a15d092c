"""Sentences on modification indices: the change, its share of the excess, its effect on k, and what to do."""

from __future__ import annotations

import math
from collections.abc import Sequence

from elastid.base.note import Note
from elastid.fit.diagnosis.hypothesis import Evidence, Hypothesis, hypothesis_of
from elastid.fit.modification_index import ModificationIndex

# A cause that explains less is not worth a sentence; where even the best explains less than the second, no one number
# is the reason.  Measured: the clean fits with any sentence are at most 1 % (scripts/studies/modification_indices.py).
MIN_STATED_SHARE = 0.1
MIN_REASON_SHARE = 0.3
# A sentence names so many others that cannot be distinguished, and the stiffness that moves most, if by so much.
MAX_OTHERS = 3
MIN_EFFECT = 0.005
# A prior that is recommended is not wider.
MAX_PRIOR_STD = 0.5
CHECK_OR_PRIOR = "check it, or give it a prior (fit.parameters: {{{name}: {{prior: {{std: {usual:g}}}}}}})"


def explanations(evidence: Evidence) -> tuple[Note, ...]:
    """A note on each index of the sequence that explains enough, and one where none does."""
    sequence = [index for index in evidence.result.indices if index.place]
    if sequence and sequence[0].share < MIN_REASON_SHARE:
        best = sequence[0]
        text = (
            f"no number that the fit held explains more than {_percent(best.share)} of what the residuals have beyond "
            f"the noise ({phrase(best, evidence)} does): an elastic joint may be missing in the robot's file; add "
            "those that are possible and let elastid compare --search find which the data show"
        )
        return (Note("modification-index", text),)
    stated = [index for index in sequence if index.share >= MIN_STATED_SHARE]
    return tuple(Note("modification-index", _sentence(index, evidence)) for index in stated)


def _sentence(index: ModificationIndex, evidence: Evidence) -> str:
    result = evidence.result
    by_name = {other.name: phrase(other, evidence) for other in reversed(result.indices)}
    others = [by_name.get(name, name) for name in index.alike[:MAX_OTHERS]]
    same = f" (or {', or '.join(others)}: the data cannot tell)" if others else ""
    name, change = index.most_moved(result.parameters.free_names)
    effect = f" and change {name} by {relative(1 + change)}" if abs(change) > MIN_EFFECT else ""
    return (
        f"{'beside that, ' if index.place > 1 else ''}{phrase(index, evidence)}{same} would explain "
        f"{_percent(index.share)} of what the residuals have beyond the noise{effect}: {_advice(index, evidence)}"
    )


def phrase(index: ModificationIndex, evidence: Evidence) -> str:
    """The change itself: `m_fore -4.8 % (75 to 71.4 kg)`, `a delay of 0.294 ms`."""
    hypothesis = _hypothesis(index, evidence.hypotheses)
    if hypothesis is not None and hypothesis.phrase is not None:
        return hypothesis.phrase(index)
    return number_phrase(index) if index.members else index.name


def number_phrase(index: ModificationIndex) -> str:
    """The change of a number, or of a common factor of several, with its values."""
    unit = "" if index.units[0] == "1" else f" {index.units[0]}"
    step, by = float(index.steps[0]), index.changed[0]
    if index.name.endswith("*"):
        return f"{index.name} {relative(math.exp(step)) if index.log[0] else f'{step:+.3g}'}"
    change = relative(math.exp(step)) if index.log[0] else f"{step:+.3g}{unit}"
    return f"{index.name} {change} ({float(index.values[0]):.4g} to {by:.4g}{unit})"


def _advice(index: ModificationIndex, evidence: Evidence) -> str:
    """The next action."""
    hypothesis = _hypothesis(index, evidence.hypotheses)
    advice = (hypothesis and hypothesis.advice) or CHECK_OR_PRIOR
    if not isinstance(advice, str):
        return advice(index, evidence.result)
    size = None if hypothesis is None else hypothesis.size
    usual = min(0.1 if size is None else size.usual, MAX_PRIOR_STD)
    return advice.format(name=index.name, where=index.name.partition("_")[2], usual=usual)


def _hypothesis(index: ModificationIndex, hypotheses: Sequence[Hypothesis]) -> Hypothesis | None:
    """The hypothesis of an index: by the name of its number, else by its family."""
    by_number = hypothesis_of(index.name, hypotheses)
    if by_number.family == index.group:
        return by_number
    return next((hypothesis for hypothesis in hypotheses if hypothesis.family == index.group), None)


def relative(factor: float) -> str:
    """A factor as a percentage where it is near one."""
    return f"{100 * (factor - 1):+.2g} %" if 0.5 < factor < 2 else f"a factor {factor:.3g}"


def _percent(share: float) -> str:
    return f"{min(100.0, 100 * share):.0f} %" if share < 0.995 else "99 % or more"
