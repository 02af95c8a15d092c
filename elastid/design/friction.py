"""The plan of a friction study: speeds of passes, their order, torques at standstill, and warm-ups.

Speeds are D-optimal over the laws that the joint may have (`pass_speeds`, with its certificate), windows and ramps
those that the joint's limits leave (`friction_axis`); what cannot be done is refused by name.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace

import numpy as np

from elastid.base.display import number as printed
from elastid.base.errors import DataError, StudyError
from elastid.design.friction_axis import Axis, PassSpeeds, axis_of, optimal_speeds
from elastid.excitation.multisine import growing_loops, small_multisine
from elastid.experiment.plan.friction import (
    FrictionPlan,
    JointPassDesign,
    PassLimits,
    PlannedMotion,
    PlannedWarmUp,
    pass_time,
    plan_passes,
    planned_pass,
)
from elastid.experiment.specs.experiment import ExperimentSpec
from elastid.friction_study.laws import LOWEST_SPEED, MIN_SPEEDS
from elastid.friction_study.spec import FrictionSpec, LoadSpec, PassesSpec, WarmUpSpec
from elastid.record import Configuration, drive_unit
from elastid.robot import Joint, Robot
from elastid.robot.simplified import with_point_mass


def passes_of(
    spec: PassesSpec, loads: Sequence[LoadSpec], postures: Sequence[Configuration], design: JointPassDesign, seed: int
) -> tuple[PlannedMotion, ...]:
    """The passes under every load, in its posture, each set in an order of its own."""
    every, joint = np.repeat(design.speed, design.passes.astype(int)).tolist(), design.joint
    return tuple(
        PlannedMotion(
            "-".join(filter(None, (f"j{joint}", load.name, planned.name))),
            joint, "passes", posture, load.name, load.payload, planned=planned,
        )
        for i, (load, posture) in enumerate(zip(loads, postures, strict=True))
        for planned in plan_passes(every, spec.repeat, design.limits, seed + i, spec.reference_every)
    )  # fmt: skip


def standstill_of(
    spec: FrictionSpec, axis: Axis, posture: Configuration, rng: np.random.Generator
) -> tuple[PlannedMotion, ...]:
    """Growing loops and small multisines of the torque in the middle of the window."""
    joint, law = axis.joint.name, axis.guess
    middle, motions = posture.moved(axis.index, sum(axis.limits.window) / 2), list[PlannedMotion]()
    if (loops := spec.presliding) is not None:
        low, high = (share * law.stiction for share in loops.torque)
        torque = growing_loops(low, high, loops.loops, loops.frequency_hz, spec.rate_hz)
        period = round(spec.rate_hz / loops.frequency_hz)
        motions.append(PlannedMotion(f"j{joint}-loops", joint, "loops", middle, torque=torque, period_samples=period))
    if spec.at_rest is not None:
        n = round(1.0 * spec.rate_hz)  # a period of 1 s
        for share in spec.at_rest.torque:
            for draw in range(2):
                period_torque = small_multisine(share * law.coulomb, spec.at_rest.band_hz, n, spec.rate_hz, rng)
                name = f"j{joint}-rest-{share:g}-{draw}"
                torque = np.tile(period_torque, 33)  # the first period is the transient
                motions.append(PlannedMotion(name, joint, "at_rest", middle, torque=torque, period_samples=n))
    return tuple(motions)


def timed(
    motions: Iterable[PlannedMotion], limits: PassLimits, start_s: float, rate_hz: float
) -> tuple[tuple[PlannedMotion, ...], float]:
    """The motions one after the other from start_s on, and the end of the last."""
    started, clock = list[PlannedMotion](), start_s
    for motion in motions:
        started.append(replace(motion, start_s=clock))
        if motion.planned is not None:
            clock += pass_time(motion.planned, limits)
        elif motion.torque is not None:
            clock += len(motion.torque) / rate_hz
    return tuple(started), clock


def warm_up_of(
    spec: WarmUpSpec, axis: Axis, design: JointPassDesign, posture: Configuration, start_s: float
) -> tuple[PlannedWarmUp, tuple[PlannedMotion, ...], float]:
    """Motion to and fro over the window, interrupted by groups of test passes; and its end."""
    joint, limits = axis.joint.name, axis.limits
    if spec.speed > axis.fastest:
        raise StudyError(
            "friction/plan",
            f"{limits.place} reaches {axis.fastest:.3g} {limits.unit}/s in its window and with "
            f"its torque, and {spec.speed:.3g} are asked for; lower the speed, or widen friction.passes.window",
            "friction.warm_up.speed",
        )
    reach = planned_pass(spec.speed, 0, limits)
    warm_up = PlannedWarmUp(joint, posture, reach.start, reach.stop, spec.speed, start_s, spec.time)
    # A slow, a medium and the highest speed of the passes.
    places = sorted({round(place * (len(design.speed) - 1)) for place in (0.3, 0.65, 1.0)})
    tests = list[PlannedMotion]()
    for number in range(int(spec.time / spec.test_every) + 1):
        group = (planned_pass(design.speed[place], number, limits) for place in places)
        motions = (
            PlannedMotion(f"j{joint}-test-{test.name}", joint, "passes", posture, planned=test, is_warm_up=True)
            for test in group
        )
        tests += timed(motions, limits, start_s + number * spec.test_every, 1.0)[0]
    return warm_up, tuple(tests), start_s + spec.time


def design_friction(
    spec: FrictionSpec, joints: Sequence[Joint], experiment: ExperimentSpec, robot: Robot, seed: int
) -> FrictionPlan:
    """The plan of a study of `joints`, one after the other.

    Raises StudyError that names joint, speed and numbers where limits, window or loop do not allow a pass.
    """
    parts, end_s = list[FrictionPlan](), 0.0
    for number, joint in enumerate(joints):
        parts.append(_planned(spec, joint, experiment, robot, (seed, number), end_s))
        end_s = parts[-1].robot_time_s
    return FrictionPlan(
        spec.rate_hz,
        tuple(motion for part in parts for motion in part.motions),
        tuple(design for part in parts for design in part.designs),
        end_s,
        tuple(warm_up for part in parts for warm_up in part.warm_ups),
        tuple(sentence for part in parts for sentence in part.known),
        tuple(dict.fromkeys(sentence for part in parts for sentence in part.unknown)),
    )


def _planned(
    spec: FrictionSpec, joint: Joint, experiment: ExperimentSpec, robot: Robot, seed: tuple[int, int], start_s: float
) -> FrictionPlan:
    controller, passes = experiment.as_simulated().controller, spec.designed_passes
    loads = spec.loads or (LoadSpec(""),)
    postures = [_posture(experiment, robot, load.configuration) for load in loads]
    axes = [
        axis_of(with_point_mass(robot, load.payload), joint, posture, passes, controller)
        for load, posture in zip(loads, postures, strict=True)
    ]
    # The load that takes most of the torque decides ramps and speeds of all.
    axis = max(axes, key=lambda axis: axis.holding)
    speeds = _speeds(spec, axis)
    axis.check_speeds(speeds.speed)
    design = JointPassDesign(joint.name, axis.limits, speeds.speed, speeds.passes.astype(float), speeds.efficiency)
    draws = np.random.SeedSequence(seed).spawn(2)
    untimed = (
        *passes_of(passes, loads, postures, design, int(draws[0].generate_state(1)[0])),
        *standstill_of(spec, axis, postures[0], np.random.default_rng(draws[1])),
    )
    motions, end_s = timed(untimed, axis.limits, start_s, spec.rate_hz)
    warm_ups: tuple[PlannedWarmUp, ...] = ()
    if spec.warm_up is not None:
        warm_up, tests, end_s = warm_up_of(spec.warm_up, axis, design, postures[0], end_s)
        motions, warm_ups = (*motions, *tests), (warm_up,)
    known, unknown = (_known(axis, design),), tuple(_unknown(spec, axis, design))
    return FrictionPlan(spec.rate_hz, motions, (design,), end_s, warm_ups, known, unknown)


def _posture(experiment: ExperimentSpec, robot: Robot, name: str | None) -> Configuration:
    """A configuration by name, by default the first; without any, every joint at zero or the nearest that it may."""
    given = experiment.configurations
    if given:
        chosen = name or next(iter(given))
        return Configuration(chosen, np.array(given[chosen]))
    return Configuration("zero", np.array([float(np.clip(0.0, *joint.limits.angle)) for joint in robot.driven]))


def _speeds(spec: FrictionSpec, axis: Axis) -> PassSpeeds:
    passes, unit = spec.designed_passes, axis.limits.unit
    lowest, highest = passes.speeds or (axis.slowest, axis.fastest)
    try:
        if passes.spacing == "optimal":
            return optimal_speeds(axis.guess.spread, lowest, highest, passes.count)
        if not 0 < lowest < highest:
            raise DataError("friction/plan", f"passes from {lowest:.3g} to {highest:.3g} {unit}/s leave no range")
        speeds = np.geomspace(lowest, highest, passes.count)
        return PassSpeeds(speeds, np.ones(passes.count, np.int64), float("nan"))
    except DataError as error:
        raise StudyError(
            "friction/plan",
            f"{axis.limits.place}: {error}; its window of {np.ptp(axis.limits.window):.3g} "
            f"{unit}, its loop and its torque leave {axis.slowest:.3g} to {axis.fastest:.3g} {unit}/s",
            "friction.passes.speeds",
        ) from None


def _known(axis: Axis, design: JointPassDesign) -> str:
    source = "the robot's file" if axis.guess.is_from_file else "common gears"
    certificate = "" if np.isnan(design.efficiency) else f", {design.efficiency:.0%} of the best information"
    slides = axis.limits.unit == "m"
    return (
        f"{axis.limits.place}: {design.passes.sum():.0f} passes at {len(design.speed)} speeds from "
        f"{design.speed[0]:.3g} to {design.speed[-1]:.3g} {axis.limits.unit}/s{certificate} for friction as that of "
        f"{source} (F_c {printed(axis.guess.coulomb, 3)} {drive_unit(slides)}, nu_s "
        f"{printed(axis.guess.stribeck_velocity, 3)} {axis.limits.unit}/s)"
    )


def _unknown(spec: FrictionSpec, axis: Axis, design: JointPassDesign) -> list[str]:
    nu_s, unknown = axis.guess.stribeck_velocity, []
    if len(design.speed) < MIN_SPEEDS:
        unknown.append(f"{axis.limits.place}: stiction: {len(design.speed)} speeds; it needs {MIN_SPEEDS}")
    elif design.speed[0] > LOWEST_SPEED * nu_s:
        unknown.append(
            f"{axis.limits.place}: stiction and its Stribeck velocity: no speed below a third of about {nu_s:.3g} "
            f"{axis.limits.unit}/s; measure at {LOWEST_SPEED * nu_s:.2g} and below"
        )
    if len(spec.loads) < 2:
        unknown.append("growth with the load: one load; give loads, other postures or payloads")
    if spec.warm_up is None:
        unknown.append("change with temperature: one temperature; give warm_up")
    if spec.presliding is None and spec.at_rest is None:
        unknown.append("friction before the joint slides: give presliding or at_rest")
    return unknown
