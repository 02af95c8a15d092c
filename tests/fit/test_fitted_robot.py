"""FittedRobot: the numbers of each configuration, its linear model and response, and equations with fitted geometry."""

import numpy as np
import pytest
from plants.elastic_arm import arm, measure, started_elsewhere

from elastid.fit.fitted_robot import FittedRobot
from elastid.fit.identify import identify
from elastid.fit.result import Result
from elastid.fit.spec import FitSpec
from elastid.linear.modes import modes
from elastid.linear.response.transfer import frequency_response
from elastid.response import Response


@pytest.fixture(scope="module")
def measured() -> tuple[Response, ...]:
    return tuple(measure(arm(), rng=np.random.default_rng(4)))


@pytest.fixture(scope="module")
def result(measured) -> Result:
    return identify(measured, started_elsewhere(arm(), 1.3), FitSpec(starts=1))


def test_each_configuration_has_its_linear_model_and_response(measured, result) -> None:
    fitted = FittedRobot.of(result, arm(), measured)
    for G, model in zip(measured, fitted.responses, strict=True):
        name = G.configuration.name
        linear = fitted.at(name).linear
        assert (linear.configuration.name, linear.inputs, linear.outputs) == (name, G.inputs, G.outputs)
        np.testing.assert_array_equal(fitted.theta_of(name), result.parameters.expand(result.x, name))
        np.testing.assert_array_equal(
            model.G, frequency_response(linear, result.parameters.expand(result.x, name), G.freq_hz)
        )
    with pytest.raises(KeyError, match="nowhere"):
        fitted.at("nowhere")


def test_the_result_has_the_model_of_each_configuration(measured, result) -> None:
    """Response, deviation and modes of the linearised robot, on lines of one's own; no robot is asked for."""
    fitted = FittedRobot.of(result, arm(), measured)
    for G, linear, modelled, std in zip(measured, fitted.linear, fitted.responses, fitted.response_std, strict=True):
        model = result.model(G.configuration.name)
        np.testing.assert_allclose(model.response(G.freq_hz).G, modelled.G, rtol=1e-6)
        np.testing.assert_allclose(model.response_std(G.freq_hz), std, rtol=1e-4)
        np.testing.assert_allclose(model.modes().freq_hz, modes(linear, fitted.theta).freq_hz, rtol=1e-7)
        np.testing.assert_allclose(model.state_space().response(np.array([7.0])), model.response(7.0).G, rtol=1e-9)
    with pytest.raises(KeyError, match=f"configuration nowhere; there are {measured[0].configuration.name}"):
        result.model("nowhere")


def test_an_interval_of_what_was_not_identified_names_what_was(result) -> None:
    """A number that is held, and a name that does not exist."""
    held = next(p.name for p in result.parameters if not p.free)
    with pytest.raises(KeyError, match=f"{held} is held or tied"):
        result.interval(held)
    with pytest.raises(KeyError, match=r"k_99 .*k_1"):
        result.interval("k_99")
