"""Nonlinear levels at lines that were not excited, and the total variance that they give: against theory."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from plants.random_plants import ALL_PERIODS, ODD, RATE, N, nonlinear, record_of

from elastid.excitation.multisine import orthogonal_set, synthesise
from elastid.frf.estimate import estimate


def rms(levels: np.ndarray) -> float:
    return float(np.sqrt(np.mean(levels**2)))


def test_a_square_falls_on_even_lines_and_nowhere_else() -> None:
    """y = u + 0.1 u^2, odd lines: the even level is that of its spectrum, exactly; G is 1 and has no distortion."""
    records = nonlinear(lambda u: u + 0.1 * u**2, ODD, 2)
    response = estimate(records, ALL_PERIODS, ODD)
    quality = response.quality
    assert quality is not None
    assert quality.odd is None
    assert quality.even is not None
    np.testing.assert_allclose(quality.even.freq_hz, np.arange(22, 300, 2) * RATE / N)
    spectra = [np.fft.rfft(0.1 * r.u[:N, 0] ** 2)[22:300:2] * 2 / N for r in records]
    np.testing.assert_allclose(quality.even.amplitude[:, 0], np.sqrt(np.mean(np.abs(spectra) ** 2, axis=0)), rtol=1e-9)
    np.testing.assert_allclose(response.G, 1, atol=1e-12)
    assert quality.stochastic is not None
    assert quality.stochastic.max() < 1e-12


def test_a_cube_falls_on_odd_lines_that_were_left_out() -> None:
    """y = u + 0.05 u^3 on an odd-random grid: nothing even; the odd level is that of the excited lines' scatter."""
    rng = np.random.default_rng(3)
    lines = np.delete(ODD, [4 * i + rng.integers(4) for i in range(1, len(ODD) // 4 - 1)])
    response = estimate(nonlinear(lambda u: u + 0.05 * u**3, lines, 30), ALL_PERIODS, lines)
    quality = response.quality
    assert quality is not None
    assert quality.even is not None
    assert quality.odd is not None
    assert quality.stochastic is not None
    assert quality.even.amplitude.max() < 1e-12
    assert rms(quality.odd.amplitude) == pytest.approx(rms(quality.stochastic), rel=0.1)
    # The best linear approximation of a cube is that of a Gaussian signal, 3 sigma^2, to 1 / F.
    assert response.G.mean() == pytest.approx(1 + 0.15, rel=0.01)


def test_levels_are_corrected_for_what_the_feedback_makes_of_them() -> None:
    """u = r - C y: y at an even line holds the loop's share of the distortion v, Y - G U is v itself."""
    rng, C = np.random.default_rng(0), 3.0
    R = orthogonal_set(np.full((len(ODD), 1), 0.1), rng)[0]
    r, v = synthesise(ODD, R, N), np.zeros((N, 1))
    v += synthesise(np.arange(22, 300, 2), np.full((139, 1), 0.01), N)
    y = (0.5 * r + v) / (1 + 0.5 * C)
    response = estimate([record_of(*(np.tile(x, (2, 1)) for x in (r - C * y, y)))], ALL_PERIODS, ODD)
    assert response.quality is not None
    assert response.quality.even is not None
    np.testing.assert_allclose(response.quality.even.amplitude, 0.01, rtol=1e-9)


def test_one_realisation_of_an_odd_random_grid_shows_its_total_variance() -> None:
    """The fast method: the predicted variance of one realisation is the scatter of many, within 15 %."""
    rng = np.random.default_rng(3)
    lines = np.delete(ODD, [4 * i + rng.integers(4) for i in range(1, len(ODD) // 4 - 1)])
    records = nonlinear(lambda u: u + 0.05 * u**3, lines, 30, noise=0.02)
    single = [estimate([replace(record, realisation=0)], ALL_PERIODS, lines) for record in records]
    G = np.array([each.G for each in single])
    scatter = np.sum(np.abs(G - G.mean(axis=0)) ** 2, axis=0) / 29
    totals = [each.total for each in single]
    assert all(total is not None for total in totals)
    predicted = np.mean([total.variance for total in totals if total is not None], axis=0)
    assert np.mean(predicted) == pytest.approx(np.mean(scatter), rel=0.15)
    noise = np.mean([each.noise.variance for each in single if each.noise is not None])
    assert noise < 0.5 * np.mean(scatter)


def test_noise_of_the_input_is_told_at_the_resonance_itself() -> None:
    """It is |G| times as large there, which the lines left out beside it cannot know: within 30 % of the scatter."""
    rng = np.random.default_rng(3)
    lines = np.delete(ODD, [4 * i + rng.integers(4) for i in range(1, len(ODD) // 4 - 1)])
    peak = lines[len(lines) // 2]
    resonance = 1 / (1 - (lines / peak) ** 2 + 0.01j * lines / peak)
    single = []
    for _ in range(40):
        R = orthogonal_set(np.full((len(lines), 1), np.sqrt(2 / len(lines))), rng)[0]
        u, y = (np.tile(synthesise(lines, each, N), (3, 1)) for each in (R, resonance[:, None] * R))
        record = record_of(u + 0.1 * rng.normal(size=u.shape), y)
        single.append(estimate([record], ALL_PERIODS, lines))
    at_peak = len(lines) // 2
    scatter = np.var([each.G[at_peak, 0, 0] for each in single])
    predicted = np.mean([each.total.variance[at_peak, 0, 0] for each in single if each.total is not None])
    assert predicted == pytest.approx(scatter, rel=0.3)
