"""Robot model with the estimated gear effects, or with the linear springs of such a model."""

import math
from collections.abc import Iterator
from dataclasses import replace
from itertools import starmap
from typing import Literal

from elastid.fit.result import Result
from elastid.nonlinear.gear_result import GearResult
from elastid.parameters import Parameter, Parameters
from elastid.robot import Friction, Gear, GearRipple, Hysteresis, Joint, Robot, Spring, TransmissionError
from elastid.robot.friction_numbers import with_laws
from elastid.robot.simplified import with_joints, with_straight_springs, without_dry_friction


def with_effects(robot: Robot, gears: GearResult) -> Robot:
    """Return a fitted robot with the effects of its gears, without other dry friction and other nonlinear springs.

    A spring whose torque would change its sign, or whose law the robot model does not have, is linear with the
    stiffness at zero torque.
    """
    bare, laws = with_straight_springs(without_dry_friction(robot)), {}
    for joint in robot.driven:
        magnitude = gears.magnitude("friction", joint.name)
        if magnitude > 0 and joint.motor is not None:
            laws[joint.name] = Friction(magnitude), joint.motor.link_viscous
    joints = {effect.joint for effect in gears.effects}

    def changed(joint: Joint) -> Joint:
        if joint.name not in joints or joint.spring is None:
            return joint
        behind = gears.magnitude("behind", joint.name)
        friction = Friction(behind) if behind > 0 else joint.friction
        return replace(
            joint, friction=friction, spring=_spring(joint.spring, joint.name, gears), gear=_gear(joint, gears)
        )

    return with_laws(with_joints(bare, changed), laws)


def with_linear_springs(robot: Robot) -> Robot:
    """Return the robot with linear springs, which have the stiffness of each joint's spring at zero torque."""

    def linear(joint: Joint) -> Joint:
        if joint.spring is None:
            return joint
        # A gap without stiffness keeps the stiffness beyond it.
        k = joint.spring.inner_stiffness or joint.spring.stiffness
        return replace(joint, spring=Spring(k, joint.spring.damping))

    return with_joints(robot, linear)


def with_terms_of(result: Result, robot: Robot) -> Result:
    """Return the fit with the spring terms of this robot, which are fixed.

    The stiffness of a spring with a gap or range is the robot's, beyond its ends.
    """
    numbers, x = robot.parameters(), result.x.copy()
    with_gap = {f"k_{joint.name}" for joint in robot.driven if joint.spring and joint.spring.backlash is not None}
    for i, p in enumerate(result.parameters.free):
        if p.name in with_gap:
            x[i] = p.to_x(numbers[p.name][0])
    parameters = [p for p in result.parameters if p.name in numbers or not p.name.startswith(("k2_", "k2s_", "k3_"))]
    names = [p.name for p in parameters]
    fixed = [Parameter(name, float(x), unit, free=False) for name, (x, unit) in numbers.items() if name not in names]
    return replace(result, x=x, parameters=Parameters((*parameters, *fixed)))


def _spring(spring: Spring, joint: str, gears: GearResult) -> Spring:
    """Return a spring with the effects of its joint: one gap or range, or a cubic and a quadratic term."""
    ends = [(kind, b, f) for kind, b, f in _effects(joint, gears) if kind in ("gap", "range") and f]
    if ends:
        (kind, b, f), k = ends[0], spring.stiffness
        inner, outer = (max(k - f, 0.0), k) if kind == "gap" else (k, k + f)
        # The estimate has sharp ends; the model rounds them slightly.
        with_gap = replace(spring, stiffness=outer, backlash=b, inner_stiffness=inner, rounding=0.02)
        return with_gap if len(ends) == 1 and outer > 0 else spring
    terms = {"cubic": gears.magnitude("cubic", joint), "symmetric_quadratic": gears.magnitude("progressive", joint)}
    try:
        return replace(spring, **{name: magnitude for name, magnitude in terms.items() if magnitude})
    except ValueError:  # a softening spring, whose torque changes its sign beyond the torques of the records
        return spring


def _gear(joint: Joint, gears: GearResult) -> Gear | None:
    """Return load friction, transmission error, ripple and hysteresis of a joint; None without any."""
    name = joint.name
    gear = Gear(
        load=max(gears.magnitude("load", name), 0.0),
        transmission_error=tuple(starmap(TransmissionError, _harmonics("error", name, gears))),
        ripple=tuple(starmap(GearRipple, _harmonics("ripple", name, gears))),
        hysteresis=tuple(
            Hysteresis(magnitude, scale, "sharp" if kind == "stop" else "smooth")
            for kind, scale, magnitude in _effects(name, gears)
            if kind in ("stop", "bristle") and magnitude > 0
        ),
    )
    return gear if gear != Gear() else None


def _harmonics(word: Literal["error", "ripple"], joint: str, gears: GearResult) -> Iterator[tuple[float, float, float]]:
    amplitudes = {(kind, scale): f for kind, scale, f in _effects(joint, gears) if kind.startswith(word)}
    for order in dict.fromkeys(scale for _, scale in amplitudes):
        sine, cosine = (amplitudes.get((f"{word} {phase}", order), 0.0) for phase in ("sine", "cosine"))
        if amplitude := math.hypot(sine, cosine):
            yield amplitude, order, math.atan2(cosine, sine)


def _effects(joint: str, gears: GearResult) -> list[tuple[str, float, float]]:
    magnitudes = zip(gears.effects, gears.magnitudes.tolist(), strict=True)
    return [(effect.kind, effect.scale, f) for effect, f in magnitudes if effect.joint == joint]
