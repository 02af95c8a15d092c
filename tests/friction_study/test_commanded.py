"""Inertia, friction and delay from commands alone: known numbers are recovered, and the rest is named."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from plants.commanded_joints import (
    GAINS,
    LINKS,
    ONE_ROBOT,
    RATE_HZ,
    TRUE,
    TWO_ROBOT,
    one_joint,
    positions,
    positions_with_bristles,
    references,
    two_joints,
)
from plants.friction_study import friction_study
from plants.marks import slow
from scipy.signal import cont2discrete, dlsim

from elastid.app.commanded_robot import commanded_robot
from elastid.base.arrays import FloatArray
from elastid.base.statistics import QUANTILE_95, identifiable_combinations
from elastid.friction_record import FrictionRecord, FrictionRecords
from elastid.friction_study.commanded import DELAY, CommandedJoint, equivalent_gains
from elastid.friction_study.result import FrictionResult
from elastid.friction_study.sliding_friction import rigid_loads, simulated_commands, turns_against_gravity
from elastid.record import Configuration
from elastid.robot import Robot
from elastid.study import load_robot


def robot_of(text: str, folder: Path) -> Robot:
    """The robot of a model's text."""
    (folder / "robot.yml").write_text(text)
    return load_robot(folder / "robot.yml")


def log(
    q: FloatArray, r: FloatArray, gains: FloatArray, late_s: tuple[float, float] = (0.0, 0.0)
) -> tuple[FrictionRecord, ...]:
    """Records of positions and references (n, m) under gains (m, 2), with feedback that is late."""
    unknown = np.full(len(q), np.nan)
    return tuple(
        FrictionRecord(
            "log", str(i + 1), "commands", RATE_HZ, q[:, i].copy(), unknown, reference=r[:, i].copy(),
            command=gains[i, 0] * r[:, i], gains=(float(gains[i, 0]), float(gains[i, 1])), hold="zero-order",
            feedback_delays_s=late_s,
            configuration=Configuration("log", np.zeros(q.shape[1])),
        )
        for i in range(q.shape[1])
    )  # fmt: skip


def noisy(q: FloatArray, std: float) -> FloatArray:
    """Positions with white noise."""
    return np.asarray(q + np.random.default_rng(3).normal(0, std, q.shape))


def found(robot: Robot, *logs: tuple[FrictionRecord, ...]) -> FrictionResult:
    """The result of a study of all joints."""
    measured = FrictionRecords(tuple(record for records in logs for record in records))
    return friction_study(robot, measured)


def alone(
    q: FloatArray, r: FloatArray, folder: Path, factors: float | list[float] = 1.0, **keys: Any
) -> FrictionResult:
    """The result of one joint under its gains times factors."""
    return found(robot_of(ONE_ROBOT, folder), log(q, r, np.array(GAINS[:1]) * factors, **keys))


def commanded(result: FrictionResult) -> dict[str, CommandedJoint]:
    """Fits of all joints."""
    return {joint.joint: joint.commanded for joint in result.joints if joint.commanded is not None}


def assert_recovered(fit: CommandedJoint, i: int, delay_s: float) -> None:
    """Delay within 0.1 ms or its interval, J within 2 %, f and F_c within 5 %."""
    std = np.sqrt(np.diag(fit.covariance))
    assert abs(fit[DELAY] - delay_s) < max(1e-4, QUANTILE_95 * std[-1])
    assert fit["inertia"] == pytest.approx(TRUE["inertia"][i], rel=0.02)
    assert fit["viscous"] == pytest.approx(TRUE["viscous"][i], rel=0.05)
    assert fit["coulomb"] == pytest.approx(TRUE["coulomb"][i], rel=0.05)


