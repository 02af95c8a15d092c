"""FittedRobot: numbers, linear model and response of each configuration, with what the motion added to responses."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from plants.elastic_arm import arm
from plants.elastic_arm import measured as measured
from plants.elastic_arm import result as result
from plants.moved_posture import posture_effect
from plants.paths import ROBOTS

from elastid.base.errors import UnknownNameError
from elastid.fit.fitted_robot import FittedRobot
from elastid.fit.identify import fit_parameters, identify
from elastid.fit.result import Result
from elastid.fit.spec import FitSpec, ParameterSpec
from elastid.linear.linearise import Linearisation
from elastid.linear.modes import modes
from elastid.linear.response.transfer import to_response
from elastid.record import Configuration
from elastid.response import Covariance, MotorMotion, Response
from elastid.study import load_robot


def test_the_result_has_the_model_of_each_configuration(measured, result) -> None:
    """Response, deviation and modes on lines of one's own; no other place, and no interval of a held number."""
    fitted = FittedRobot.of(result, arm(), measured)
    for G, linear, modelled, own in zip(measured, fitted.linear, fitted.responses, fitted.models, strict=True):
        model = result.model(G.configuration.name)
        np.testing.assert_allclose(model.response(G.freq_hz).G, modelled.G, rtol=1e-6)
        np.testing.assert_allclose(model.response_std(G.freq_hz), own.response_std(G.freq_hz), rtol=1e-4)
        np.testing.assert_allclose(model.modes().freq_hz, modes(linear, fitted.theta).freq_hz, rtol=1e-7)
        np.testing.assert_allclose(model.state_space().response(np.array([7.0])), model.response(7.0).G, rtol=1e-9)
    with pytest.raises(UnknownNameError):
        result.model("nowhere")
    with pytest.raises(UnknownNameError):
        result.interval("m_fore")


LINKAGE = load_robot(ROBOTS / "linkage_arm.yml")
TRUTH = LINKAGE.parameters()
POSTURES = ((0.0, 0.0), (0.5, -0.1), (0.2, 0.9))
WANTED = FitSpec(starts=1, profile=(), parameters={name: ParameterSpec() for name in ("k_*", "d_2", "d_3")})
FREQ = np.linspace(2.5, 60, 24)


@cache
def measured_moved_posture() -> tuple[Response, ...]:
    """Exact responses of the linkage that swings by 0.02 rad, with 0.1 % of noise in their covariance alone."""
    linearisation, responses = Linearisation.of_robot(LINKAGE), []
    model, lines = linearisation.model, np.array([0.5, 2.5, 4.5, 7.5])
    power = np.tile(np.eye(2) * 0.02**2 / len(lines) + 0j, (len(lines), 1, 1))
    for i, angles in enumerate(POSTURES):
        linear = linearisation.at(Configuration(f"c{i}", angles), model.theta, model.inputs, "acceleration")
        motion = MotorMotion(model.inputs, lines, power, np.array(angles))
        rest = to_response(linear, linear.theta_ref, FREQ)
        moved = rest.G + posture_effect(model, linear, linear.theta_ref, motion, FREQ)
        noise = Covariance((1e-3 * np.abs(rest.G)) ** 2, np.inf)
        responses.append(replace(rest, G=moved, noise=noise, motion=motion))
    return tuple(responses)


@cache
def fitted() -> Result:
    """From springs 5 % off."""
    start = LINKAGE.with_parameters({name: 1.05 * TRUTH[name][0] for name in ("k_2", "k_3", "k_rod")})
    return identify(list(measured_moved_posture()), start, WANTED)


def worst(result: Result) -> float:
    """The largest error, a part of the number."""
    return max(abs(float(x - np.log(TRUTH[p.name][0]))) for p, x in zip(result.parameters.free, result.x, strict=True))


def test_stiffnesses_are_those_at_rest_whatever_the_motion_adds() -> None:
    """Exact with the motion known, more than 0.1 % off without."""
    assert worst(fitted()) < 1e-5
    unknown = [replace(response, motion=None) for response in measured_moved_posture()]
    assert worst(fit_parameters(unknown, LINKAGE, WANTED)) > 1e-3


def test_the_fitted_model_answers_as_it_was_measured() -> None:
    """Responses of a fitted robot have the motion's effect; those of a record without motion do not."""
    for response, modelled in zip(
        measured_moved_posture(), FittedRobot.of(fitted(), LINKAGE, measured_moved_posture()).responses, strict=True
    ):
        np.testing.assert_allclose(modelled.G, response.G, atol=1e-4 * np.abs(response.G).max())
    (first, *_), still = measured_moved_posture(), replace(measured_moved_posture()[0], motion=None)
    (at_rest,) = FittedRobot.of(fitted(), LINKAGE, [still]).responses
    assert np.abs(at_rest.G - first.G).max() > 1e-3 * np.abs(first.G).max()
