"""Closed forms of the MAC and of variances, and what a fit of poles states against the fits beside it."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings, strategies
from modal.structures import FREQ_HZ, NATURAL, ZETA, modal_response
from plants.two_mass import circular

from elastid.modal.estimate import modal_data
from elastid.modal.line_variance import by_differences, line_variance, smooth_variance
from elastid.modal.model import ModalFit
from elastid.modal.modes import mac
from elastid.modal.pole_selection import LIMITS, noise_variances, reductions, separate_reductions
from elastid.record import MOTION_ORDER
from elastid.response import Covariance

KINDS = strategies.sampled_from(["position", "velocity", "acceleration"])


def test_mac_ignores_factors_and_sees_angles() -> None:
    """The MAC of real shapes at an angle of 30 degrees is its cosine squared."""
    first = np.array([[1.0], [0.0]])
    second = np.array([[np.sqrt(3) / 2], [0.5]]) * (2 - 3j)
    np.testing.assert_allclose(mac(first, second), 0.75)


@settings(deadline=None, max_examples=15)
@given(strategies.integers(0, 2**32 - 1), strategies.integers(1, 4), strategies.integers(1, 3), KINDS)
def test_what_a_fit_states_is_what_fits_beside_it_have(seed: int, n: int, n_y: int, quantity: str) -> None:
    """Residues and levels of exact data, squares with one pole more or less."""
    rng = np.random.default_rng(seed)
    natural = np.arange(20.0, 20.0 + 25 * n, 25) + rng.uniform(0, 8, n)
    zeta, shapes = rng.uniform(0.01, 0.03, n), rng.normal(size=(n_y, n))
    response = modal_response(FREQ_HZ[::4], natural, zeta, shapes, quantity=quantity)
    data = modal_data(response, rng.uniform(0.5, 2.0, response.G.shape))
    poles = natural * (1j * np.sqrt(1 - zeta**2) - zeta) * 2 * np.pi
    exact = ModalFit(data, poles / data.basis.scale)
    order = MOTION_ORDER[quantity]
    expected = poles**order / (2j * poles.imag) * shapes[0] * shapes
    np.testing.assert_allclose(
        exact.residues.T * data.basis.scale, expected, rtol=1e-6, atol=1e-8 * abs(expected).max()
    )
    level, lines = noise_variances(exact)
    assert np.all((level >= data.variance.min(axis=0)) & (level <= data.variance.max(axis=0)))
    about = 2 * np.maximum(LIMITS.lines, LIMITS.half_widths * zeta * natural / 0.5)
    assert np.all((lines <= about + 1) & (lines >= 2 * LIMITS.lines - n - 2.5))
    np.testing.assert_allclose(exact.synthesis(), response.G[:, :, 0], atol=1e-8 * np.abs(response.G).max())
    fit = ModalFit(data, exact.poles * (1 + 0.02 * rng.normal(size=n)))
    squares = np.sum(fit.residual**2, axis=0)
    without = [np.sum(fit.without(r).residual ** 2, axis=0) for r in range(n)]
    np.testing.assert_allclose(separate_reductions(fit)[0], without - squares, rtol=1e-5, atol=1e-7 * squares.max())
    more = fit.poles[:1] * (1.1, 1.3)
    beside = [np.sum(ModalFit(data, np.append(fit.poles, pole)).residual ** 2, axis=0) for pole in more]
    np.testing.assert_allclose(reductions(fit, more), squares - beside, rtol=1e-5, atol=1e-7 * squares.max())


@settings(deadline=None, max_examples=10)
@given(strategies.integers(0, 2**32 - 1))
def test_variances_are_those_of_neighbours_or_of_outputs_and_inputs(seed: int) -> None:
    """White noise on a cubic along uneven lines, as it scatters; a + b |G|^2 of a few degrees of freedom, as stated."""
    rng = np.random.default_rng(seed)
    freq_hz, std = np.cumsum(rng.uniform(0.5, 1.5, 4000)), np.array([[1e-3, 5.0]])
    noise = std * circular(rng, (4000, 1, 2))
    G = 100 * std * np.polyval(rng.normal(size=4), freq_hz / 4000)[:, None, None] + noise
    assert np.median(by_differences(freq_hz, G), axis=0) == pytest.approx(std**2, rel=0.15)
    power = np.exp(rng.normal(size=(400, 2, 1)))
    variance = rng.uniform(1, 3, (2, 1)) + rng.uniform(0, 2, (2, 1)) * power
    np.testing.assert_allclose(smooth_variance(variance, power), variance, rtol=1e-6)
    response = modal_response(FREQ_HZ, NATURAL, ZETA, rng.normal(size=(2, 5)))
    stated = rng.uniform(1, 2, response.G.shape)
    np.testing.assert_array_equal(line_variance(replace(response, noise=Covariance(stated, np.inf))), stated)
