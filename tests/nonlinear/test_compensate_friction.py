"""Friction taken out of responses and shafts: the errors of its coefficients, its reversals, and where it ends."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from plants.dry_friction import COULOMB as LEVELS
from plants.dry_friction import measured, measured_bristles, measured_swing, robot

from elastid.fit.parameter_selection import local_ratio_std
from elastid.frf.estimate import estimate
from elastid.frf.spec import EstimatorSpec
from elastid.nonlinear.compensate_friction import compensated_records, to_links, to_shafts
from elastid.nonlinear.compensated_friction import CompensatedFriction
from elastid.nonlinear.friction_basis import BasisFunction
from elastid.nonlinear.identify_friction import identify_motor_friction
from elastid.nonlinear.motion import CELLS, Motion, motion_of
from elastid.nonlinear.net_response import TURNING_ERROR, estimate_net_response
from elastid.record import Configuration, Record
from elastid.robot import Body, Joint, Motor, Robot, Spring

COULOMB, AUTO = EstimatorSpec(friction="coulomb"), EstimatorSpec(friction="auto")
UNEXPLAINED = "nonlinear/unexplained-distortion"
E = np.array([[1.0, 0.0], [-0.4, 1.0]])


@pytest.fixture(scope="module")
def found() -> CompensatedFriction:
    (records, _), lines = measured()
    return identify_motor_friction([records], COULOMB, lines)


@pytest.mark.slow
def test_coefficient_errors_match_response_changes(found: CompensatedFriction) -> None:
    """With the friction of motor 1 off by its standard deviation, at every line to 5 % of the largest."""
    (records, _), lines = measured()
    error = 0.01 * found.coulomb_torque * np.array([shape.place == "motor 1" for shape in found.shapes])
    sole = replace(found, covariance=np.outer(error, error))
    response = estimate_net_response(records, sole, COULOMB, lines)
    off = replace(sole, coulomb_torque=sole.coulomb_torque + error)
    change = estimate(list(compensated_records(records, off)), COULOMB, lines).G - response.G
    sign = np.sign(np.vdot(response.bias[2, 0], change).real)
    np.testing.assert_allclose(sign * response.bias[2, 0], change, atol=0.05 * np.abs(change).max())


def test_couplings_of_gears_turn_the_errors_with_the_response(found: CompensatedFriction) -> None:
    """Records on the link side of coupled gears: G is E^-1 G' E^-T of that on the shafts, and so are its errors."""
    (records, _), lines = measured()
    shafts = estimate_net_response(records, found, COULOMB, lines)
    links = estimate_net_response([to_links(each, E) for each in records], found, COULOMB, lines, E)
    assert to_shafts(to_links(records[0], E), E).inputs == records[0].inputs
    inverse = np.linalg.inv(E)
    np.testing.assert_allclose(links.G, inverse @ shafts.G @ inverse.T, rtol=1e-6, atol=1e-9)
    turned = inverse @ shafts.bias[2] @ inverse.T
    np.testing.assert_allclose(links.bias[2], turned, atol=1e-3 * np.abs(turned).max())


@pytest.mark.slow
def test_unexplained_distortion_of_motor_is_reported(found: CompensatedFriction) -> None:
    """Of Coulomb friction behind the gears, which stays in the response; not of that at the motors, taken out."""
    (behind, *_), lines = measured_bristles("joint")
    left = identify_motor_friction([behind], AUTO, lines)
    assert left.compensated_motors() == ()
    (note,) = [one for one in estimate_net_response(behind, left, AUTO, lines).notes if one.code == UNEXPLAINED]
    assert note.severity == "warning"
    (records, _), lines = measured()
    assert UNEXPLAINED not in {one.code for one in estimate_net_response(records, found, COULOMB, lines).notes}


