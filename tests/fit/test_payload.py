"""A payload once on and once off: what it adds is known, so that gains of drives have a scale."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from plants.elastic_arm import CONFIGURATIONS, arm, measure, pendulum
from plants.measured_robots import deviations

from elastid.fit.identify import fit_parameters
from elastid.fit.spec import FitSpec, ParameterSpec
from elastid.response import Response
from elastid.robot import Chain, ChannelGain, Payload, Robot

EVERY = {name: ParameterSpec() for name in ("k_1", "d_1", "f_1", "fm_1", "Jm_1", "I_load", "gain_u_motor_1")}


def twice(robot: Robot, configurations: tuple[tuple[float, ...], ...], seed: int) -> list[Response]:
    """Responses of the robot with its payload, and of a robot that has none."""
    rng = np.random.default_rng(seed)
    loaded, empty = (measure(each, configurations, rng) for each in (robot, replace(robot, payload=None)))
    postures = [replace(each.configuration, name=f"empty {each.configuration.name}", carries=False) for each in empty]
    return loaded + [replace(each, configuration=posture) for each, posture in zip(empty, postures, strict=True)]


def test_two_torque_constants_of_an_arm_are_within_their_intervals() -> None:
    """One 5 % too small, one 5 % too large; springs, dampers, and inertias of links and rotors unknown."""
    heavy = replace(arm(), payload=Payload(5.0, (0.1, 0.0, 0.1), at="fore"))
    gains = (ChannelGain("u", "motor 1", 0.95), ChannelGain("u", "motor 2", 1.05))
    wrong = replace(heavy, chain=Chain(gains=gains))
    names = ("k_*", "d_*", "fm_*", "Jm_*", "I_upper_yy", "I_fore*", "m_fore", "gain_u_motor_1", "gain_u_motor_2")
    spec = FitSpec(parameters={name: ParameterSpec() for name in names}, starts=1, profile=())
    result = fit_parameters(twice(wrong, CONFIGURATIONS, 3), heavy, spec)
    places = [result.parameters.free_names.index(f"gain_u_motor_{i}") for i in (1, 2)]
    assert np.all(deviations(result, wrong)[places] < 2.6)
    assert np.all(np.sqrt(np.diag(result.covariance))[places] < 0.03)


def test_a_payload_that_is_unknown_fixes_no_scale() -> None:
    heavy = replace(pendulum(), payload=Payload(0.02, (0.3, 0.0, 0.0), at="load"))
    spec = FitSpec(parameters=EVERY | {"m_payload": ParameterSpec()}, starts=1, profile=())
    result = fit_parameters(twice(heavy, ((0.0,),), 0), heavy, spec)
    assert result.status == "ill_conditioned"
    assert all(name in result.message for name in ("m_payload", "gain_u_motor_1"))