@pytest.mark.parametrize("delay_s", [slow(0.0), 0.005, slow(0.010), slow(0.020)])
def test_one_joint_is_recovered_at_every_delay(delay_s: float, tmp_path: Path) -> None:
    """A regression on k_p (r - q) - k_d q' is off by +55 % in J and +171 % in f at 10 ms."""
    r = references(600, 1, 0.35, 4.0)
    q = noisy(positions(one_joint, r, delay_s, steps=10), 1e-4)
    result = alone(q, r, tmp_path)
    assert result.status == "identified"
    assert_recovered(commanded(result)["1"], 0, delay_s)
    assert {number.name for number in result.numbers} == {"J_m1", "f_m1", "Fc_m1", "o_m1", "T_d_m1"}
    fit = commanded(result)["1"]
    assert fit.rms < 1.1e-4
    truth, std = np.array([TRUE[name][0] for name in fit.names[:3]]), np.sqrt(np.diag(fit.covariance))[:3]
    assert np.all((std < 0.01 * truth) & (np.abs(fit.values[:3] - truth) < 3 * std))
    assert fit.speeds[1] == pytest.approx(np.abs(np.gradient(q[:, 0], 1 / RATE_HZ)).max(), rel=0.1)
    assert (fit.seconds, fit.position_std) == pytest.approx((600 / RATE_HZ, q.std()))
    moved = simulated_commands(robot_of(ONE_ROBOT, tmp_path), {"1": log(q, r, np.array(GAINS[:1]))[0]}, {"1": fit})
    assert np.std(moved - q) < 1.2e-4
    assert 1e-4 < fit.relative_error < 1e-3


@pytest.mark.parametrize("in_steps", [False, True])
def test_friction_as_a_soft_constraint_is_recovered(in_steps: bool, tmp_path: Path) -> None:
    """A joint creeps while it sticks: under a chirp, and under steps, between which it mostly sticks."""
    r = references(1200, 1, 0.35, 4.0)
    r = 0.2 * np.array([0, 1, -0.6, 0.4, -1]).repeat(240)[:, None] if in_steps else r
    q = noisy(positions(one_joint, r, 0.005, steps=10, soft=(0.02, 0.1)), 1e-5)
    result = alone(q, r, tmp_path)
    fit = commanded(result)["1"]
    assert result.status == "identified"
    assert_recovered(fit, 0, 0.005)
    assert fit["coulomb"] == pytest.approx(TRUE["coulomb"][0], rel=0.01)
    assert (fit["stick_time"], fit["creep"]) == pytest.approx((0.02, 0.1), rel=0.05)
    assert {"tau_m1", "c_m1"} <= {number.name for number in result.numbers}


@pytest.mark.parametrize("damping_s", [0.0, slow(0.01)])
def test_bristles_are_recovered(damping_s: float, tmp_path: Path) -> None:
    """With a model that sticks exactly, J is 36 % and f 109 % too high without damping of the bristles."""
    r, compliance = references(1200, 1, 0.35, 2.0), 0.01
    q = noisy(positions_with_bristles(r, compliance, damping_s), 1e-5)
    fit = commanded(alone(q, r, tmp_path))["1"]
    assert_recovered(fit, 0, 0.0)
    assert fit["bristle_compliance"] == pytest.approx(compliance, rel=0.02)
    assert fit["bristle_time"] == pytest.approx(damping_s, abs=1e-3)
    assert "stiction" not in fit.names


def test_stiction_is_recovered_from_commands(tmp_path: Path) -> None:
    """Point to point, with rests."""
    t = np.arange(1200) / RATE_HZ
    s = np.clip(t % 1 / 0.6, 0, 1)
    corners = 0.3 * np.array([0, 1, -0.6, 0.4, -1, 0.2, 0])
    r = (corners[t.astype(int)] + np.diff(corners)[t.astype(int)] * s**2 * (3 - 2 * s))[:, None]
    q = noisy(positions_with_bristles(r, 1e-3, 0.003, 0.3, 0.05), 1e-5)
    fit = commanded(alone(q, r, tmp_path))["1"]
    assert_recovered(fit, 0, 0.0)
    assert (fit["stiction"], fit["stribeck_velocity"]) == pytest.approx((0.3, 0.05), rel=0.05)
    law, _ = fit.to_friction()
    assert (law.stiction, law.stribeck_velocity) == (fit["stiction"], fit["stribeck_velocity"])


def test_a_joint_that_never_reverses_shows_the_sum_of_friction_and_offset(tmp_path: Path) -> None:
    """Neither is identifiable alone: the solution of least norm gives F_c / 2 to each, with too small intervals."""
    r = references(600, 1, 0.02, 2.0) + np.arange(600)[:, None] / RATE_HZ
    q = noisy(positions(one_joint, r, 0.005, steps=10), 1e-5)
    fit = commanded(alone(q, r, tmp_path))["1"]
    assert min(fit.std("coulomb"), fit.std("offset")) > TRUE["coulomb"][0]
    assert fit["coulomb"] + fit["offset"] == pytest.approx(TRUE["coulomb"][0], rel=0.02)


