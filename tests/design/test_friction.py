"""Plans of friction studies: speeds within what a joint can do, and refusals by name."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from plants.friction_axis import LIMITS, axis, planned
from plants.refusals import refused

from elastid.design.friction import StribeckGuess, _information, axis_of, default_window, guess_friction, optimal_speeds
from elastid.experiment.plan.friction import pass_reference
from elastid.experiment.specs.simulated import ControllerSpec
from elastid.friction_study import spec
from elastid.friction_study.spec import ConstantVelocitySpec, FrictionSpec, LoadSpec, WarmUpSpec
from elastid.record import Configuration
from elastid.robot import Joint, Limits
from elastid.robot.simplified import without_friction


def test_runs_stay_in_limits_with_certified_efficiency() -> None:
    """All defaults: slow enough for stiction, as fast as window and torque allow, the same for a seed."""
    plan = planned(FrictionSpec())
    (design,) = plan.designs
    assert design.speed[0] < 0.05 * 8.0 / 100
    assert design.speed[-1] > 1.0
    assert design.efficiency > 0.9
    assert {motion.planned.speed for motion in plan.motions if motion.planned} == set(design.speed.tolist())
    for motion in plan.motions:
        assert motion.planned is not None
        reference = pass_reference(motion.planned, design.limits, plan.rate_hz)
        assert design.limits.window[0] - 1e-3 < reference.position.min()
        assert reference.position.max() < design.limits.window[1] + 1e-3
        assert np.abs(reference.acceleration).max() < 1.02 * LIMITS.acceleration
    assert plan.robot_time_s == pytest.approx(sum(np.diff([m.start_s for m in plan.motions])), rel=0.1)
    again = planned(FrictionSpec())
    assert [motion.name for motion in again.motions] == [motion.name for motion in plan.motions]
    assert len({motion.name for motion in plan.motions}) == len(plan.motions)


def test_loads_loops_and_rest_come_after_each_other() -> None:
    """Amplitudes are parts of break-away and of Coulomb friction; a payload takes torque and so acceleration."""
    loads = (LoadSpec("empty"), LoadSpec("full", payload=10.0))
    still = {"presliding_loops": spec.PreslidingLoopsSpec(), "presliding_test": spec.PreslidingTestSpec()}
    plan = planned(FrictionSpec(loads=loads, **still))
    assert [m.load for m in plan.motions if m.purpose == "constant_velocity"].count("full") == 26
    (loops,) = (motion.torque for motion in plan.motions if motion.purpose == "presliding_loops")
    assert loops is not None
    assert np.abs(loops).max() == pytest.approx(0.95 * 34.0)
    peaks = [np.abs(m.torque).max() for m in plan.motions if m.purpose == "presliding_test" and m.torque is not None]
    assert peaks == pytest.approx([1.25, 1.25, 2.5, 2.5])
    starts, lengths = zip(*((m.start_s, 0 if m.torque is None else len(m.torque)) for m in plan.motions), strict=True)
    assert np.all(np.diff(starts) >= np.array(lengths[:-1]) / plan.rate_hz)
    moved = planned(FrictionSpec(presliding_test=spec.PreslidingTestSpec()), axis(replace(LIMITS, angle=(-1.0, 2.0))))
    at_rest = [m.configuration.angles[0] for m in moved.motions if m.purpose == "presliding_test"]
    assert at_rest == pytest.approx(4 * [np.mean(moved.designs[0].limits.window)])


def test_a_warm_up_is_followed_by_tests() -> None:
    plan = planned(FrictionSpec(warm_up=WarmUpSpec(speed=1.0, time=1800.0, test_every=300.0)))
    (warm_up,) = plan.warm_ups
    tests = [motion for motion in plan.motions if motion.is_warm_up]
    assert len(tests) == 7 * 3
    assert tests[0].start_s == warm_up.start_s
    assert tests[-3].start_s == pytest.approx(warm_up.start_s + 1800.0)


def test_robot_without_friction_is_planned_by_typical_gears() -> None:
    """It is larger by as much as the motor is stronger, at the same part of its highest speed."""
    assert "friction of common gears" in planned(FrictionSpec(), axis(law=None)).assumed_friction[0]
    planned(FrictionSpec(), axis(Limits(), None))
    curves = []
    for torque, speed in ((400.0, 2.0), (1200.0, 10.0)):
        robot = without_friction(axis(Limits(torque=torque, velocity=speed), None))
        guess = guess_friction(robot, robot.driven[0], 1.0)
        curves.append([guess.torque(part * speed) / torque for part in (0.0, 0.05, 1.0)])
    np.testing.assert_allclose(*curves)
    known = guess_friction(axis(), axis().driven[0], 1.0)
    assert [known.torque(speed) for speed in (0.0, 2.0)] == pytest.approx([34.0, 25.0 + 15.0 * 2.0])


REFUSED = [
    ({"speeds": (0.01, 1.9), "window": (-0.2, 0.2)}, LIMITS, 8.0, ".window"),
    ({"speeds": (0.01, 2.5)}, LIMITS, 8.0, ".speeds"),
    ({"speeds": (0.01, 1.0)}, replace(LIMITS, torque=90.0), 8.0, ""),
    ({"speeds": (0.01, 1.9)}, replace(LIMITS, torque=118.0), 8.0, ".speeds"),
    ({"speeds": (0.01, 1.0)}, LIMITS, 0.5, ".speeds"),
    ({"speeds": (0.01, 0.03)}, LIMITS, 8.0, ".speeds"),
]


@pytest.mark.parametrize(("passes", "limits", "bandwidth_hz", "place"), REFUSED)
def test_what_cannot_be_done_is_refused_by_name(
    passes: dict[str, Any], limits: Limits, bandwidth_hz: float, place: str
) -> None:
    with refused("friction/plan", place=f"friction.constant_velocity{place}"):
        planned(FrictionSpec(constant_velocity=ConstantVelocitySpec(**passes)), axis(limits), bandwidth_hz)


# Axis 2 of a large robot at 40 degC, in parts of its rating (LiTH-ISY-R-2948).
GUESS = StribeckGuess(3.11e-2, 7.01e-2, 3.21e-4, 14.4, 1.36)


def test_no_speed_would_help_more_than_the_certificate_says() -> None:
    """d = 5 times (1 + excess) bounds the gain of every candidate; log-spaced speeds are worse by a fifth or more."""
    speed, passes, _ = optimal_speeds([GUESS], 0.5, 250.0, 50)
    H = _information(GUESS, np.geomspace(0.5, 250.0, 200))
    M = np.einsum("q,qij->ij", passes / 50, _information(GUESS, speed))
    assert np.einsum("ij,qji->q", np.linalg.inv(M), H).max() < 5 * 1.1
    spread = _information(GUESS, np.geomspace(0.5, 250.0, 50)).mean(axis=0)
    assert (np.linalg.det(spread) / np.linalg.det(M)) ** (1 / 5) < 0.8


@settings(max_examples=10, deadline=None)
@given(torque=st.floats(140.0, 180.0), bandwidth_hz=st.floats(4.0, 15.0))
def test_ramps_take_the_torque_that_gravity_and_friction_leave(torque: float, bandwidth_hz: float) -> None:
    """Of 90 % of any limit; the loop lags by break-away to both sides, and windows without limits have their size."""
    robot = axis(replace(LIMITS, torque=torque, acceleration=np.inf))
    (joint,) = robot.driven
    runs, controller = ConstantVelocitySpec(), ControllerSpec(bandwidth_hz)
    found = axis_of(robot, joint, Configuration("up", np.zeros(1)), runs, controller)
    room = 0.9 * torque - found.holding - found.guess.stiction
    taken = max(0.2 * room, room - found.guess.viscous * LIMITS.velocity)
    assert found.inertia * found.limits.acceleration == pytest.approx(taken)
    loop = found.inertia * (2 * np.pi * bandwidth_hz) ** 2
    assert found.limits.lag * loop == pytest.approx(2 * found.guess.stiction)
    assert default_window(Joint("1")) == (-1.0, 1.0)
    assert default_window(Joint("1", limits=Limits((-1.0, 3.0)))) == (0.0, 2.0)
    assert default_window(Joint("1", motion="translation")) == (-0.25, 0.25)


@given(speed=st.floats(0.5, 250.0))
def test_planned_friction_decreases_from_stiction_by_its_slope(speed: float) -> None:
    h = 1e-5 * speed
    assert GUESS.torque(0.0) == pytest.approx(GUESS.stiction)
    assert GUESS.slope(speed) == pytest.approx((GUESS.torque(speed + h) - GUESS.torque(speed - h)) / (2 * h), abs=1e-6)
