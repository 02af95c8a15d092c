"""The content of the page of a friction study as one value, and its answer in words."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from elastid.base.note import NoteGroup, grouped
from elastid.experiment.plan.friction import FrictionPlan
from elastid.friction_fit.law_choice import Held
from elastid.friction_fit.result import FrictionNumber, FrictionResult, JointFriction
from elastid.report.numbers import digits, number

# Numbers of a joint that its sentence has, the first ones of its table.
ANSWERED = 3
# Parts of a law without numbers, in words.
PARTS = {
    "stribeck": "stiction and Stribeck velocity",
    "exponent": "exponent of the Stribeck curve",
    "quadratic": "quadratic friction",
    "directions": "difference of the directions",
    "directions.coulomb": "Coulomb friction by direction",
    "load": "dependence on load",
    "temperature": "dependence on temperature",
}
# Reason of a part that nobody looked for.
NOT_ASKED = "not asked for"


@dataclass(frozen=True)
class FrictionContent:
    """What a friction study found, its text and its provenance; the page has no date and is reproducible.

    plan: of the passes, where they were planned here.
    """

    title: str
    result: FrictionResult
    study_text: str
    provenance: Mapping[str, str]
    plan: FrictionPlan | None = None

    @property
    def notes(self) -> tuple[NoteGroup, ...]:
        """Of the study and of every joint; the same from many places once, with a count."""
        of_joints = (note for joint in self.result.joints for note in joint.notes)
        return grouped((*self.result.notes, *of_joints))

    @property
    def answers(self) -> tuple[str, ...]:
        """One sentence for each joint, and one on the truth where the robot is simulated."""
        sentences = [answer(joint) for joint in self.result.joints]
        known = [each for each in self.result.numbers if each.truth is not None]
        if known:
            held = sum(each.low <= each.truth <= each.high for each in known if each.truth is not None)
            sentences.append(f"Of {len(known)} true values {held} lie within their 95 % intervals.")
        return tuple(sentences)


def answer(joint: JointFriction) -> str:
    """What was found of a joint, the numbers first, in one sentence."""
    said = joint.numbers[:ANSWERED]
    if not said:
        return f"Joint {joint.joint}: no friction could be identified."
    numbers = ", ".join(f"{each.symbol} = {with_interval(each)}" for each in said)
    further = len(joint.numbers) - len(said)
    more = f", and {further} further number{'s' if further > 1 else ''}" if further else ""
    parts = ", ".join(dict.fromkeys(part_words(held) for held in joint.held if held.reason != NOT_ASKED))
    left = f"; not identifiable: {parts}" if parts else ""
    return f"Joint {joint.joint}: {numbers}{more}{left}."


def part_words(held: Held) -> str:
    """The part of a law that has no numbers, as a sentence names it."""
    return PARTS.get(held.part, held.part)


def with_interval(each: FrictionNumber) -> str:
    """Value and half of its 95 % interval with the unit: `9.71 ± 0.02 N*m`."""
    half = (each.high - each.low) / 2
    return f"{number(each.value, digits(each.value, half))} ± {number(half, 2)} {each.unit}".rstrip()
