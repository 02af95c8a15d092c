"""The robot whose motors and gears have the effects that were found in its records."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace
from typing import Literal

from elastid.fit.result import FitResult
from elastid.nonlinear.gear_result import GearResult
from elastid.parameters import Parameter, ParameterSet
from elastid.robot import Friction, Gear, GearRipple, Hysteresis, Joint, Robot, Spring, TransmissionError
from elastid.robot.friction_numbers import with_laws
from elastid.robot.simplified import with_joints, with_straight_springs, without_dry_friction

_ROUNDING = 0.02  # of the ends of a gap, found as sharp


def with_effects(robot: Robot, gears: GearResult) -> Robot:
    """A fitted robot with the effects of its gears, no other dry friction, and no other laws of springs.

    A spring that softens so far that it would pull keeps the stiffness at zero torque alone, as does one whose law the
    robot's file cannot state.
    """
    bare, laws = with_straight_springs(without_dry_friction(robot)), {}
    for joint in robot.driven:
        level = gears.level("friction", joint.name)
        if level > 0 and joint.motor is not None:
            laws[joint.name] = Friction(level), joint.motor.viscous * joint.motor.ratio**2
    found = {effect.joint for effect in gears.effects}

    def changed(joint: Joint) -> Joint:
        if joint.name not in found or joint.spring is None:
            return joint
        behind = gears.level("behind", joint.name)
        friction = Friction(behind) if behind > 0 else joint.friction
        return replace(
            joint, friction=friction, spring=_spring(joint.spring, joint.name, gears), gear=_gear(joint, gears)
        )

    return with_laws(with_joints(bare, changed), laws)


def with_linear_springs(robot: Robot) -> Robot:
    """The robot with the stiffness at zero torque of each joint's spring."""

    def linear(joint: Joint) -> Joint:
        if joint.spring is None:
            return joint
        # Within the ends of a gap or range: what it has at zero torque, where that is more than nothing.
        k = joint.spring.inner_stiffness or joint.spring.stiffness
        return replace(joint, spring=Spring(k, joint.spring.damping))

    return with_joints(robot, linear)


def with_terms_of(result: FitResult, robot: Robot) -> FitResult:
    """The fit with numbers for the terms of this robot's springs, held; without those of terms it has not.

    A stiffness is that beyond the ends of a gap or range.
    """
    known, x = robot.parameters(), result.x.copy()
    broken = {f"k_{joint.name}" for joint in robot.driven if joint.spring and joint.spring.backlash is not None}
    for i, p in enumerate(result.parameters.free):
        if p.name in broken:
            x[i] = p.to_x(known[p.name][0])
    kept = [p for p in result.parameters if p.name in known or not p.name.startswith(("k2_", "k2s_", "k3_"))]
    names = [p.name for p in kept]
    held = [Parameter(name, float(x), unit, free=False) for name, (x, unit) in known.items() if name not in names]
    return replace(result, x=x, parameters=ParameterSet((*kept, *held)))


def _spring(spring: Spring, joint: str, gears: GearResult) -> Spring:
    """A gap is soft within, a range of torque stiffer beyond; a file can state one of them."""
    ends = [
        (effect.kind, effect.scale, f)
        for effect, f in zip(gears.effects, gears.levels.tolist(), strict=True)
        if effect.joint == joint and effect.kind in ("gap", "range") and f
    ]
    if ends:
        (kind, b, f), k = ends[0], spring.stiffness
        inner, outer = (max(k - f, 0.0), k) if kind == "gap" else (k, k + f)
        broken = replace(spring, stiffness=outer, backlash=b, inner_stiffness=inner, rounding=_ROUNDING)
        return broken if len(ends) == 1 and outer > 0 else spring
    terms = {"cubic": gears.level("cubic", joint), "symmetric_quadratic": gears.level("progressive", joint)}
    try:
        return replace(spring, **{name: level for name, level in terms.items() if level})
    except ValueError:  # it softens, and would pull beyond the torques of the records
        return spring


def _gear(joint: Joint, gears: GearResult) -> Gear | None:
    name = joint.name
    gear = Gear(
        load=max(gears.level("load", name), 0.0),
        error=tuple(TransmissionError(*of_order) for of_order in _harmonics("error", name, gears)),
        ripple=tuple(GearRipple(*of_order) for of_order in _harmonics("ripple", name, gears)),
        hysteresis=tuple(_elements(name, gears)),
    )
    return gear if gear != Gear() else None


def _harmonics(word: Literal["error", "ripple"], joint: str, gears: GearResult) -> Iterator[tuple[float, float, float]]:
    """Amplitude, order and phase of each order."""
    parts: dict[tuple[str, float], float] = {
        (effect.kind, effect.scale): f
        for effect, f in zip(gears.effects, gears.levels.tolist(), strict=True)
        if effect.joint == joint and effect.kind.startswith(word)
    }
    for order in dict.fromkeys(scale for _, scale in parts):
        sine, cosine = (parts.get((f"{word} {part}", order), 0.0) for part in ("sine", "cosine"))
        if amplitude := math.hypot(sine, cosine):
            yield amplitude, order, math.atan2(cosine, sine)


def _elements(joint: str, gears: GearResult) -> Iterator[Hysteresis]:
    for effect, level in zip(gears.effects, gears.levels.tolist(), strict=True):
        if effect.joint == joint and effect.kind in ("stop", "bristle") and level > 0:
            yield Hysteresis(level, effect.scale, "sharp" if effect.kind == "stop" else "smooth")
