"""The modal model as state space and transfer function: of the modes, and of the response in the band."""

import importlib.util
from pathlib import Path

import numpy as np
import pytest
from modal.structures import FREQ_HZ, NATURAL, ZETA, modal_response

from elastid.modal.estimate import estimate_modes
from elastid.modal.modes import Modes
from elastid.record import Motion
from elastid.response import Response
from elastid.targets.control import write_responses_control

SHAPES = np.array([[1, 0.8, -0.5, 0.6, 0.3], [0.5, -1, 0.7, 0.2, -0.6], [-0.3, 0.4, 1, -0.7, 0.5]])


def structure(quantity: Motion) -> tuple[Response, Modes]:
    """Three outputs and two inputs from 8 to 75 Hz, a mode of five above the band; and the modes."""
    response = modal_response(FREQ_HZ, NATURAL, ZETA, SHAPES, 2, noise=0.002, quantity=quantity)
    response = response.lines((FREQ_HZ > 8) & (FREQ_HZ < 75))
    return response, estimate_modes(response)


def far(G: np.ndarray, H: np.ndarray) -> float:
    """Largest difference over the largest element."""
    return float(np.abs(G - H).max() / np.abs(H).max())


@pytest.mark.parametrize("quantity", ["acceleration", "position"])
def test_modes_in_real_form_have_the_modal_synthesis(quantity: Motion) -> None:
    """The sum of R / (s - lambda) and its conjugate, to rounding; as state space, and as transfer function."""
    pytest.importorskip("control")
    response, modes = structure(quantity)
    s = 2j * np.pi * response.freq_hz[:, None]
    columns = np.stack([1 / (s - modes.poles), 1 / (s - modes.poles.conj())])
    R = np.einsum("ir,jr->rij", modes.shapes, modes.participation)
    expected = np.einsum("fr,rij->fij", columns[0], R) + np.einsum("fr,rij->fij", columns[1], R.conj())
    system = modes.state_space(residual=False)
    assert system.A.dtype == float
    np.testing.assert_allclose(np.sort_complex(np.linalg.eigvals(system.A))[::2].real, np.sort(modes.poles.real))
    assert far(system.response(response.freq_hz), expected) < 1e-12
    omega = 2 * np.pi * response.freq_hz
    for form in (modes.to_control(residual=False), modes.transfer_function(residual=False)):
        assert far(np.moveaxis(form(1j * omega), 2, 0), expected) < 1e-10
        assert (form.ninputs, form.noutputs) == (2, 3)


@pytest.mark.parametrize("quantity", ["acceleration", "position"])
def test_residual_makes_the_model_that_of_the_band(quantity: Motion) -> None:
    """The mode above the band within 0.3 %; without the residual 0.3 to 22 % are lost. All poles are stable."""
    response, modes = structure(quantity)
    model, alone = (modes.state_space(residual).response(response.freq_hz) for residual in (True, False))
    errors = [np.linalg.norm(G - response.G) / np.linalg.norm(response.G) for G in (model, alone)]
    assert errors[0] < 0.003
    assert errors[1] > errors[0]
    assert modes.state_space_error < 0.002
    assert np.linalg.eigvals(modes.state_space().A).real.max() < 0
    omega = 2 * np.pi * response.freq_hz
    assert far(np.moveaxis(modes.transfer_function()(1j * omega), 2, 0), model) < 1e-9


@pytest.mark.slow
def test_covariance_has_the_stated_deviations_and_is_that_of_draws() -> None:
    """Of frequency and damping of two close modes, which share errors: correlation of 40 draws within 0.35."""
    pair, zeta, shapes = np.array([30.0, 30.6]), np.array([0.01, 0.01]), np.ones((1, 2))
    errors = []
    for seed in range(40):
        modes = estimate_modes(modal_response(FREQ_HZ, pair, zeta, shapes, noise=0.002, seed=seed))
        std = np.sqrt(np.diag(modes.covariance))
        np.testing.assert_allclose(std, np.stack([modes.freq_std, modes.zeta_std], axis=1).ravel(), rtol=1e-12)
        errors.append(np.stack([modes.freq_hz - pair, modes.zeta - zeta], axis=1).ravel() / std)
    correlation = modes.covariance / np.outer(std, std)
    assert np.linalg.eigvalsh(correlation)[0] > -1e-9
    np.testing.assert_allclose(correlation, np.corrcoef(np.array(errors).T), atol=0.35)


def test_exported_loader_has_model_and_covariance(tmp_path: Path) -> None:
    """The system of `to_control`, as state space and transfer function, of a configuration with modes alone."""
    pytest.importorskip("control")
    response, modes = structure("acceleration")
    _, script = write_responses_control(tmp_path, "bench", [response], [modes])
    specification = importlib.util.spec_from_file_location("load_responses", script)
    module = importlib.util.module_from_spec(specification)
    specification.loader.exec_module(module)
    omega = 2 * np.pi * response.freq_hz
    expected = modes.to_control()(1j * omega)
    assert far(module.models()["bench"](1j * omega), expected) < 1e-12
    assert far(module.models(transfer_function=True)["bench"](1j * omega), expected) < 1e-9
    numbers, covariance, error = module.parameters()["bench"]
    np.testing.assert_array_equal(numbers[:, 0], modes.freq_hz)
    np.testing.assert_array_equal(covariance, modes.covariance)
    assert error == modes.state_space_error
