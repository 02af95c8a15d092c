"""Windows and fits of local methods; their coherence, levels and singular values against closed forms."""

from dataclasses import replace

import numpy as np
import pytest
from plants.noise_record import noise_record, truth
from plants.random_plants import N, record_of
from scipy.stats import kstest

from elastid.excitation.multisine import orthogonal_set, synthesise
from elastid.frf.estimate import estimate
from elastid.frf.local.fitted_response import Experiments, fitted_response, with_model_error
from elastid.frf.local.least_squares import WindowTerms, fit_ladder, windows
from elastid.frf.spec import EstimatorSpec
from elastid.response import Quality

SPEC = EstimatorSpec(quantity="velocity", band_hz=(5.0, 95.0))
NOISE = 0.3


def test_coherences_of_two_inputs_are_their_shares() -> None:
    """Independent inputs of one power: |G_ij|^2 / S_yy each, their sum for both; condition near 1."""
    response = estimate([noise_record(8192, 1, noise=NOISE)], replace(SPEC, method="local_rational"))
    quality = response.quality
    shares = np.abs(truth(response.freq_hz)) ** 2
    power = shares.sum(axis=2) + NOISE**2
    np.testing.assert_allclose(quality.multiple_coherence.mean(axis=0), (1 - NOISE**2 / power).mean(axis=0), atol=0.02)
    # Inputs correlate by chance in a window of 20 lines, by 1/20 in power.
    np.testing.assert_allclose(quality.coherence.mean(axis=0), (shares / power[:, :, None]).mean(axis=0), atol=0.07)
    assert np.median(quality.condition) < 2
    np.testing.assert_allclose(quality.singular_values, np.linalg.svd(response.G, compute_uv=False))


def periodic(closed: bool, s: float) -> Quality:
    """y = u + s v in one period, from 6 periods of one multisine each of 6 realisations; closed: u = r - y."""
    rng, lines, records = np.random.default_rng(0), np.arange(10, 400), []
    for m in range(6):
        r = np.tile(synthesise(lines, orthogonal_set(np.ones((len(lines), 1)), rng)[0], N), (6, 1))
        v = s * rng.normal(size=r.shape) * np.sqrt(N) / 2
        y = (r + v) / 2 if closed else r + v
        records.append(replace(record_of(r - y if closed else r, y, m), r=r if closed else None))
    quality = estimate(records, EstimatorSpec(method="local_polynomial"), lines).quality
    assert quality is not None
    return quality


def test_coherence_is_one_in_open_and_closed_loop() -> None:
    """1 / (1 + s^2), behind feedback that halves u 1 / (1 + 4 s^2); noise of the transient adds 25 %, at most 35 %."""
    s = 0.3
    quality = periodic(False, s)
    lost = np.mean(1 - quality.multiple_coherence)
    assert 1 < lost * (1 + s**2) / s**2 < 1.35
    assert np.sqrt(np.mean(quality.excited.amplitude**2)) == pytest.approx(np.sqrt(1 + s**2 / 6), rel=0.01)
    assert 1 < np.mean(quality.output_noise) / s**2 < 1.35
    np.testing.assert_allclose(quality.excited.noise**2, quality.output_noise / 6, rtol=1e-9)
    quality = periodic(True, s)
    lost = np.mean(1 - quality.multiple_coherence)
    assert 1 < lost * (1 + 4 * s**2) / (4 * s**2) < 1.35
    assert 1 < np.mean(quality.input_noise) / (s**2 / 4) < 1.35


def test_richer_local_model_adds_useful_variance() -> None:
    """Ten standard deviations apart, g = 50: (1 + 49 * 2) times; nothing of one with 10^4 times the variance."""
    rng, k = np.random.default_rng(0), np.arange(60)
    R = np.exp(2j * np.pi * rng.random((2, len(k), 1)))
    Z = 3 * R + rng.normal(size=R.shape) + 1j * rng.normal(size=R.shape)
    fit = fit_ladder(Z, R, windows(k, k, 12), [WindowTerms(1, 2, 0, transient=True)]).selected
    experiments, everywhere = Experiments(1, False, np.ones(2), None, 0.0), np.ones(len(k), dtype=np.bool_)
    fitted = fitted_response(fit, experiments, everywhere)
    other = replace(fit, B=fit.B + 10 * np.sqrt(fitted.total.variance))
    vague = replace(other, scatter=1e4 * other.scatter)
    assert fitted.total.right is not None
    for richer, lines, times in ((other, k < 30, 99.0), (vague, everywhere, 1.0), (fit, everywhere, 1.0)):
        total = with_model_error(fitted, [(richer, lines)], experiments, everywhere)
        assert total.right is not None
        ratio = (total.variance / fitted.total.variance)[:, 0, 0]
        np.testing.assert_allclose(ratio[:20], times)
        np.testing.assert_allclose(ratio[40:], 1.0)
        np.testing.assert_allclose((total.right / fitted.total.right)[:, 0, 0], ratio)


def test_local_residual_is_chi_square_with_stated_dof() -> None:
    """2 scatter / variance of each output has 2 dof real ones: Kolmogorov and Smirnov, and its mean to 2 %."""
    rng = np.random.default_rng(1)
    bins, n_u, n_z, E = 3000, 2, 3, 2
    Z = rng.normal(size=(E, bins, n_z)) + 1j * rng.normal(size=(E, bins, n_z))
    R = np.exp(2j * np.pi * rng.random((E, bins, n_u)))
    terms = WindowTerms(n_u, 2, 0, transient=True)
    n_w = terms.width(6, E, n_z)
    # Windows that share no bin.
    lines = np.arange(n_w, bins - n_w, n_w + 1)
    fit = fit_ladder(Z, R, windows(np.arange(bins), lines, n_w), [terms]).selected
    statistic = np.einsum("fzz->fz", fit.scatter).real
    assert fit.dof == terms.degrees_of_freedom(n_w, E, n_z) == E * (n_w - 3) - 6
    assert statistic.mean() / fit.dof == pytest.approx(2, rel=0.02)
    assert kstest(statistic.ravel(), "chi2", args=(2 * fit.dof,)).pvalue > 0.01


def test_poles_that_fit_mere_noise_are_not_taken() -> None:
    """A rational fit of noise would leave 15 % too little residual; that of the ladder is true to 2 %."""
    rng = np.random.default_rng(2)
    bins = 20000
    Z = rng.normal(size=(1, bins, 1)) + 1j * rng.normal(size=(1, bins, 1))
    R = np.zeros((1, bins, 0), dtype=np.complex128)
    ladder = [WindowTerms(0, 2, poles, transient=True) for poles in (0, 2)]
    where = windows(np.arange(bins), np.arange(20, bins - 20, 4), ladder[1].width(6, 1, 1))
    greedy, careful = (fit_ladder(Z, R, where, steps).selected for steps in (ladder[1:], ladder))
    assert np.mean(greedy.scatter.real) / greedy.dof < 2 * 0.9
    assert np.mean(careful.scatter.real) / careful.dof == pytest.approx(2, rel=0.02)