def test_late_feedback_acts_as_less_damping_and_as_inertia():
    """Held for 2 tau, velocities tau_v late: to the second order in s."""
    kp, kd, tau, tau_v = np.array([400.0]), np.array([20.0]), np.array([2e-3]), np.array([1e-3])
    damping, inertia = equivalent_gains(kp, kd, tau, tau_v)
    s = 1.0j
    held = (1 - np.exp(-2 * s * tau)) / (2 * s * tau)
    late = kp * held + kd * s * held * np.exp(-s * tau_v)
    np.testing.assert_allclose(late, kp + damping * s + inertia * s**2, rtol=0, atol=2e-4)


def test_link_loads_of_motors_equal_arm_equations(tmp_path):
    """Beside the mean inertia at each joint; a joint without gravity and coupling is loaded by nothing."""
    t = np.arange(600) / RATE_HZ
    waves = [(0.5, 3.0, 0.0), (0.4, 4.1, 0.7)]
    q, v, a = (np.stack([A * w**k * np.sin(w * t + p + k * np.pi / 2) for A, w, p in waves], axis=1) for k in range(3))
    load, carried = rigid_loads(robot_of(TWO_ROBOT, tmp_path), log(q, q, np.array(GAINS)), (q, v, a))
    torque = load + (carried + TRUE["inertia"]) * a
    moved = [two_joints(*rows) for rows in zip(v.tolist(), q.tolist(), torque.tolist(), strict=True)]
    np.testing.assert_allclose(moved[10:-10], a[10:-10], atol=0.02 * np.abs(a).max())
    (m1, a1, l1, I1), (m2, _, l2, I2) = LINKS
    mean = I1 + m1 * l1**2 + I2 + m2 * (a1**2 + l2**2 + 2 * a1 * l2 * np.cos(q[:, 1]).mean()), I2 + m2 * l2**2
    np.testing.assert_allclose(carried, mean, rtol=0.02)
    robot, one = robot_of(ONE_ROBOT, tmp_path), q[:, :1]
    assert not any(part.any() for part in rigid_loads(robot, log(one, one, np.array(GAINS[:1])), (one, one, one)))
    turns = [turns_against_gravity(each, each.driven[0], None) for each in (robot, robot_of(TWO_ROBOT, tmp_path))]
    assert turns == [False, True]


@pytest.mark.slow
@pytest.mark.parametrize("differentiates", [False, True])
def test_a_sampled_controller_takes_its_hold_from_the_friction(differentiates: bool, tmp_path: Path) -> None:
    """Feedback held for 1 ms: f is k_p T / 2 = 10 % too low with a continuous controller."""
    r = references(3000, 1, 0.35, 4.0)
    q = positions(one_joint, r, 0.005, tick=5, differentiates=differentiates)
    q += np.random.default_rng(3).normal(0, 1e-4, r.shape)
    for late_s in ((5e-4, 5e-4 * differentiates), (0.0, 0.0))[: 2 - differentiates]:
        fit = commanded(alone(q, r, tmp_path, late_s=late_s))["1"]
        if late_s[0]:
            assert_recovered(fit, 0, 0.005)
        else:
            assert fit["viscous"] == pytest.approx(TRUE["viscous"][0] - GAINS[0][0] * 5e-4, rel=0.05)


@pytest.mark.slow
@pytest.mark.parametrize("delay_s", [0.0, 0.010])
def test_armatures_of_coupled_joints_are_recovered(delay_s: float, tmp_path: Path) -> None:
    """The masses are those of the robot model; both joints share the delay, and move as measured by commands alone."""
    r = references(3000, 2, 0.4, 2.0)
    q = positions(two_joints, r, delay_s) + np.random.default_rng(1).normal(0, 1e-4, r.shape)
    robot, records = robot_of(TWO_ROBOT, tmp_path), log(q, r, np.array(GAINS))
    result = found(robot, records)
    fits = commanded(result)
    for i, fit in enumerate(fits.values()):
        assert_recovered(fit, i, delay_s)
    assert {"J_a_m1", "J_a_m2"} <= {number.name for number in result.numbers}
    moved = simulated_commands(robot, {record.joint: record for record in records}, fits)
    assert np.all(np.std(moved - q, axis=0) < 0.01 * np.std(q, axis=0))


