"""The plan of a friction study: speeds of passes, their order, torques at standstill, and warm-ups."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

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
from elastid.record import Configuration
from elastid.robot import Joint, Robot
from elastid.robot.simplified import with_point_mass

# At rest: period, its repetitions (the first is the transient), and draws of the random phases.
REST_PERIOD_S, REST_PERIODS, REST_REALISATIONS = 1.0, 33, 2
# Speeds of the test passes of a warm-up, as places in the sorted speeds of the passes.
TEST_PLACES = (0.3, 0.65, 1.0)


def passes_of(
    spec: PassesSpec,
    loads: Sequence[LoadSpec],
    postures: Mapping[str, Configuration],
    joint: str,
    design: JointPassDesign,
    seed: int,
) -> tuple[PlannedMotion, ...]:
    """The passes under every load, each set in an order of its own."""
    every = np.repeat(design.speed, design.passes.astype(int)).tolist()
    return tuple(
        PlannedMotion(
            "-".join(filter(None, (f"j{joint}", load.name, one.name))),
            joint, "passes", postures[load.name], load.name, load.payload, planned=one,
        )
        for i, load in enumerate(loads)
        for one in plan_passes(every, spec.repeat, design.limits, seed + i, spec.reference_every)
    )  # fmt: skip


def standstill_of(
    spec: FrictionSpec, axis: Axis, posture: Configuration, rng: np.random.Generator
) -> tuple[PlannedMotion, ...]:
    """Growing loops and small multisines of the torque in the middle of the window."""
    joint, law = axis.joint.name, axis.guess.law
    there, found = posture.moved(axis.index, sum(axis.limits.window) / 2), list[PlannedMotion]()
    if spec.presliding is not None:
        one = spec.presliding
        low, high = (share * law.stiction for share in one.torque)
        torque = growing_loops(low, high, one.loops, one.frequency_hz, spec.rate_hz)
        period = round(spec.rate_hz / one.frequency_hz)
        found.append(PlannedMotion(f"j{joint}-loops", joint, "loops", there, torque=torque, period_samples=period))
    if spec.at_rest is None:
        return tuple(found)
    n = round(REST_PERIOD_S * spec.rate_hz)
    for share in spec.at_rest.torque:
        for draw in range(REST_REALISATIONS):
            period_torque = small_multisine(share * law.coulomb, spec.at_rest.band_hz, n, spec.rate_hz, rng)
            name = f"j{joint}-rest-{share:g}-{draw}"
            torque = np.tile(period_torque, REST_PERIODS)
            found.append(PlannedMotion(name, joint, "at_rest", there, torque=torque, period_samples=n))
    return tuple(found)


def timed(
    motions: Iterable[PlannedMotion], limits: PassLimits, start_s: float, rate_hz: float
) -> tuple[tuple[PlannedMotion, ...], float]:
    """The motions one after the other from start_s on, and the end of the last."""
    found, clock = list[PlannedMotion](), start_s
    for motion in motions:
        found.append(replace(motion, start_s=clock))
        clock += duration_s(motion, limits, rate_hz)
    return tuple(found), clock


def duration_s(motion: PlannedMotion, limits: PassLimits, rate_hz: float) -> float:
    """How long a motion takes."""
    if motion.planned is not None:
        return pass_time(motion.planned, limits)
    return 0.0 if motion.torque is None else len(motion.torque) / rate_hz


def warm_up_of(
    spec: WarmUpSpec, axis: Axis, design: JointPassDesign, posture: Configuration, start_s: float
) -> tuple[PlannedWarmUp, tuple[PlannedMotion, ...], float]:
    """Motion to and fro over the window, interrupted by groups of test passes; and its end."""
    joint, limits = axis.joint.name, axis.limits
    if spec.speed > axis.fastest:
        raise StudyError(
            f"friction.warm_up.speed: {limits.place} reaches {axis.fastest:.3g} {limits.unit}/s in its window and with "
            f"its torque, and {spec.speed:.3g} are asked for; lower the speed, or widen friction.passes.window"
        )
    reach = planned_pass(spec.speed, 0, limits)
    warm_up = PlannedWarmUp(joint, posture, reach.start, reach.stop, spec.speed, start_s, spec.time)
    places = sorted({round(place * (len(design.speed) - 1)) for place in TEST_PLACES})
    tests = list[PlannedMotion]()
    for number in range(int(spec.time / spec.test_every) + 1):
        group = (planned_pass(design.speed[place], number, limits) for place in places)
        motions = (
            PlannedMotion(f"j{joint}-test-{one.name}", joint, "passes", posture, planned=one, is_warm_up=True)
            for one in group
        )
        tests += timed(motions, limits, start_s + number * spec.test_every, 1.0)[0]
    return warm_up, tuple(tests), start_s + spec.time


def design_friction(
    spec: FrictionSpec, joints: Sequence[Joint], experiment: ExperimentSpec, robot: Robot, seed: int
) -> FrictionPlan:
    """The plan of a study of `joints`, one after the other.

    Raises StudyError that names joint, speed and numbers where limits, window or loop do not allow a pass, and for a
    part of the law that is asked for and that these experiments cannot tell.
    """
    _check_law(spec)
    found = list[_Planned]()
    for number, joint in enumerate(joints):
        start_s = found[-1].end_s if found else 0.0
        found.append(_planned(spec, joint, experiment, robot, (seed, number), start_s))
    return FrictionPlan(
        spec.rate_hz,
        tuple(motion for one in found for motion in one.motions),
        tuple(one.design for one in found),
        found[-1].end_s if found else 0.0,
        tuple(warm_up for one in found for warm_up in one.warm_ups),
        tuple(_known(one.axis, one.design) for one in found),
        tuple(dict.fromkeys(sentence for one in found for sentence in _unknown(spec, one.axis, one.design))),
    )


@dataclass(frozen=True)
class _Planned:
    """What is done with one joint, and when it ends."""

    axis: Axis
    design: JointPassDesign
    motions: tuple[PlannedMotion, ...]
    warm_ups: tuple[PlannedWarmUp, ...]
    end_s: float


def _planned(
    spec: FrictionSpec, joint: Joint, experiment: ExperimentSpec, robot: Robot, seed: tuple[int, int], start_s: float
) -> _Planned:
    controller = experiment.as_simulated().controller
    loads = spec.loads or (LoadSpec(""),)
    postures = {load.name: _posture(experiment, robot, load.configuration) for load in loads}
    axes = [
        axis_of(with_point_mass(robot, load.payload), joint, postures[load.name], spec.designed_passes, controller)
        for load in loads
    ]
    # The load that takes most of the torque decides ramps and speeds of all.
    axis = max(axes, key=lambda one: one.holding)
    speeds = _speeds(spec, axis)
    axis.check_speeds(speeds.speed, controller.bandwidth_hz)
    design = JointPassDesign(
        joint.name, axis.limits, speeds.speed, speeds.passes.astype(float), speeds.excess, speeds.efficiency
    )
    draws = np.random.SeedSequence(seed).spawn(2)
    motions, end_s = timed(
        (
            *passes_of(spec.designed_passes, loads, postures, joint.name, design, int(draws[0].generate_state(1)[0])),
            *standstill_of(spec, axis, postures[loads[0].name], np.random.default_rng(draws[1])),
        ),
        axis.limits,
        start_s,
        spec.rate_hz,
    )
    if spec.warm_up is None:
        return _Planned(axis, design, motions, (), end_s)
    warm_up, tests, end_s = warm_up_of(spec.warm_up, axis, design, postures[loads[0].name], end_s)
    return _Planned(axis, design, (*motions, *tests), (warm_up,), end_s)


def _check_law(spec: FrictionSpec) -> None:
    """StudyError for a part of the law without the conditions or the experiment that it needs."""
    if spec.law.presliding == "lugre" and spec.presliding is not None:
        raise StudyError(
            "friction.law.presliding: lugre, and slow loops (friction.presliding) do not tell the damping of bristles; "
            "give friction.at_rest, which tells stiffness and damping, and leave out friction.presliding, or take "
            "law.presliding: maxwell_slip"
        )
    if spec.law.temperature == "yes" and spec.warm_up is None:
        raise StudyError(
            "friction.law.temperature: yes, and all passes have one temperature; two give a slope, three or more, over "
            "20 K and up, the decay of viscous friction: give friction.warm_up, or auto"
        )
    if spec.law.load == "yes" and len(spec.loads) < 2:
        raise StudyError(
            "friction.law.load: yes, and there is one load; two give a slope, three a "
            "Stribeck velocity of the load's own: give friction.loads (postures or payloads), or auto"
        )


def _posture(experiment: ExperimentSpec, robot: Robot, name: str | None) -> Configuration:
    """A configuration by name, by default the first; without any, every joint at zero or the nearest that it may."""
    given = experiment.configurations
    if given:
        chosen = name or next(iter(given))
        return Configuration(chosen, np.array(given[chosen]))
    return Configuration("zero", np.array([float(np.clip(0.0, *joint.limits.angle)) for joint in robot.driven]))


def _speeds(spec: FrictionSpec, axis: Axis) -> PassSpeeds:
    """The speeds of the passes and how many at each; StudyError for a range without room."""
    passes, unit = spec.designed_passes, axis.limits.unit
    lowest, highest = passes.speeds or (axis.slowest, axis.fastest)
    try:
        if passes.spacing == "optimal":
            return optimal_speeds(axis.guess.spread, lowest, highest, passes.count)
        if not 0 < lowest < highest:
            raise DataError(f"passes from {lowest:.3g} to {highest:.3g} {unit}/s leave no range")
        speeds = np.geomspace(lowest, highest, passes.count)
        return PassSpeeds(speeds, np.ones(passes.count, np.int64), float("nan"), float("nan"))
    except DataError as error:
        raise StudyError(
            f"friction.passes.speeds: {axis.limits.place}: {error}; its window of {np.ptp(axis.limits.window):.3g} "
            f"{unit}, its loop and its torque leave {axis.slowest:.3g} to {axis.fastest:.3g} {unit}/s"
        ) from None


def _known(axis: Axis, design: JointPassDesign) -> str:
    """What the passes tell of a joint."""
    source = "the robot's file" if axis.guess.is_from_file else "common gears"
    certificate = "" if np.isnan(design.efficiency) else f", {design.efficiency:.0%} of the best information"
    return (
        f"{axis.limits.place}: {design.passes.sum():.0f} passes at {len(design.speed)} speeds from "
        f"{design.speed[0]:.3g} to {design.speed[-1]:.3g} {axis.limits.unit}/s{certificate} for friction as that of "
        f"{source} (F_c {axis.guess.law.coulomb:.3g}, nu_s {axis.guess.law.stribeck_velocity:.3g})"
    )


def _unknown(spec: FrictionSpec, axis: Axis, design: JointPassDesign) -> list[str]:
    """What the levels will not tell, and what would."""
    nu_s, found = axis.guess.law.stribeck_velocity, []
    if len(design.speed) < MIN_SPEEDS:
        found.append(f"{axis.limits.place}: stiction: {len(design.speed)} speeds; it needs {MIN_SPEEDS}")
    elif design.speed[0] > LOWEST_SPEED * nu_s:
        found.append(
            f"{axis.limits.place}: stiction and its Stribeck velocity: no speed below a third of about {nu_s:.3g} "
            f"{axis.limits.unit}/s; measure at {LOWEST_SPEED * nu_s:.2g} and below"
        )
    if len(spec.loads) < 2:
        found.append("growth with the load: one load; give loads, other postures or payloads")
    if spec.warm_up is None:
        found.append("change with temperature: one temperature; give warm_up")
    if spec.presliding is None and spec.at_rest is None:
        found.append("friction before the joint slides: give presliding or at_rest")
    return found
