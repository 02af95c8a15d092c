"""Positions from commands alone, beside trivial predictors: against logs of an integrator of its own, and real ones."""

from dataclasses import replace

import numpy as np
import pytest
from plants.commanded_joint import CommandedJoint
from plants.measured import measured
from plants.quadruped import NAMES, QUADRUPED, robot_of_commands

from elastid.logs.command_log import read_command_log
from elastid.record import JointLoop
from elastid.validation.command_replay import CommandedMotion, Replay, overall, pooled_tests, replay


@pytest.fixture(scope="module")
def motion() -> CommandedMotion:
    """The log of the joint, without a delay."""
    return CommandedJoint().motion()


def best(result: Replay) -> tuple[str, float]:
    """The most likely wrong number, and its value; nothing without a doubt."""
    doubts = [test for test in pooled_tests([result, result]) if test.is_in_doubt]
    assert all(0 < test.removed_fraction <= 1 and test in result.tests for test in doubts)
    return (doubts[0].quantity, doubts[0].value) if doubts else ("", 1.0)


def test_correct_model_beats_trivial_predictors(motion: CommandedMotion) -> None:
    """Within 0.6 mrad, of which half a sample of the simulated drives is most; the fitted delay is (f + kd) / kp."""
    result = replay(CommandedJoint().robot, motion)
    (joint,) = result.joints
    assert joint.rms[0] < 6e-4
    assert min(joint.rms[1:]) > 0.04
    assert not joint.is_worse
    assert best(result)[0] == ""
    assert joint.delay_s == pytest.approx(1.25 / 20, rel=0.15)  # and friction


@pytest.mark.parametrize(
    ("quantity", "change", "expected"),
    [
        ("clock", {"rate_hz": 500.0}, 2.5),
        ("kp", {"gains": JointLoop(np.array([24.0]), np.array([1.0]), np.zeros(1))}, 1 / 1.2),
        ("kd", {"gains": JointLoop(np.array([20.0]), np.array([1.3]), np.zeros(1))}, 1 / 1.3),
    ],
)
def test_wrong_number_of_the_replay_is_named_with_its_factor(
    motion: CommandedMotion, quantity: str, change: dict[str, object], expected: float
) -> None:
    """A replay of 2 ms for a log of 5 ms, and gains 20 and 30 % off."""
    found = best(replay(CommandedJoint().robot, replace(motion, **change)))
    assert found == (quantity, pytest.approx(expected, rel=0.015))


def test_late_commands_are_named_with_their_delay() -> None:
    """15 ms, to half a sample of the simulated drives."""
    late = CommandedJoint(delay_s=0.015)
    motion = late.motion()
    assert best(replay(late.robot, motion)) == ("delay", pytest.approx(0.015, abs=5e-4))
    assert not best(replay(late.robot, replace(motion, delay_s=0.015)))[0]


def test_reversed_signs_are_named(motion: CommandedMotion) -> None:
    """Of the position alone, and of command and position, which only gravity shows."""
    robot, reversed_position = CommandedJoint().robot, replace(motion, position=-motion.position)
    assert best(replay(robot, reversed_position))[0] == "position sign"
    assert best(replay(robot, replace(reversed_position, command=-motion.command)))[0] == "joint direction"


def test_model_of_a_free_joint_is_worse_than_the_command(motion: CommandedMotion) -> None:
    """A model with a hundredth of the gains hangs down."""
    loose = JointLoop(motion.gains.kp / 100, motion.gains.kd / 100, motion.gains.ki)
    assert replay(CommandedJoint().robot, replace(motion, gains=loose), with_tests=False).joints[0].is_worse


def test_octaves_divide_the_error_of_the_still_joint() -> None:
    """A sine of 3 Hz is in its octave, with A / sqrt 2."""
    motion = CommandedJoint().motion(10.0)
    t = np.arange(len(motion.position)) / motion.rate_hz
    sine = np.stack([0.1 * np.sin(2 * np.pi * 3.0 * t)], axis=1)
    (joint,) = replay(CommandedJoint().robot, replace(motion, position=sine), with_tests=False).joints
    rms = [(low < 3.0 < high, errors[1]) for low, high, errors in joint.octaves]
    assert [error for inside, error in rms if inside] == [pytest.approx(0.1 / np.sqrt(2), rel=1e-3)]
    assert max(error for inside, error in rms if not inside) < 1e-3
    assert joint.octaves[-1][1] == motion.rate_hz / 2


@pytest.mark.slow
def test_quadruped_at_wrong_clock_has_factor_2_5() -> None:
    """Real logs of 12 joints: a regression on log 0 predicts log 7 to 6 mrad; at 2 ms for 5 ms hardly the command."""
    logs = [read_command_log(measured(f"{QUADRUPED}/log_{i}.npz"), NAMES) for i in (0, 7)]
    robot = robot_of_commands(logs[0])
    log = logs[1]
    assert log.kp is not None
    assert log.kd is not None
    gains = JointLoop(log.kp, log.kd, np.zeros(12))
    motion = CommandedMotion("log_7", log.rate_hz, log.command, log.velocity, log.position, gains)
    model, _, command, _ = overall(replay(robot, motion, with_tests=False).joints)
    assert model < 0.006
    assert command == pytest.approx(0.079, rel=0.05)
    wrong = replay(robot, replace(motion, rate_hz=500.0))
    assert overall(wrong.joints)[0] > 0.9 * command
    assert best(wrong) == ("clock", pytest.approx(2.5, rel=0.08))
