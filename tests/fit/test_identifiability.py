"""Gains of channels are found with the springs, or by a payload, or named where nothing fixes their scale."""

from dataclasses import replace

import numpy as np
import pytest
from plants.elastic_arm import CONFIGURATIONS, arm, measure, started_elsewhere
from plants.measured_robots import deviations
from plants.refusals import refused

from elastid.fit.fitted_robot import FittedRobot, models_by_group
from elastid.fit.identify import fit_parameters, identify
from elastid.fit.parameter_selection import choose
from elastid.fit.spec import FitSpec, ParameterSpec, PriorSpec
from elastid.response import Response
from elastid.robot import Chain, Channel, Payload, Robot

READING = "gain_y_body_fore_y"
TORQUE = "gain_u_motor_1"
SPRINGS = {name: ParameterSpec() for name in ("k_*", "d_*", "fm_*")}
OUTPUTS = ("motor 1", "motor 2", "body fore y")


def read_as(**gains: float) -> Robot:
    """The arm whose channels read something else than what is there."""
    listed = {READING: ("y", "body fore y"), TORQUE: ("u", "motor 1")}
    return replace(arm(), chain=Chain(channels=tuple(Channel(*listed[n], g) for n, g in gains.items())))


def measured(robot: Robot, seed: int | None = 3) -> list[Response]:
    """Three configurations with 2 % noise, or exact."""
    return measure(robot, rng=None if seed is None else np.random.default_rng(seed), outputs=OUTPUTS)


def spec_of(changes: dict[str, ParameterSpec]) -> FitSpec:
    return FitSpec(parameters=SPRINGS | changes, starts=2, start_factor=1.5, seed=1, profile=())


def test_sensor_gain_is_identified_with_known_inertias() -> None:
    """A gyroscope that reads 30 % too much and a torque 10 % too low, found to 1 % with eight springs and dampers.

    Without their gains the residuals are several times the noise.
    """
    robot = read_as(**{READING: 1.3, TORQUE: 0.9})
    named = {READING: ParameterSpec(), TORQUE: ParameterSpec(prior=PriorSpec(std=0.2))}
    responses = measured(robot)
    result = identify(responses, started_elsewhere(arm(), 1.5), spec_of(named))
    assert result.status == "converged"
    assert deviations(result, robot).max() < 3.5
    assert result.inflation_factor < 1.05
    assert result.values[READING] == pytest.approx(1.3, rel=0.01)
    assert result.values[TORQUE] == pytest.approx(0.9, rel=0.01)
    assert fit_parameters(responses, arm(), spec_of({})).inflation_factor > 3


def test_the_fitted_model_reads_as_the_channels_do() -> None:
    """Responses with gains as parameters and with gains as numbers of the fitted robot are those measured."""
    robot = read_as(**{READING: 1.3, TORQUE: 0.9})
    exact = measured(robot, None)
    result = identify(exact, arm(), spec_of({READING: ParameterSpec(), TORQUE: ParameterSpec()}))
    one, (other,) = FittedRobot.of(result, arm(), exact), models_by_group(result, arm(), exact).values()
    assert {each.at: each.gain for each in other.robot.chain.channels} == pytest.approx(
        {"motor 1": 0.9, "body fore y": 1.3}, rel=1e-4
    )
    for fitted in (one, other):
        for found, wanted in zip(fitted.responses, exact, strict=True):
            np.testing.assert_allclose(found.G, wanted.G, atol=1e-4 * np.abs(wanted.G).max())


@pytest.mark.parametrize("late", [Channel("u", "", delay=4e-3), Channel("u", "motor 2", 1.0, -0.3e-3, 0.8e-3)])
def test_late_and_filtered_torques_are_identified(late: Channel) -> None:
    """Delays of either sign and a low pass of 200 Hz of the torque channels: found within 3.5 standard deviations."""
    robot = replace(arm(), chain=Chain(channels=(late,)))
    names = {name: ParameterSpec() for name in robot.chain.numbers if not name.startswith("gain")}
    result = identify(measured(robot), arm(), spec_of(names))
    assert result.status == "converged"
    assert deviations(result, robot).max() < 3.5
    assert all(result.values[name] == pytest.approx(robot.parameters()[name][0], abs=2e-5) for name in names)
    if not late.at:  # `delay` is that of the motion after the torque
        of_motion = identify(measured(robot), arm(), spec_of({"delay": ParameterSpec()}))
        assert of_motion.values["delay"] == pytest.approx(-late.delay, abs=2e-5)