@pytest.mark.slow
def test_distortion_of_an_arm_that_swings_is_not_warned_of() -> None:
    """Above the noise as far as friction behind the gears is; the robot's file tells the one from the other."""
    (swing,), lines = measured_swing()
    (behind,), _ = measured_bristles("joint")
    for records, cases in ((swing, ((None, True), (robot(), False))), (behind, ((robot(), True),))):
        friction = identify_motor_friction([records], AUTO, lines)
        assert friction.compensated_motors() == ()
        for machine, warned in cases:
            response = estimate_net_response(records, friction, AUTO, lines, robot=machine)
            assert (UNEXPLAINED in {one.code for one in response.notes}) is warned


@pytest.mark.slow
@pytest.mark.parametrize("coulomb", [(0.0, 0.0), LEVELS])
def test_two_periods_from_rest_bend_no_spring(coulomb: tuple[float, float]) -> None:
    """A transient lies between the excited lines, as distortion does: gears are not judged by it, and the second period
    shows friction within 2 %."""
    (records, _), lines = measured(coulomb, 2)
    t = np.arange(records[0].n_samples) / records[0].rate_hz
    decaying = 0.3 * (np.exp(-8 * t) * np.sin(20 * t))[:, None]
    begun = [replace(record, y=record.y + record.y.std(axis=0) * decaying) for record in records]
    friction = identify_motor_friction((begun,), AUTO, lines)
    np.testing.assert_allclose([friction.coulomb_friction(place)[0] for place in friction.places], coulomb, rtol=0.02)
    response = estimate_net_response(begun, friction, AUTO, lines, robot=robot(coulomb))
    assert not [note for note in response.notes if note.severity == "warning"]


def test_gear_ratio_is_estimated_from_whole_turns() -> None:
    """0.3 % within a turn, a tenth of it over ten; none of a motor whose numbers are given at the link."""
    bodies, parent = [], "base"
    for name, ratio in (("1", 100.0), ("2", -100.0), ("3", 1.0)):
        bodies.append(
            Body(name, parent, joints=(Joint(name, "z", Spring(1e4, 10.0), Motor(1e-3, ratio)),), inertia=1.0)
        )
        parent = name
    three = Robot("three", tuple(bodies))
    travel = dict(zip(three.motor_locations, (0.01, 0.2 * np.pi, 2.0), strict=True))
    np.testing.assert_allclose(local_ratio_std(three, travel), [0.003, 0.0003, 0.0], rtol=1e-3)
    assert not local_ratio_std(None, travel).any()
    (records, _), lines = measured()
    moved = np.max([np.ptp(record.y, axis=0) for record in records], axis=0)
    response = estimate_net_response(records, None, COULOMB, lines, None, robot())
    np.testing.assert_array_equal(
        response.ratio_std, local_ratio_std(robot(), dict(zip(response.inputs, moved, strict=True)))
    )


def record() -> Record:
    rng = np.random.default_rng(0)
    places = ("motor 5", "motor 6")
    return Record(
        "r", Configuration("c", [0.0, 0.0]), 0, 0, 100.0, 40, places, ("accelerometer tool z", *places[::-1]),
        ("acceleration", "position", "position"), rng.standard_normal((80, 2)), rng.standard_normal((80, 3)),
        rng.standard_normal((80, 2)),
    )  # fmt: skip


def test_power_is_invariant_and_mapping_invertible() -> None:
    """u^T q of motors, whatever the order of the outputs; other outputs stay."""
    links, shafts = record(), to_shafts(record(), E)

    def power(one: Record) -> np.ndarray:
        return one.u[:, 0] * one.y[:, 2] + one.u[:, 1] * one.y[:, 1]

    np.testing.assert_allclose(power(shafts), power(links))
    np.testing.assert_array_equal(shafts.y[:, 0], links.y[:, 0])
    np.testing.assert_allclose(shafts.y[:, 1], -0.4 * links.y[:, 2] + links.y[:, 1])
    back = to_links(shafts, E)
    for name in ("u", "y", "r"):
        np.testing.assert_allclose(getattr(back, name), getattr(links, name), atol=1e-14)
    assert to_shafts(links, None) is links