def test_commands_in_degrees_are_a_misfit(tmp_path: Path) -> None:
    """The simulated joint sticks in all samples, so that its positions show none of the parameters."""
    r = references(600, 1, 0.35, 4.0)
    assert alone(positions(one_joint, r, 0.005), np.degrees(r), tmp_path).status == "misfit"


def test_a_joint_at_rest_changes_no_other_estimate(tmp_path: Path) -> None:
    """Its positions are exactly constant, as in a simulator, and show no parameter."""
    r = references(600, 1, 0.35, 4.0)
    q = noisy(positions(one_joint, r, 0.005, steps=10), 1e-4)
    body = ONE_ROBOT[ONE_ROBOT.index("  - name") :].replace("arm", "rest").replace("name: 1", "name: 2")
    records = log(np.hstack([q, 0 * q]), np.hstack([r, 0 * r]), np.array(GAINS)[[0, 0]])
    fits = commanded(found(robot_of(ONE_ROBOT + body, tmp_path), records))
    assert_recovered(fits["1"], 0, 0.005)
    assert (bool(fits["1"].misfit), bool(fits["2"].misfit)) == (False, True)


def test_friction_of_a_joint_without_friction_is_zero(tmp_path: Path) -> None:
    """Coulomb friction at its bound 0 is no reason against a friction model; positions of a linear system by SciPy."""
    (kp, kd), J, f, r = GAINS[0], TRUE["inertia"][0], TRUE["viscous"][0], references(600, 1, 0.35, 4.0)
    A, B, C = np.array([[0, 1], [-kp / J, -(f + kd) / J]]), np.array([[0], [kp / J]]), np.array([[1, 0]])
    loop = cont2discrete((A, B, C, np.zeros((1, 1))), 1 / RATE_HZ)
    q = noisy(dlsim(loop, r)[1], 1e-5)
    result = alone(q, r, tmp_path)
    fit = commanded(result)["1"]
    assert result.status == "identified"
    assert fit["coulomb"] < 3 * fit.std("coulomb") + 1e-6
    assert (fit["inertia"], fit["viscous"]) == pytest.approx((J, f), rel=0.02)


@pytest.mark.slow
def test_wrong_gains_are_refused_or_named(tmp_path: Path) -> None:
    """A velocity gain that is 20 % too large leaves viscous friction below 0; every result names its gains."""
    r = references(2000, 1, 0.35, 4.0)
    q = positions(one_joint, r, 0.005)
    result = alone(q, r, tmp_path, [1.0, 1.2])
    assert result.status == "failed"
    assert "friction/law" in {note.code for joint in result.joints for note in joint.notes}
    right = alone(q, r, tmp_path)
    assert "friction/gains" in {note.code for joint in right.joints for note in joint.notes}


@pytest.mark.slow
def test_wrong_position_gains_contradict_the_masses_of_the_robot_model(tmp_path: Path) -> None:
    """A single joint cannot tell them; gravity and inertia of known masses do."""
    r = references(2000, 2, 0.4, 2.0)
    q = positions(two_joints, r, 0.005)
    robot = robot_of(TWO_ROBOT, tmp_path)
    nearly_right, result = (found(robot, log(q, r, np.array(GAINS) * [factor, 1.0])) for factor in (0.8, 0.6))
    assert nearly_right.status == result.status == "misfit"
    assert min(fit["inertia"] for fit in commanded(result).values()) < 0
    motors = [joint.motor for joint in commanded_robot(robot, result).driven]  # a robot model has no negative armature
    assert all(motor is not None and motor.inertia > 0 for motor in motors)


@pytest.mark.slow
def test_a_slow_chirp_gives_the_sum_of_delay_and_friction(tmp_path: Path) -> None:
    """T_d + f / k_p is known, T_d and f are not: below k_p / (f + k_d) friction is a delay."""
    r = references(3000, 1, 0.35, 0.6)
    q = noisy(positions(one_joint, r, 0.010), 1e-3)
    result = alone(q, r, tmp_path)
    fit, last = commanded(result)["1"], [-1, 1]
    (known,) = identifiable_combinations(fit.values[last], fit.covariance[np.ix_(last, last)])
    assert known.weights[1] == pytest.approx(1 / GAINS[0][0], rel=0.1)
    assert known.value == pytest.approx(0.010 + 0.10 / GAINS[0][0], abs=2 * known.std)
    assert known.std**2 < 0.01 * fit.covariance[-1, -1]
    assert "friction/combination" in {note.code for joint in result.joints for note in joint.notes}
