"""The tests of residuals raise as many false alarms on noise as they say."""

import math

import numpy as np
import pytest
from plants.marks import slow
from plants.two_mass import circular

from elastid.fit.problem.smoothed_noise import smooth_noise
from elastid.frf.estimators import kronecker
from elastid.record import Configuration
from elastid.response import Response
from elastid.validation.residual_tests import (
    FALSE_ALARM,
    exceeds_by_chance,
    fisher_p_value,
    power_over_noise,
    white_by_chance,
    whitening,
    without_shifts,
)


@pytest.mark.parametrize("scatter", [slow(0.0), 0.7])
def test_white_residuals_have_stated_false_alarm_rate(scatter):
    """100 draws, of a level that is known or scatters from line to line: 5 % below 0.05, 1 % below 0.01."""
    rng = np.random.default_rng(0)
    p = np.array(
        [white_by_chance(np.exp(scatter * rng.standard_normal((60, 1))) * circular(rng, (60, 4))) for _ in range(100)]
    )
    assert np.mean(p < 0.05) == pytest.approx(0.05, abs=0.05)
    assert np.mean(p < FALSE_ALARM) < 0.04
    assert np.mean([fisher_p_value(some) < 0.05 for some in p.reshape(20, 5)]) < 0.21


def test_the_tail_is_that_of_random_phases():
    """Seven elements of one error beside five of their own, 60 lines: of 10000 draws 5 and 1 % have such p or less."""
    rng, p = np.random.default_rng(4), []
    for _ in range(4):
        z = np.concatenate([np.repeat(circular(rng, (60, 1)), 7, axis=1), circular(rng, (60, 5))], axis=1)
        turns = np.exp(2j * np.pi * rng.random((10000, 60, 1)))
        T = np.zeros(10000)
        for lag in (1, 2, 3):
            product = z[:-lag].conj() * z[lag:]
            turned = (turns[:, :-lag, 0].conj() * turns[:, lag:, 0]) @ product
            T += np.sum(np.abs(turned) ** 2 / np.sum(np.abs(product) ** 2, axis=0), axis=1)
        p.append([white_by_chance(turns[i] * z) for i in np.argsort(T)[[-500, -100]]])
    assert np.mean(p, axis=0) == pytest.approx([0.05, 0.01], rel=0.2)


def test_errors_of_parameters_within_their_uncertainty_are_no_residual():
    """z = B c + noise with c as uncertain as stated: the distance is that of noise, in 200 draws 100 +- 1 complex."""
    rng = np.random.default_rng(3)
    shifts = 3 * circular(rng, (3, 50, 2))
    found = []
    for _ in range(200):
        z = np.tensordot(rng.standard_normal(3), shifts, axes=1) + circular(rng, (50, 2))
        left, beside = without_shifts(z, shifts)
        found.append(np.sum(np.abs(left) ** 2) + beside)
        B = np.concatenate([shifts.real, shifts.imag], axis=1).reshape(3, -1)
        y = np.concatenate([z.real, z.imag]).ravel()
        exact = y @ np.linalg.solve(np.eye(200) / 2 + B.T @ B, y) / 2
        assert found[-1] == pytest.approx(exact)
    assert np.mean(found) == pytest.approx(100, abs=2.5)


def test_nothing_is_tested_where_nothing_is_known():
    """Too few lines, no noise, and no p at all."""
    assert math.isnan(exceeds_by_chance(2.0, 0.0))
    assert math.isnan(white_by_chance(np.zeros((3, 2), complex)))
    assert math.isnan(fisher_p_value([math.nan]))


@pytest.mark.slow
@pytest.mark.parametrize(("n_y", "n_u", "dof"), [(2, 2, 1), slow(3, 2, 4), slow(6, 6, 3)])
def test_covariance_power_test_has_stated_false_alarm_rate(n_y, n_u, dof):
    """200 draws of errors and their scatter, of noise on each output that grows with the fourth power of frequency."""
    rng, freq_hz = np.random.default_rng(0), np.linspace(1.0, 40.0, 40)
    std = (freq_hz / 40)[:, None, None] ** 2
    mixed = np.eye(n_y) + 0.5 * rng.standard_normal((n_y, n_y))
    names = tuple(f"motor {i + 1}" for i in range(n_y))
    p, ratios = [], []
    for _ in range(200):
        E, D = (std * (mixed @ circular(rng, (40, n_y, n))) for n in (n_u, dof))
        total = kronecker(np.eye(n_u) * np.ones((40, 1, 1)) + 0j, D @ D.conj().swapaxes(1, 2) / dof, dof)
        where = Configuration("c", np.zeros(n_u))
        noise = smooth_noise(Response(freq_hz, 9 + E, names[:n_u], names, "acceleration", where, total=total))
        whiten = whitening(noise)
        z = (whiten @ E.swapaxes(1, 2).reshape(40, -1, 1))[:, :, 0]
        ratios.append(power_over_noise(z, whiten, noise))
        p.append(exceeds_by_chance(*ratios[-1]))
    assert np.mean(ratios, axis=0)[0] == pytest.approx(1, abs=0.05)
    assert np.mean(np.array(p) < 0.05) < 0.1
