"""The state space of a linear model has its response."""

from dataclasses import replace

import pytest
from plants.fitted_models import SERIAL, close, fitted_model

from elastid.linear.linear_model import state_space
from elastid.linear.response.transfer import frequency_response
from elastid.record import Motion


@pytest.mark.parametrize("name", SERIAL)
@pytest.mark.parametrize("quantity", ["position", "velocity", "acceleration"])
def test_state_space_has_the_response_of_the_linear_model(name: str, quantity: Motion) -> None:
    model = fitted_model(name)
    linear, freq_hz = replace(model.linear[0], quantity=quantity), model.measured[0].freq_hz
    assert close(
        state_space(linear, model.theta).response(freq_hz), frequency_response(linear, model.theta, freq_hz), 1e-9
    )
