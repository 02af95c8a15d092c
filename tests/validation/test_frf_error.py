"""Validation reports the truth about constructed pairs of responses."""

import math
import re
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from plants.two_mass import BENCH, FREQ_HZ, circular, response, two_inertias

from elastid.record import Configuration
from elastid.validation.frf_error import agreement, are_white, noise_p, validate
from elastid.validation.residual_tests import above_2sigma

FLAT = np.full((240, 1, 1), 10.0 + 0j)


@given(shift_deg=st.floats(-170, 170), gain_db=st.floats(-20, 20), seed=st.integers(0, 99))
@settings(deadline=None, max_examples=30)
def test_gain_and_phase_errors_are_separate(shift_deg, gain_db, seed):
    """A factor 10^(g/20) exp(j phi) on the model is |g| dB and |phi| degrees rms, also across the wrap at 180."""
    rng, shape = np.random.default_rng(seed), (50, 2, 2)
    G = 10 ** rng.uniform(-0.5, 1.5, shape) * np.exp(2j * np.pi * rng.random(shape))
    f = np.arange(1.0, 51.0)
    factor = 10 ** (gain_db / 20) * np.exp(1j * np.radians(shift_deg))
    judged = agreement(response(G, freq_hz=f), response(G * factor, freq_hz=f))
    assert judged.overall_rms_log_db == pytest.approx(abs(gain_db), abs=1e-9)
    assert judged.overall_phase_rms_deg == pytest.approx(abs(shift_deg), abs=1e-9)
    assert np.isnan(judged.rms_sigma).all()  # without a covariance


def test_lines_below_two_sigma_do_not_count():
    """A model that is absurd exactly where |Ghat| < 2 sigma has no error elsewhere."""
    G = FLAT.copy()
    G[:60] = 1.0
    model = G.copy()
    model[:60] = 100j
    measured = response(G, std=1.0)
    assert above_2sigma(measured).sum() == 180
    judged = agreement(measured, response(model))
    assert judged.lines[0, 0] == 180
    assert judged.rms_log_db[0, 0] == 0
    assert judged.phase_rms_deg[0, 0] == 0


def test_systematic_errors_of_known_size_are_no_misfit():
    """Of 3 sigma at every line, times a factor of unit variance: by chance with its size known, by none without."""
    rng, G = np.random.default_rng(3), FLAT
    error = 0.3 * np.exp(2j * np.pi * np.arange(240) / 60)[:, None, None]
    measured = response(G + 1.5 * error + 0.1 * circular(rng, G.shape), std=0.1)
    bias = np.stack([error, np.zeros_like(error)])[:, None]
    known, unknown = (agreement(one, response(G)) for one in (replace(measured, bias=bias), measured))
    assert noise_p([known]) > 0.05
    assert are_white([known])
    assert noise_p([unknown]) < 1e-6
    assert not are_white([unknown])


def test_elements_and_matrix_have_one_ratio_of_residuals_to_noise():
    """A variance of few realisations, smoothed over lines: both ratios are 1 of a correct model, and the same."""
    rng, dof, G = np.random.default_rng(4), 3, FLAT
    std = 0.1 * np.sqrt(rng.chisquare(2 * dof, G.shape) / (2 * dof))
    judged = agreement(response(G + 0.1 * circular(rng, G.shape), std, dof), response(G))
    assert judged.rms_sigma == pytest.approx(math.sqrt(judged.power_ratio), rel=1e-9)
    assert judged.rms_sigma == pytest.approx(1.0, abs=0.1)


def test_an_element_that_the_model_decouples_has_a_finite_error():
    """A modelled zero counts as sigma: 20 dB for a measurement ten sigma high."""
    judged = agreement(response(np.full((240, 1, 1), 1.0 + 0j), std=0.1), response(np.zeros((240, 1, 1))))
    assert judged.overall_rms_log_db == pytest.approx(20.0)


@pytest.mark.parametrize(("gain", "is_passed"), [(1.03, True), (1.06, False)])
def test_fitted_others_make_configuration_a_validation(gain, is_passed):
    """Its name is in the verdict then alone; half as much again as the error of the others, 2 %, is allowed."""
    G = two_inertias(*BENCH, 0.002)
    both = response(1.02 * G), replace(response(gain * G), configuration=Configuration("c2", np.zeros(1)))
    none, one = (validate(both, [response(G)] * 2, names) for names in ((), ("c2",)))
    assert [a.is_validation for a in (*none.configurations, *one.configurations)] == [False, False, False, True]
    assert ("c2" in none.verdict, "c2" in one.verdict) == (False, True)
    assert one.verdict.startswith("Validation passed") == is_passed


@pytest.mark.parametrize(("sigmas", "is_passed"), [(0.5, True), (1.0, True), (2.0, False)])
def test_validation_compares_white_residuals_with_the_noise(sigmas, is_passed):
    """Twice the noise is white and fails."""
    G = two_inertias(*BENCH, 0.05)
    std = 0.02 * np.abs(G)
    measured = response(G + sigmas * std * circular(np.random.default_rng(9), G.shape), std)
    verdict = validate([measured], [response(G)], ["c1"]).verdict
    assert verdict.startswith("Validation passed") == is_passed
    assert ("overestimated" in verdict) == (sigmas < 1)
    assert float(re.findall(r"(\d[.\d]*) times", verdict)[0]) == pytest.approx(sigmas, rel=0.05)


def test_a_missing_mode_is_beyond_the_noise_and_correlated():
    """A resonance that the model lacks, in one element of two, each known to a twentieth."""
    std, G = 0.05, np.ones((240, 1, 2), complex)
    mode = 0.06 / (1 - (FREQ_HZ / 40) ** 2 + 0.04j * FREQ_HZ / 40)
    noisy = G + std * circular(np.random.default_rng(0), G.shape)
    right, wrong = (
        agreement(response(noisy + change, std), response(G)) for change in (0, np.stack([0 * mode, mode], -1)[:, None])
    )
    assert noise_p([right]) > 0.05
    assert are_white([right])
    assert noise_p([wrong]) < 1e-3
    assert not are_white([wrong])
