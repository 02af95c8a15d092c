"""A fitted model: numbers as functions of the fit, doubts, ports, bands, stiffness, modes; an integral as a state."""

from dataclasses import replace

import numpy as np
import pytest
from plants.arm import closed_form, result

from elastid.linear.fitted_model import FittedModel, ModelErrorFactor, UncertainModes

ANGLES = np.array([0.4, -0.9])


def test_principal_compliances_are_eigenvalues_and_their_directions_have_no_shear() -> None:
    """The softest first; a force along one of them deflects along it, in the axes of the base."""
    stiff = result().at(ANGLES, axes="world").stiffness()
    values, directions = stiff.principal
    _, _, K, J = closed_form(ANGLES)
    softest = np.linalg.eigvalsh(J @ np.linalg.solve(K, J.T))[::-1]
    np.testing.assert_allclose(values[:2], softest, rtol=1e-9)
    np.testing.assert_allclose(
        stiff.compliance[:3, :3] @ directions[:, 0], values[0] * directions[:, 0], rtol=1e-9, atol=1e-16
    )
    np.testing.assert_array_equal(stiff.matrix, np.full((6, 6), np.nan))


def test_band_is_centred_and_simultaneous_band_wider() -> None:
    """At 95 and at 68 %; std is between them and zero."""
    model, lines = result().at(ANGLES), np.linspace(2.0, 40.0, 30)
    wide, narrow = model.response_band(lines), model.response_band(lines, 0.68)
    np.testing.assert_array_equal(wide.G, model.response(lines).G)
    assert np.all(wide.simultaneous >= wide.pointwise - 1e-20)
    assert np.all(wide.pointwise >= narrow.pointwise)


def test_the_deviation_of_a_response_is_that_of_its_shifts() -> None:
    """The root of the sum of their squares; a parameter of which nothing is known counts with 100."""
    fit, lines = result(), np.linspace(2.0, 40.0, 5)
    (model,) = fit.linear
    known = fit.covariance * (1 + np.eye(len(fit.x)))
    own = FittedModel.of(model, fit.parameters, fit.x, known)
    G, std, shifts = own.response(lines).G, own.response_std(lines), own.response_shifts(lines)
    assert shifts.shape == (len(fit.x), *G.shape)
    np.testing.assert_allclose(np.sqrt(np.sum(np.abs(shifts) ** 2, axis=0)), std, rtol=1e-9)
    one = np.full_like(known, np.inf)
    one[1:, 1:] = known[1:, 1:]
    step = 1e-6 * (np.arange(len(fit.x)) == 0)
    moved = FittedModel.of(model, fit.parameters, fit.x + step, known).response(lines).G - G
    shifts = FittedModel.of(model, fit.parameters, fit.x, one).response_shifts(lines)
    largest = shifts[np.argmax(np.abs(shifts).max(axis=(1, 2, 3)))]
    np.testing.assert_allclose(np.abs(largest), 100 * np.abs(moved) / 1e-6, rtol=1e-4)


def test_modes_have_shapes_of_largest_entry_one() -> None:
    """Coordinates are those of the robot, motors held at zero."""
    modes = result().at(ANGLES).modes()
    assert modes.shapes.shape == (len(modes.coordinates), len(modes.freq_hz))
    np.testing.assert_allclose(np.abs(modes.shapes).max(axis=0), 1.0)
    motors = [i for i, name in enumerate(modes.coordinates) if name.startswith("motor")]
    np.testing.assert_array_equal(modes.shapes[motors], 0)
    assert len(modes.freq_hz) == 2


def test_std_of_modes_equals_central_differences() -> None:
    fit, h = result(), 1e-5
    covariance = fit.covariance * (1 + np.eye(len(fit.x)))

    def modes(x: np.ndarray) -> UncertainModes:
        return FittedModel.of(fit.linear[0], fit.parameters, x, covariance).modes()

    own, steps = modes(fit.x), h * np.eye(len(fit.x))
    for name, std in (("freq_hz", own.freq_std), ("zeta", own.zeta_std)):
        slopes = [(getattr(modes(fit.x + step), name) - getattr(modes(fit.x - step), name)) / (2 * h) for step in steps]
        np.testing.assert_allclose(std**2, np.diag(np.transpose(slopes) @ covariance @ slopes), rtol=1e-3)


def test_numbers_follow_fit_and_slopes_equal_differences() -> None:
    """Parameters of the fit, and a held mass that a doubt moves by a factor."""
    own = result()
    doubt = ModelErrorFactor(np.array([0.03, -0.02, 0.0, 0.01]), ("m_fore", "c_fore_x"), (0.1, 5e-3), (True, False))
    model = own.at(ANGLES)
    estimated = replace(model.estimated, model_error_factors=(doubt,))
    theta = estimated.theta(estimated.x)
    np.testing.assert_allclose(theta, model.estimated.theta(model.estimated.x), rtol=1e-12)
    assert len(estimated.x) == len(own.x) + 1
    assert estimated.covariance[-1, -1] == 1.0
    for i in range(len(estimated.x)):
        step = 1e-6 * np.eye(len(estimated.x))[i]
        slope = (estimated.theta(estimated.x + step) - estimated.theta(estimated.x - step)) / 2e-6
        np.testing.assert_allclose(estimated.slopes[:, i], slope, rtol=1e-6, atol=1e-6)
    moved = estimated.theta(estimated.x + np.eye(len(estimated.x))[-1])
    place = estimated.names.index("m_fore")
    assert moved[place] == pytest.approx(np.exp(0.1) * theta[place])
