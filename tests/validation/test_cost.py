"""The cost of a fit is explained: by noise, a missing mode, outliers or a wrong uncertainty, and where it lies."""

import math
from dataclasses import replace

import numpy as np
import pytest
from plants.report_values import fit_result

from elastid.fit.spec import FitSpec
from elastid.record import Configuration
from elastid.response import Covariance, FrequencyResponse
from elastid.validation.agreement import agreement
from elastid.validation.cost import Excess, explain_cost

FREQ_HZ = np.arange(2.0, 82.0, 0.5)
NO_FLOOR = FitSpec(weights=replace(FitSpec().weights, floor=0.0))


def responses(rng, names=("c1", "c2", "c3"), std=0.05):
    """Flat responses of two motors with white noise of a known level, and the model without it."""
    pairs = []
    for name in names:
        motors, where = ("motor 1", "motor 2"), Configuration(name, np.zeros(2))
        G = np.array([[3.0, 1.0], [1.5, 2.0]]) * np.ones((len(FREQ_HZ), 1, 1)) + 0j
        noise = std * (rng.standard_normal(G.shape) + 1j * rng.standard_normal(G.shape)) / math.sqrt(2)
        covariance = Covariance(np.full(G.shape, std**2), math.inf)
        measured = FrequencyResponse(FREQ_HZ, G + noise, motors, motors, "acceleration", where, total=covariance)
        pairs.append((measured, FrequencyResponse(FREQ_HZ, G, motors, motors, "acceleration", where)))
    return pairs


def words(pairs, expected=1.0):
    """explain_cost of a fit whose cost is that of these residuals, beside what noise would leave times `expected`."""
    measured, modelled = zip(*pairs, strict=True)
    judged = [agreement(m, G) for m, G in pairs]
    power = sum(float(np.sum(np.abs((m.G - G.G) / 0.05) ** 2)) for m, G in pairs)
    n = sum(m.G.size for m, _ in pairs)
    result = replace(fit_result(), cost=power, cost_expected=n * expected, dof=2 * n, cost_dof=2 * n)
    return explain_cost(result, measured, modelled, judged, NO_FLOOR)


def moved(pair, change):
    """The measurement of a pair, changed."""
    measured, modelled = pair
    return replace(measured, G=measured.G + change), modelled


@pytest.mark.parametrize("seed", range(3))
def test_a_cost_as_expected_asks_for_no_reason(seed):
    """Noise alone."""
    assert "no error of the model" in words(responses(np.random.default_rng(seed)))


@pytest.mark.parametrize("seed", range(3))
def test_a_missing_mode_is_found_with_its_place(seed):
    """A resonance at 40 Hz that the model lacks, in one element of one configuration."""
    pairs = responses(np.random.default_rng(seed))
    mode = np.zeros((len(FREQ_HZ), 2, 2), complex)
    mode[:, 0, 1] = 0.02 / (1 - (FREQ_HZ / 40) ** 2 + 0.04j * FREQ_HZ / 40)
    pairs[1] = moved(pairs[1], 3 * mode)
    said = words(pairs)
    assert "the model lacks something" in said
    assert "configuration c2" in said
    assert "motor 2 to motor 1" in said
    low, high = said.split("lies between ")[1].split(" Hz")[0].split(" and ")
    assert float(low) < 40 < float(high)


@pytest.mark.parametrize("seed", range(3))
def test_more_noise_than_measured_is_distinguished_from_a_model_error(seed):
    """White residuals of twice their standard deviation."""
    rng = np.random.default_rng(seed)
    pairs = [moved(p, m[0].G - m[1].G) for p, m in zip(*[responses(rng)] * 2, strict=True)]
    said = words(pairs)
    assert "2 times the noise" in said or "1.99" in said or "2.0" in said
    assert "lines are uncorrelated" in said
    assert "spread over all configurations" in said


def test_a_few_lines_far_off_are_called_outliers():
    """One line of a hundred and sixty, fifty standard deviations away."""
    pairs = responses(np.random.default_rng(0))
    spike = np.zeros((len(FREQ_HZ), 2, 2))
    spike[60] = 2.5
    assert "single lines are far off" in words([moved(p, spike) for p in pairs])


def test_residuals_below_the_noise_are_not_taken_for_a_good_model():
    """Half of the expected cost: the uncertainty is too large."""
    assert "overestimated" in words(responses(np.random.default_rng(0)), expected=2.0)


def test_without_an_uncertainty_the_cost_is_in_units_of_the_floor():
    """There is no noise to compare with."""
    pairs = [(replace(m, total=None), G) for m, G in responses(np.random.default_rng(0))]
    assert "without an uncertainty" in words(pairs)


def test_the_excess_is_counted_once_for_every_line_that_counts():
    """Shares of configurations and elements are of |E|^2 / sigma^2 - 1 where that is positive."""
    pairs = responses(np.random.default_rng(1))
    excess = Excess.of(*zip(*pairs, strict=True), NO_FLOOR)
    assert len(excess.power) == len(excess.freq_hz) == sum(m.G.size for m, _ in pairs)
    assert np.mean(excess.power) == pytest.approx(1, abs=0.1)
    assert excess.largest(excess.configuration) is None
    assert excess.band_hz() is None


def test_shares_are_of_the_excess_and_not_of_the_cost():
    """|E|^2 / sigma^2 beyond 1: all of it in a, between 4 and 6 Hz, where b has as many lines."""
    power = np.array([1.0, 1.0, 1.0, 5.0, 5.0, 5.0, *[1.0] * 14])
    f = np.arange(1.0, 21.0)
    excess = Excess(power, ("a",) * 6 + ("b",) * 14, ("x", "y") * 10, f)
    assert excess.largest(excess.configuration) == ("a", 1.0)
    assert excess.largest(excess.element) is None
    assert excess.band_hz() == (4.0, 5.0)
    assert excess.outlying == pytest.approx(5 / 32)


def test_a_band_of_many_lines_is_not_named():
    """The excess spread over half of the lines."""
    power, f = np.where(np.arange(20) < 10, 3.0, 1.0), np.arange(1.0, 21.0)
    assert Excess(power, ("a",) * 20, ("x",) * 20, f).band_hz() is None
