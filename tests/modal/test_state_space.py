"""State-space models of responses equal the systems that these are of."""

import control
import numpy as np
import pytest

from elastid.base.errors import DataError
from elastid.modal.state_space import fit_state_space
from elastid.record import Configuration
from elastid.response import FrequencyResponse

BENCH = Configuration("bench", np.zeros(0))
FREQ_HZ = np.geomspace(0.01, 10, 300)
# One real pole and two pairs.
DAMPED = np.diag([-0.3, -0.3, -1.0, -0.2, -0.2])
DAMPED[[0, 1, 3, 4], [1, 0, 4, 3]] = 4.0, -4.0, 20.0, -20.0


def response_of(system: control.StateSpace, noise: float = 0.0) -> FrequencyResponse:
    G = np.moveaxis(control.frequency_response(system, 2 * np.pi * FREQ_HZ, squeeze=False).frdata, 2, 0)
    rng, std = np.random.default_rng(0), noise * np.sqrt(np.mean(np.abs(G) ** 2))
    G = G + std * (rng.normal(size=G.shape) + 1j * rng.normal(size=G.shape)) / np.sqrt(2)
    names = tuple(f"u{j}" for j in range(G.shape[2])), tuple(f"y{i}" for i in range(G.shape[1]))
    return FrequencyResponse(FREQ_HZ, G, *names, "position", BENCH)


@pytest.mark.parametrize(("n_y", "n_u"), [(1, 1), (3, 1), (1, 2), (3, 2)])
@pytest.mark.parametrize("noise", [0.0, 0.01])
def test_order_and_poles_are_those_of_the_system(n_y: int, n_u: int, noise: float) -> None:
    """One real pole and two pairs: to rounding without noise, and to 2 % with noise of 1 %."""
    rng = np.random.default_rng(3)
    B, C = rng.normal(size=(5, n_u)) + 2, rng.normal(size=(n_y, 5)) + 2
    system = control.ss(DAMPED, B, C, np.zeros((n_y, n_u)))
    model = fit_state_space(response_of(system, noise))
    assert len(model.A) == 5
    true = system.poles()
    near = np.array([model.poles[np.argmin(np.abs(model.poles - pole))] for pole in true])
    assert np.max(np.abs(near - true) / np.abs(true)) < (0.04 if noise else 1e-8)
    same = control.frequency_response(model.to_control(), 2 * np.pi * FREQ_HZ, squeeze=False).frdata
    np.testing.assert_allclose(model.response(FREQ_HZ), np.moveaxis(same, 2, 0), atol=1e-9)


def test_the_model_of_an_unstable_response_is_stable() -> None:
    system = control.ss([[0.2, 3.0], [-3.0, 0.2]], [[1.0], [0.5]], [[1.0, 0.0]], [[0.0]])
    assert np.all(fit_state_space(response_of(system)).poles.real < 0)


def test_few_lines_and_high_orders_are_refused() -> None:
    response = response_of(control.ss([[-1.0]], [[1.0]], [[1.0]], [[0.0]]))
    with pytest.raises(DataError, match="too few"):
        fit_state_space(response, band_hz=(0.01, 0.012))
    with pytest.raises(ValueError, match="orders of 1 to"):
        fit_state_space(response, order=99)
