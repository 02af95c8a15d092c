"""Notes on effects of gears that are hidden or alike, and on gears of which nothing was found."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np

from elastid.base.errors import Note
from elastid.nonlinear.effects import GearEffect
from elastid.nonlinear.gear_choice import SPRINGS
from elastid.nonlinear.gear_levels import Levels
from elastid.nonlinear.gear_limits import Bound, family_of, gear_torque
from elastid.nonlinear.gear_result import BENT_STILL
from elastid.nonlinear.period_lines import DriveLines, PeriodLines
from elastid.response import BENT, NOT_STRAIGHT, Response

_SAME = 0.95  # correlation from which two effects cannot be told apart
HYSTERESIS = ("stop", "bristle")


def preloads(data: Sequence[PeriodLines], drives: Sequence[DriveLines], joints: Sequence[str]) -> list[Note]:
    """Joints whose gear never changes the sign of its torque, so that it never crosses its lost motion."""
    notes = []
    for j, joint in enumerate(joints):
        torques = [gear_torque(lines, drive, j) for lines, drive in zip(data, drives, strict=True)]
        low, high = min(float(tau.min()) for tau in torques), max(float(tau.max()) for tau in torques)
        if all(tau.min() > 0 or tau.max() < 0 for tau in torques):
            text = (
                f"gravity preloads its gear, whose torque goes from {low:.3g} to {high:.3g} N*m in the records, never "
                "through 0 in one of them, where lost motion shows: it is neither found nor bounded; measure a posture "
                "in which gravity loads the joint less, or with more torque"
            )
            notes.append(Note("gears/left-out", text, f"joint {joint}"))
    return notes


def rigid_gears(found: Levels, joints: Sequence[str]) -> list[Note]:
    """Gears of which the model has no deflection: what is lost, and the friction of their motors."""
    notes = []
    for joint in joints:
        own = [i for i, effect in enumerate(found.effects) if effect.joint == joint]
        level, row = sum(float(found.levels[i]) for i in own), np.zeros(len(found.covariance))
        row[[len(found.x) + i for i in own]] = 1.0
        std = math.sqrt(float(row @ found.covariance @ row))
        friction = f"{level:.4g} N*m, std {std:.2g}, link side" if own else "none seen"
        text = (
            "its gear has no spring of its own in the model (rigid, or in series with that of a shaft), so that "
            f"friction at its motor alone was looked for ({friction}); what the gear does otherwise is left out, and "
            "has no bound"
        )
        notes.append(Note("gears/left-out", text, f"joint {joint}", "information"))
    return notes


def bent_notes(responses: Sequence[Response], found: Levels) -> list[Note]:
    """Gears that are no straight springs, of which neither law, hysteresis nor transmission error was found."""
    kinds = (*SPRINGS, *HYSTERESIS, "error sine", "error cosine")
    laws = {effect.joint for effect in found.effects if effect.kind in kinds}
    every = (note.text for G in responses for note in G.notes if note.code == NOT_STRAIGHT)
    bent = dict.fromkeys(text.removeprefix(BENT).partition(" is ")[0].strip() for text in every)
    text = "its gear is no straight spring, and nothing of it was found: its stiffness is that of this amplitude"
    return [Note(BENT_STILL, text, f"joint {joint}") for joint in bent if joint not in laws]


def alike_notes(found: Levels, bounds: Mapping[tuple[GearEffect, ...], Bound]) -> list[Note]:
    """Effects that cannot be told apart: two that were found, or one and another that would be one as well."""
    n, notes, std = len(found.x), list[Note](), found.std
    alike = dict[tuple[tuple[str, str, float], tuple[str, str, float]], Note]()
    for i, first in enumerate(found.effects):
        for j, second in enumerate(found.effects[:i]):
            if family_of(first) == family_of(second):
                continue
            shared = float(found.covariance[n + i, n + j])
            r, factor = shared / max(std[i] * std[j], 1e-300), -shared / max(std[j] ** 2, 1e-300)
            if abs(r) > _SAME:
                one = found.levels[i] + factor * found.levels[j]
                notes.append(_alike(first, second, r, f"together they are {_amount(one, first)} of the first"))
    # Of several shapes of an effect the one that is least told apart.
    for group, bound in sorted(bounds.items(), key=lambda item: abs(item[1].correlation)):
        if abs(bound.correlation) > _SAME:
            (other,), first, level = group, found.effects[bound.rival], float(found.levels[bound.rival])
            alone = level / bound.factor
            if abs(alone) < bound.size:  # it is not excluded that there is nothing of the first
                one = f"one level is stated, {_amount(level, first)} of the first, "
                one += f"and {_amount(alone, other)} of the second would explain the same"
                key = family_of(first), family_of(other)
                alike[key] = _alike(first, other, bound.correlation, one)
    return [*notes, *alike.values()]


def _amount(level: float, effect: GearEffect) -> str:
    return f"{level:.4g}{'' if effect.unit == '1' else f' {effect.unit}'}"


def _alike(first: GearEffect, second: GearEffect, r: float, level: str) -> Note:
    text = f"{_named(first)} and {_named(second)} cannot be told apart in these records (correlation {r:.3f}): {level}"
    return Note("gears/effects-alike", text, f"joint {first.joint}")


_NAMES = {
    "friction": "constant friction before the gear", "load": "friction by load", "behind": "friction behind the gear",
    "cubic": "stiffening", "progressive": "stiffening", "range": "stiffening", "gap": "lost motion",
    "stop": "hysteresis", "bristle": "hysteresis", "error": "transmission error", "ripple": "ripple",
}  # fmt: skip


def _named(effect: GearEffect) -> str:
    word = effect.kind.split()[0]
    return _NAMES[word] + (f" of order {effect.scale:g}" if word in ("error", "ripple") else "")
