"""Friction of joints that move together, beside a rigid body whose numbers are not known."""

from dataclasses import replace

import numpy as np
import pytest
from plants.arm import INERTIA, MASS, OFFSET
from plants.moving_arm import ARM, COULOMB, RATE, VISCOUS, motion
from plants.refusals import refused

from elastid.friction_study.inverse_dynamics_regression import regress_robot_motion
from elastid.friction_study.motion_signals import MotionLog
from elastid.friction_study.rigid_body_columns import rigid_body_torques, torques_in_file
from elastid.friction_study.sliding_friction import check_torques


def test_friction_is_identified_beside_unknown_rigid_body() -> None:
    """Ten logs: unbiased, and most of the 95 % intervals hold the truth."""
    robot, errors, held = ARM, [], []
    for seed in range(10):
        found = regress_robot_motion(robot, [MotionLog.of(motion(seed), {}, 10.0)])[0]
        for i, joint in enumerate(("1", "2")):
            fit = found[joint].regression
            for name, truth in (("coulomb", COULOMB[i]), ("viscous", VISCOUS[i])):
                errors.append((fit[name] - truth) / fit.std(name))
                held.append(abs(errors[-1]) < 1.96)
            assert found[joint].notes[0].severity == "information"
    assert np.mean(held) >= 0.85
    assert abs(np.mean(errors)) < 0.7


@pytest.mark.parametrize(("samples", "codes"), [(0, set()), (3, {"friction/delay"})])
def test_late_torques_of_joints_that_move_together_are_in_the_intervals(samples: int, codes: set[str]) -> None:
    """A torque delay of 12 ms biases viscous friction by 5 to 30 %; a log without a delay has no note."""
    late = {name: replace(log, torque=np.roll(log.torque, samples)) for name, log in motion(1).items()}
    fits = regress_robot_motion(ARM, [MotionLog.of(late, {}, 10.0)])[0]
    for i, fit in enumerate(fits.values()):
        error = abs(fit.regression["viscous"] - VISCOUS[i])
        assert error < 1.96 * fit.regression.std("viscous")
        assert (error > 0.05 * VISCOUS[i]) == (samples > 0)
        assert {note.code for note in fit.notes} - {"friction/rigid-body"} == codes


def test_rest_and_reversal_are_excluded_from_regression() -> None:
    """Torque there is any below break-away: 30 Nm at rest and reversals of the second joint change nothing."""
    log = motion(6)
    second = log["2"]
    v = np.gradient(second.position) * RATE
    sticking = replace(second, torque=second.torque + 30.0 * (np.abs(v) < 1e-3 * np.abs(v).max()))
    fits = [
        regress_robot_motion(ARM, [MotionLog.of(motions, {}, 10.0)])[0]
        for motions in (log, {"1": log["1"], "2": sticking})
    ]
    assert not fits[0]["1"].misfit
    assert sum(fits[0]["2"].seconds.values()) == pytest.approx(20.0)
    assert fits[0]["2"].seconds["near a reversal, rest or end"] > 1.0
    for name in ("coulomb", "viscous"):
        assert fits[1]["2"].regression[name] == pytest.approx(fits[0]["2"].regression[name], rel=1e-6)


def test_motor_torques_are_not_read_as_joint_torques() -> None:
    """Whatever friction takes beside the rigid body, right torques are not refused."""
    robot, log = ARM, motion(5)
    expected = torques_in_file(robot, MotionLog.of(log, {}, 10.0))
    torques = {name: each.torque for name, each in log.items()}
    check_torques(robot, torques, expected, "log.csv")
    check_torques(robot, {name: 0.3 * torque for name, torque in torques.items()}, expected, "log.csv")
    for factor, word in ((1 / 100, "of the motors"), (100.0, "of the joints")):
        with refused("friction/rigid-body", place="log.csv", holds=word):
            check_torques(robot, {name: factor * torque for name, torque in torques.items()}, expected, "log.csv")


def test_base_parameters_of_a_known_robot_lie_within_their_stds() -> None:
    """Each is its number and those that the motions cannot separate from it, times the table of the regressor."""
    truth = []
    for m, c, inertia in zip(MASS, OFFSET, INERTIA, strict=True):
        # About the origin of its frame; the centre of mass is along x.
        truth += [m, m * c, 0.0, 0.0, inertia, inertia + m * c**2, inertia + m * c**2, 0.0, 0.0, 0.0]
    truth += [0.0, 0.0, 0.0, 0.0]  # the logs have neither rotors nor offsets
    scores = []
    for seed in range(6):
        body = regress_robot_motion(ARM, [MotionLog.of(motion(seed), {}, 10.0)])[0]["1"].rigid_body
        scores.append((body.values - body.regrouped @ np.array(truth)) / body.std)
    assert np.mean(np.abs(scores) < 1.96) >= 0.9
    assert "mcx_2" in body.names


def test_rigid_body_is_not_extrapolated_beyond_its_motions() -> None:
    """Of both axes it holds for the first alone; of the first alone not for both."""
    robot, both = ARM, MotionLog.of(motion(1), {}, 10.0)
    first = MotionLog.of({"1": both.signals["1"].motion}, {"2": 0.4}, 10.0)
    of_both, of_first = (regress_robot_motion(robot, [log])[0]["1"].rigid_body for log in (both, first))
    assert of_both is not None
    assert of_first is not None
    assert set(rigid_body_torques(robot, of_both, first)) == {"1"}
    with refused("friction/rigid-body"):
        rigid_body_torques(robot, of_first, both)
