"""The motions of one joint of a friction study: passes under every load, torques at standstill, and a warm-up."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace

import numpy as np

from elastid.base.errors import StudyError
from elastid.design.friction_axis import Axis
from elastid.excitation.standstill import growing_loops, small_multisine
from elastid.experiment.plan.friction import JointPassDesign, PlannedMotion, PlannedWarmUp
from elastid.experiment.plan.passes import PassLimits, pass_time, plan_passes, planned_pass
from elastid.friction_study.spec import FrictionSpec, LoadSpec, PassesSpec, WarmUpSpec
from elastid.record import Configuration

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