def test_a_shaft_needs_the_motions_of_all_motors() -> None:
    """With one motor's encoder missing no motor is among the outputs, and friction is left where it is."""
    one = record()
    partial = replace(one, y=one.y[:, :2], outputs=one.outputs[:2], quantities=one.quantities[:2])
    assert to_shafts(partial, E).outputs == ("accelerometer tool z",)


def test_torque_equal_to_reference_is_not_compensated() -> None:
    """Of the second motor alone: its controller's torque was not logged."""
    configurations, lines = measured()
    copied = [
        [replace(r, r=np.column_stack([r.r[:, 0], r.u[:, 1]])) for r in records if r.r is not None]
        for records in configurations
    ]
    result = identify_motor_friction(copied, AUTO, lines)
    assert result.shapes == ()
    assert "the torque of motor 2 equals the reference to the last bit" in result.notes[0].text


RATE, N, PERIODS = 100.0, 200, 3
J, K, D, LEVEL = 1.0, 900.0, 6.0, 0.25
STEPS = 512


@cache
def simulated() -> tuple[Record, np.ndarray]:
    """A mass on a spring with Coulomb friction, its torque held over each sample; times at which it turns back."""
    t = np.arange(N) / RATE
    phases = np.random.default_rng(3).uniform(0, 2 * np.pi, 12)
    u = np.sum([np.sin(2 * np.pi * k * RATE / N * t + p) for k, p in zip(range(3, 27, 2), phases, strict=True)], axis=0)
    q = v = 0.0
    angles, turning, dt = [], [], 1 / (RATE * STEPS)
    for i in range(2 * PERIODS * N):
        angles.append(q)
        for step in range(STEPS):
            before, a = v, (u[i % N] - K * q - D * v - LEVEL * (1.0 if v > 0 else -1.0)) / J
            v += dt * a
            q += dt * (before + v) / 2
            if before * v < 0:
                turning.append((i + (step + before / (before - v)) / STEPS) / RATE - PERIODS * N / RATE)
    configuration = Configuration("c", np.zeros(1))
    record = Record(
        "c", configuration, 0, 0, RATE, N, ("motor 1",), ("motor 1",), ("position",), np.tile(u, PERIODS)[:, None],
        np.array(angles)[PERIODS * N :, None], hold="zero-order",
    )  # fmt: skip
    return record, np.array([time for time in turning if time > 0])


def friction_of(accelerance: float) -> CompensatedFriction:
    return CompensatedFriction(
        ("motor 1",), ("N*m",), (BasisFunction("motor 1", "sign"),), np.array([LEVEL]), np.eye(1), ("c",),
        np.ones((1, 1)), np.ones((1, 1)), np.ones(1), np.array([accelerance]),
    )  # fmt: skip


def lateness(motion: Motion) -> np.ndarray:
    """By how many samples each true reversal is found late."""
    _, turning = simulated()
    v = motion.velocity
    at = np.flatnonzero(v[1:] * v[:-1] < 0)
    found = (at + v[at] / (v[at] - v[at + 1])) / CELLS
    late = np.array([found[np.argmin(np.abs(found - RATE * time))] - RATE * time for time in turning])
    # Those that stick for a moment have no time of their own.
    return late[np.abs(late) < 0.5]


def test_late_reversals_have_error_of_responses() -> None:
    record, _ = simulated()
    late = lateness(friction_of(1 / J).motion(record, "motor 1"))
    assert len(late) > 50
    assert 0.5 * TURNING_ERROR < late.mean() < 1.5 * TURNING_ERROR


def test_reversals_are_detected_by_torque_above_excitation() -> None:
    """Noise of 1 % of the angle: they are off by less than 0.7 of what they are by the angle alone."""
    record, _ = simulated()
    noise = 0.01 * np.std(record.y) * np.random.default_rng(4).standard_normal(record.y.shape)
    record = replace(record, y=record.y + noise)
    by_angle, by_torque = motion_of(record, "motor 1"), friction_of(1 / J).motion(record, "motor 1")
    assert np.mean(lateness(by_torque) ** 2) < 0.7**2 * np.mean(lateness(by_angle) ** 2)