def test_unidentifiable_gains_are_named_and_fixed_by_prior() -> None:
    """All gains of three motions and two torques: one factor is free."""
    gains = {f"gain_u_motor_{i}": ParameterSpec() for i in (1, 2)}
    gains |= {f"gain_y_{place.replace(' ', '_')}": ParameterSpec() for place in OUTPUTS}
    responses = measured(arm())
    free = fit_parameters(responses, arm(), spec_of(gains))
    assert free.status == "ill_conditioned"
    assert all(name in free.message for name in gains)
    for known in (ParameterSpec(prior=PriorSpec(std=0.05)), ParameterSpec(fixed=True)):
        assert fit_parameters(responses, arm(), spec_of(gains | {TORQUE: known})).status == "converged"


def test_gains_have_names_and_values_that_can_be() -> None:
    """Patterns stand for gains of a role, not for all; unknown places and wrong signs are refused."""
    chosen = choose(FitSpec(parameters={"gain_kp_*": ParameterSpec()}), arm())
    assert chosen.free_names == ("gain_kp_motor_1", "gain_kp_motor_2")
    with refused("fit/parameters", place="fit.parameters"):
        choose(FitSpec(parameters={"gain_*": ParameterSpec()}), arm())
    with refused("fit/parameters", place="fit.parameters"):
        choose(FitSpec(parameters={"gain_y_motor_1_": ParameterSpec()}), arm())
    with pytest.raises(ValueError, match="no u is at 'joint 1'; there are motor 1, motor 2"):
        replace(arm(), chain=Chain(channels=(Channel("u", "joint 1", 1.1),)))
    with pytest.raises(ValueError, match=r"^gain: "):
        Channel("y", "motor 1", -1.0)
    with pytest.raises(ValueError, match="channels has y at motor 1 twice"):
        Chain(channels=(Channel("y", "motor 1", 1.1), Channel("y", "motor 1")))
    assert not any(name.startswith("gain_") for name in choose(FitSpec(), arm()).names)


def twice(robot: Robot, configurations: tuple[tuple[float, ...], ...], seed: int) -> list[Response]:
    """Responses of the robot with its payload, and of a robot that has none."""
    rng = np.random.default_rng(seed)
    loaded, empty = (measure(each, configurations, rng) for each in (robot, replace(robot, payload=None)))
    postures = [
        replace(at, name=f"empty {at.name}", has_payload=False) for at in (each.configuration for each in empty)
    ]
    return loaded + [replace(each, configuration=posture) for each, posture in zip(empty, postures, strict=True)]


def test_two_torque_constants_of_an_arm_are_within_their_intervals() -> None:
    """One 5 % too small, one 5 % too large; springs, dampers, and inertias of links and rotors unknown."""
    heavy = replace(arm(), payload=Payload(5.0, (0.1, 0.0, 0.1), at="fore"))
    gains = (Channel("u", "motor 1", 0.95), Channel("u", "motor 2", 1.05))
    wrong = replace(heavy, chain=Chain(channels=gains))
    names = ("k_*", "d_*", "fm_*", "Jm_*", "I_upper_yy", "I_fore*", "m_fore", "gain_u_motor_1", "gain_u_motor_2")
    spec = FitSpec(parameters={name: ParameterSpec() for name in names}, starts=1, profile=())
    result = fit_parameters(twice(wrong, CONFIGURATIONS, 3), heavy, spec)
    places = [result.parameters.free_names.index(f"gain_u_motor_{i}") for i in (1, 2)]
    assert np.all(deviations(result, wrong)[places] < 2.6)
    assert np.all(np.sqrt(np.diag(result.covariance))[places] < 0.03)
