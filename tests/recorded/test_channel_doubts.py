"""Doubts about channels, from arrays: units, sides, quantities, signs; and silence where evidence is weak."""

from dataclasses import replace

import numpy as np

from elastid.experiment.specs.channels import ChannelSpec
from elastid.recorded.channel_guess import channel_doubts
from elastid.robot import Body, Joint, Limits, Motor, Robot

RATE, RATIO = 500.0, 50.0
ROBOT = Robot(
    "one", (Body("arm", joints=(Joint("1", "z", motor=Motor(1e-3, RATIO)),), inertia=2.0),), gravity=(0, 0, 0)
)
U = ChannelSpec("u", "motor 1", "tau")
Q = ChannelSpec("y", "motor 1", "q", quantity="position")
LINK = ChannelSpec("y", "joint 1", "link", quantity="position")


def signals() -> np.ndarray:
    """Torque, motor and link position (n, 3) of a joint of 4.5 kg*m^2 that moves as three sines."""
    t = np.arange(8000) / RATE
    omega = np.array([1.1, 2.9, 7.3])
    q, v, a = (sum(0.2 / w * w**k * np.sin(w * t + w + k * np.pi / 2) for w in omega) for k in range(3))
    noise = np.random.default_rng(3).standard_normal((2, len(t)))
    return np.stack([4.5 * a + 6 * v + 3 * np.sign(v) + 0.05 * noise[0], q, q + 1e-5 * noise[1]], axis=1)


def doubts(channels: tuple[ChannelSpec, ...], values: np.ndarray, robot: Robot = ROBOT) -> list[tuple[int | None, str]]:
    return [(doubt.channel, doubt.key) for doubt in channel_doubts(channels, values, RATE, robot)]


def test_right_channels_raise_no_doubt() -> None:
    assert doubts((U, Q, LINK), signals()) == []


def test_a_scale_that_no_unit_explains_is_no_doubt() -> None:
    """A sensor that is not calibrated has a gain, which the fit finds."""
    assert doubts((U, Q, LINK), signals() * np.array([1, 1, 1.6])) == []


def test_a_ratio_of_another_gear_is_named() -> None:
    """8 in place of 80: the motor turns ten times as far as the joint."""
    (doubt,) = channel_doubts((U, Q, LINK), signals() * np.array([0.1, 10, 1]), RATE, ROBOT)
    assert (doubt.channel, doubt.key) == (2, "scale")
    assert "check motor.ratio of joint 1 in the robot's file (50)" in doubt.text


def test_a_joint_does_not_leave_its_limits() -> None:
    joint = replace(ROBOT.bodies[0].joints[0], limits=Limits(angle=(-2.0, 2.0)))
    robot = replace(ROBOT, bodies=(replace(ROBOT.bodies[0], joints=(joint,)),))
    assert doubts((U, Q), signals()[:, :2], robot) == []
    assert doubts((U, Q), signals()[:, :2] * np.array([1, 57.3]), robot) == [(1, "unit")]


def test_noise_alone_raises_no_doubt() -> None:
    """Of a joint at rest neither sign nor unit can be seen."""
    values = np.random.default_rng(5).standard_normal((5000, 3))
    assert doubts((U, Q, LINK), values) == []


def test_a_velocity_is_no_position() -> None:
    values = signals()
    values[:, 2] = np.gradient(values[:, 1], 1 / RATE)
    assert doubts((U, Q, LINK), values) == [(2, "quantity")]


def test_a_torque_beside_the_angle_of_the_motor_is_on_its_side_too() -> None:
    """Of a drive's raw signals that are both taken for the link's, one doubt names both."""
    raw = signals() * np.array([1 / RATIO, RATIO, 1])
    (doubt,) = channel_doubts((U, Q, LINK), raw, RATE, ROBOT)
    assert (doubt.channel, doubt.key) == (1, "side")
    assert doubts((replace(U, side="motor"), replace(Q, side="motor"), LINK), raw) == []


def test_a_unit_that_the_name_says_is_believed() -> None:
    """Of an angle in deg on the motor's side the side is doubted, and never the unit, which arcmin would mend too."""
    named = replace(Q, channel="q_deg", unit="deg")
    for ratio in (RATIO, 60.0):
        values = signals() * np.array([1, ratio * 180 / np.pi, 1])
        robot = replace(ROBOT, bodies=(replace(ROBOT.bodies[0], joints=(Joint("1", "z", motor=Motor(1e-3, ratio)),)),))
        assert doubts((U, named, LINK), values, robot) == [(1, "side")]
