"""Candidates for what a fit holds wrongly: single numbers, common factors of several, all of a body; what is plausible.

A torque constant that is wrong in every drive is one error and not six: gain_u_* is a factor of all of them.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from elastid.fit.diagnosis.modification.score_test import Candidate, HeldNumber
from elastid.robot import Robot


@dataclass(frozen=True)
class Kind:
    """group: the noun.  usual, limit: of a change, of ln p where log and the value is positive, else SI."""

    group: str
    usual: float
    limit: float
    log: bool = False
    unit: str = ""
    grows: bool = False


_STIFFNESS = Kind("stiffness", 0.3, math.log(30), True)
_DAMPING = Kind("damping", 0.5, math.log(100), True)
_LENGTH = Kind("length", 0.005, 0.2)
_LAG = Kind("time", 0.3, math.log(10), True)
_COMPLIANCE = Kind("compliance", math.inf, math.inf, unit="rad/(N*m)", grows=True)
# By what the name of a number begins with, up to an underscore.
KINDS = {
    "m": Kind("mass", 0.05, math.log(3), True),
    "c": Kind("centre of mass", 0.02, 0.3),
    "a": Kind("centre of mass", 0.05, 0.5),
    "I": Kind("inertia", 0.15, math.log(5), True),
    "Jm": Kind("motor inertia", 0.05, math.log(3), True),
    **dict.fromkeys(("k", "km", "ki", "kc", "k2", "k2s", "k3"), _STIFFNESS),
    **dict.fromkeys(("d", "dm", "f", "fm"), _DAMPING),
    **dict.fromkeys(("p", "pj", "p1", "p2", "pc1", "pc2", "l", "L0"), _LENGTH),
    "angle": Kind("angle", 0.02, 0.6, unit="rad"),
    "gain_u": Kind("gain", 0.05, math.log(2), True, "1"),
    "gain_y": Kind("gain", 0.01, math.log(2), True, "1"),
    "ratio": Kind("gear ratio", 0.005, math.log(1.5), True, "1"),
    "rate": Kind("rate", 0.005, 0.2, unit="1"),
    "delay": Kind("time", 5e-4, 0.05, unit="s"),
    **dict.fromkeys(("torque", "sensor", "differentiator"), _LAG),
    **dict.fromkeys(("torsion", "gear"), _COMPLIANCE),
    "loop": Kind("position loop", math.inf, math.inf, unit="1/s^2", grows=True),
}
_OTHER = Kind("number", 0.1, 1.0, True)
# Numbers that one mistake may scale together, and how they begin.
COMMON_FACTORS = ("gain_u", "gain_y", "ratio", "Jm", "loop")


def kind_of(name: str) -> Kind:
    """By the beginning of the name of a number."""
    first, second = (*name.split("_", 2), "")[:2]
    return KINDS.get(f"{first}_{second}", KINDS.get(first, _OTHER))


def held_number(name: str, value: float, unit: str = "") -> HeldNumber:
    """The number with what is plausible; one that is positive by its nature and zero can only grow."""
    kind = kind_of(name)
    unit = unit or kind.unit
    if kind.log and value > 0:
        return HeldNumber(name, kind.group, value, unit, True, -kind.limit, kind.limit, kind.usual)
    if kind.grows or (kind.log and value == 0 and not _is_product_of_inertia(name)):
        return HeldNumber(name, kind.group, value, unit, False, 0.0, math.inf, math.inf)
    if kind.log:
        return HeldNumber(name, kind.group, value, unit, False, -math.inf, math.inf, math.inf)
    lower = -value if name == "delay" else -kind.limit
    return HeldNumber(name, kind.group, value, unit, False, lower, kind.limit, kind.usual)


def _is_product_of_inertia(name: str) -> bool:
    return name.startswith("I_") and name[-3:] in ("_xy", "_xz", "_yz")


def candidates(numbers: Sequence[HeldNumber], robot: Robot) -> list[Candidate]:
    """Each number alone, then factors of several together, then mass, centre and inertia of each body."""
    place = {number.name: i for i, number in enumerate(numbers)}
    found = [Candidate(one.name, one.group, np.array([i]), np.eye(1)) for i, one in enumerate(numbers)]
    for prefix in COMMON_FACTORS:
        members = [i for name, i in place.items() if name.startswith(f"{prefix}_")]
        found += _together(f"{prefix}_*", numbers, members)
    for body in robot.bodies:
        members = [place[n] for n in (f"I_{body.name}_{axis}" for axis in ("xx", "yy", "zz")) if n in place]
        found += _together(f"I_{body.name}_*", numbers, members)
        own = [f"m_{body.name}", *(f"c_{body.name}_{axis}" for axis in "xyz")]
        own += [f"I_{body.name}{suffix}" for suffix in body.inertia_entries]
        members = [place[name] for name in own if name in place]
        if own[0] in place and len(members) > 1:
            found.append(Candidate(f"payload_{body.name}", "payload", np.array(members), np.eye(len(members))))
    return found


def _together(name: str, numbers: Sequence[HeldNumber], members: Sequence[int]) -> list[Candidate]:
    if len(members) < 2 or len({numbers[i].log for i in members}) > 1:
        return []
    return [Candidate(name, numbers[members[0]].group, np.array(members), np.ones((len(members), 1)))]
