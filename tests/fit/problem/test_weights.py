"""Variances and covariances from few degrees of freedom become weights."""

from dataclasses import replace

import numpy as np
import pytest
from plants.refusals import refused
from plants.three_mass import FREQ as FREQ_SMOOTHED_NOISE
from plants.three_mass import plant
from plants.two_mass import circular
from scipy.special import digamma
from scipy.stats import chi2

from elastid.fit.problem.smoothed_noise import _smooth_power, log_moment, moving_mean, smooth_noise, smooth_variance
from elastid.fit.problem.weights import Whitening, check_factors, weigh
from elastid.fit.spec import FactorSpec, FitSpec, WeightSpec
from elastid.linear.response.transfer import frequency_response
from elastid.record import Configuration
from elastid.response import Covariance, Response

F = 200
FREQ = np.linspace(1.0, 40.0, F)
# A resonance 40 dB high on a flat response.
G = 1.0 / (1 - (FREQ / 20) ** 2 + 0.01j * FREQ / 20)
NO_FLOOR = FitSpec(weights=WeightSpec(model_error=0.0))


def response(variance, outputs=("motor 1",), **known) -> Response:
    G_matrix = np.broadcast_to(G[:, None, None], (F, len(outputs), 1))
    covariance = Covariance(np.broadcast_to(np.reshape(variance, (-1, 1, 1)), G_matrix.shape), np.inf)
    response = Response(
        FREQ, G_matrix, ("motor 1",), outputs, "acceleration", Configuration("c1", [0.0]), noise=covariance
    )
    return replace(response, **known)


@pytest.mark.parametrize("dof", [1.0, 3.0, 10.0])
@pytest.mark.parametrize("true", [np.full(F, 0.1), 0.04 * np.abs(G) ** 2, 0.1 / FREQ**2])
def test_weights_from_few_degrees_of_freedom_are_unbiased_and_steady(dof, true):
    """E[1 / v~] = 1 / v within 6 %, and a weight scatters like one of about 24 degrees of freedom.

    For noise that is flat, that follows the resonance, and that falls with frequency.
    """
    rng = np.random.default_rng(0)
    drawn = true * rng.chisquare(2 * dof, (100, *np.shape(true))) / (2 * dof)  # sample variances
    weights = np.array([true / smooth_variance(variance, G, dof)[0] for variance in drawn])
    inner = weights[:, 20:-20]
    assert abs(inner.mean() - 1) < 0.06
    assert inner.std() < 1.6 / np.sqrt(24)


def test_model_error_adds_to_variance_above_noise():
    """sigma^2 = v + (floor |G|)^2, v that of the periods where two realisations agree by chance."""
    chance = replace(response(0.01), total=Covariance(response(1e-4).noise.variance, 3.0))
    for measured, floor in ((response(0.01), 0.05), (chance, 0.0)):
        weights = weigh(measured, FitSpec(weights=WeightSpec(model_error=floor)))
        np.testing.assert_allclose(weights.sigma[:, 0, 0], np.sqrt(0.01 + (floor * np.abs(G)) ** 2))


def test_element_below_noise_is_discarded_with_note():
    """An axis that does not couple is exactly zero in a model, noise in a measurement; a weak one with a peak stays."""
    rng = np.random.default_rng(5)
    measured = response(1.0, outputs=("motor 1", "joint 1", "joint 2"))
    values = measured.G.copy()
    values[:, 1] = 0.0
    values[:, 2] = (rng.standard_normal((F, 1)) + 1j * rng.standard_normal((F, 1))) / np.sqrt(2)
    weights = weigh(replace(measured, G=values), FitSpec())
    np.testing.assert_array_equal(weights.is_used.all(axis=0)[:, 0], [True, False, False])
    assert np.median(np.abs(G)) < 2  # most lines of the first are below twice their noise
    assert [(note.code, note.place) for note in weights.notes] == [("fit/weights", "configuration c1")]


def test_without_a_variance_the_floor_weighs_and_says_so():
    """One period of one realisation has no variance: a note, or a refusal where the floor is zero too."""
    measured = response(1.0, noise=None)
    weights = weigh(measured, FitSpec())
    np.testing.assert_allclose(weights.sigma[:, 0, 0], 0.01 * np.abs(G))
    assert weights.notes[0].code == "fit/weights"
    with refused("fit/weights", place="configuration c1"):
        weigh(measured, NO_FLOOR)


def test_exact_data_without_a_floor_leave_nothing():
    """Zero variance and no floor would be an infinite weight; such lines are left out with a word."""
    weights = weigh(response(0.0), NO_FLOOR)
    assert not weights.is_used.any()
    assert weights.notes[0].code == "fit/weights"


@pytest.mark.parametrize(
    "mask",
    [FactorSpec(0.0, configurations=("c2",)), FactorSpec(0.0, output="motor1"), FactorSpec(0.0, input="joint 7")],
)
def test_a_mask_of_what_was_not_measured_is_refused(mask):
    """A misspelt name would mask nothing, without a word."""
    with refused("study/invalid", place="fit.weights.factors[0]"):
        check_factors([response(1.0)], FitSpec(weights=WeightSpec(factors=(mask,))))


MODEL = plant((0, 2), (0, 2))
G_SMOOTHED_NOISE = frequency_response(MODEL, MODEL.theta_ref, FREQ_SMOOTHED_NOISE)
LEVEL = np.median(np.abs(G_SMOOTHED_NOISE)) ** 2
# Half on the outputs, half from torques at the inputs; and a disturbance at a place that is no input.
OUTPUTS = LEVEL * np.eye(2) * np.ones((len(FREQ_SMOOTHED_NOISE), 1, 1)) + 0j
FOLLOWING = np.linalg.norm(G_SMOOTHED_NOISE, axis=2)[:, :, None] ** 2 * np.eye(2) + 0j
TORQUE = 0.3 * G_SMOOTHED_NOISE @ G_SMOOTHED_NOISE.conj().transpose(0, 2, 1)


def response_smoothed_noise(rng, C, dof) -> Response:
    """A response with noise C of every column, whose covariance was estimated from so many degrees of freedom."""
    z = np.linalg.cholesky(C) @ circular(rng, (*C.shape[:2], int(dof)))
    right, left = z @ z.conj().transpose(0, 2, 1) / dof, np.broadcast_to(np.eye(2), G_SMOOTHED_NOISE.shape)
    known = Covariance(np.einsum("faa->fa", right).real[:, :, None] * np.ones((1, 1, 2)), dof, left, right)
    noisy = G_SMOOTHED_NOISE + 0.01 * np.linalg.cholesky(C) @ circular(rng, G_SMOOTHED_NOISE.shape)
    return Response(
        FREQ_SMOOTHED_NOISE, noisy, MODEL.inputs, MODEL.outputs, "velocity", MODEL.configuration, noise=known
    )


def loss(found, C):
    """tr(C~^-1 C) - ln det(C~^-1 C) - n, mean over the lines: 0 for the true covariance."""
    values = np.linalg.eigvals(np.linalg.solve(found, C)).real
    return float(np.mean(np.sum(values - np.log(values) - 1, axis=1)))


@pytest.mark.parametrize("C", [OUTPUTS, OUTPUTS + TORQUE, 0.01 * OUTPUTS + TORQUE, FOLLOWING])
@pytest.mark.parametrize("dof", [2, 6])
def test_noise_model_is_estimated_from_two_degrees_of_freedom(C, dof):
    """The loss is that of 60 and more degrees of freedom of each line (n^2 / (2 dof) each), weights are unbiased."""
    rng = np.random.default_rng(0)
    found = [smooth_noise(response_smoothed_noise(rng, C, dof)).smooth.right for _ in range(10)]
    assert np.mean([loss(one, C) for one in found]) < 4 / (2 * 60) + 0.02
    power = np.mean([np.einsum("fab,fba->f", np.linalg.inv(one), C).real.mean() / 2 for one in found])
    assert power == pytest.approx(1.0, abs=0.03)


def scatter(C, weighed):
    """Variances (4,) of k_g, d_g, k_a, d_a under noise C of each input's column, of weights weighed^-1."""
    slopes = [
        frequency_response(MODEL, MODEL.theta_ref * (1 + 1e-6 * row), FREQ_SMOOTHED_NOISE) for row in np.eye(5)[:4]
    ]
    J = (np.moveaxis(slopes, 0, -1) - G_SMOOTHED_NOISE[..., None]) / 1e-6
    J = J.swapaxes(1, 2).reshape(-1, 4, 4)
    WJ = np.linalg.solve(weighed, J)
    true = np.einsum("ab,fcd->facbd", np.eye(2), C).reshape(-1, 4, 4)
    A = np.linalg.inv(np.einsum("fap,faq->pq", J.conj(), WJ).real)
    return np.diag(A @ np.einsum("fap,fab,fbq->pq", WJ.conj(), true, WJ).real @ A)


WHITE_ANGLE = OUTPUTS * (FREQ_SMOOTHED_NOISE / np.median(FREQ_SMOOTHED_NOISE))[:, None, None] ** 2


@pytest.mark.parametrize("C", [WHITE_ANGLE + TORQUE, FOLLOWING, np.sqrt(FOLLOWING)])
def test_estimates_of_two_realisations_reach_1_1_cramer_rao(C):
    """Torque noise through G and white angle noise; errors in proportion to the gain and to its root."""
    rng, bound = np.random.default_rng(5), scatter(C, np.kron(np.ones((2, 2)), C) * np.kron(np.eye(2), np.ones((2, 2))))
    weighed = (smooth_noise(response_smoothed_noise(rng, C, 1)).smooth.full() for _ in range(8))
    assert np.all(np.sqrt(np.mean([scatter(C, one) / bound for one in weighed], axis=0)) < 1.1)


def test_a_line_that_is_really_noisier_keeps_its_own_level():
    """Mains, 100 times as noisy on one line: it counts for little, its neighbours as before."""
    rng, C = np.random.default_rng(2), (OUTPUTS + TORQUE).copy()
    C[80] *= 100
    found = smooth_noise(response_smoothed_noise(rng, C, 4)).smooth.right
    power = np.einsum("fab,fba->f", np.linalg.inv(found), C).real / 2
    assert power[80] < 4
    assert np.all(power[np.r_[76:80, 81:85]] < 2)
    assert np.all(power[np.r_[76:80, 81:85]] > 0.5)


@pytest.mark.parametrize("dof", [3.0, 12.0])
def test_line_counts_as_noisier_beyond_one_chance_in_a_thousand(dof: float) -> None:
    """A single line exceeds the chi-square quantile relative to the bias-corrected geometric mean of its window.

    At the ends of the band, the window of a moving mean stays within the band.
    """
    width, variance = 9, np.ones(60)
    rest = np.exp(log_moment(1, dof, width))
    limit = (chi2.isf(1e-3, 2 * dof) / (2 * dof) / rest) ** (width / (width - 1))
    for ratio, is_loud in ((0.99, False), (1.01, True)):
        variance[30] = ratio * limit
        smooth = _smooth_power(variance, dof, width)
        assert (smooth[30] == variance[30]) == is_loud
        np.testing.assert_allclose(smooth[[0, 10, 59]], np.exp(log_moment(-1, dof, width)))
    assert log_moment(1, dof, 10**6) == pytest.approx(digamma(dof) - np.log(dof), rel=1e-4)
    assert log_moment(-1, dof, 1) == pytest.approx(np.log(dof / (dof - 1)))
    assert log_moment(-1, 1.0, 1) == log_moment(1, np.inf, 3) == 0
    np.testing.assert_allclose(moving_mean(np.arange(6.0), 3), [1, 1, 2, 3, 4, 4])


def test_measured_covariance_is_corrected_for_self_influence():
    """E[tr(C~^-1 S)] as corrected is that of errors that the weights have not seen, with a floor or without."""
    rng, C = np.random.default_rng(3), OUTPUTS + TORQUE
    for floor in (0.0, 0.3):
        seen, unseen = 0.0, 0.0
        for _ in range(30):
            one = response_smoothed_noise(rng, C, 2)
            weights = weigh(one, FitSpec(weights=WeightSpec(model_error=floor)))
            S = weights.noise_covariance()
            power = np.swapaxes(floor * np.abs(one.G), 1, 2).reshape(-1, 4, 1) ** 2
            total = weights.correlated.full() + power * np.eye(4)
            W = np.linalg.inv(total)
            seen += np.einsum("fab,fba->", W, S).real
            truth = np.einsum("ab,fcd->facbd", np.eye(2), C).reshape(-1, 4, 4)
            unseen += np.einsum("fab,fba->", W, truth).real
        assert seen / unseen == pytest.approx(1.0, abs=0.015)


@pytest.mark.parametrize("n", [1, 2])
def test_exact_data_have_a_smooth_covariance_too(n):
    """A variance of zero everywhere is no division by zero."""
    one, zero = response_smoothed_noise(np.random.default_rng(4), OUTPUTS, 2), np.zeros((len(OUTPUTS), n, n))
    known = Covariance(zero, 2, one.noise.left[:, :n, :n], zero + 0j)
    exact = replace(one, G=one.G[:, :n, :n], outputs=one.outputs[:n], inputs=one.inputs[:n], noise=known)
    variance = smooth_noise(exact).variance
    assert np.all((variance > 0) & np.isfinite(variance))


def test_smooth_noise_of_other_values_is_computed_again():
    """The covariance caches the result for one response, whose values the model of the noise uses."""
    one = response_smoothed_noise(np.random.default_rng(5), FOLLOWING, 2)
    first, other = smooth_noise(one), smooth_noise(replace(one, G=one.G[::-1]))
    assert smooth_noise(replace(one, ratio_std=[0.1, 0.1])).smooth.right.tobytes() == first.smooth.right.tobytes()
    assert not np.allclose(other.variance, first.variance, rtol=1e-3)


def test_factored_whitening_equals_whole_covariance():
    """Factored and full whitening agree; noise of unused lines has no effect."""
    one = response_smoothed_noise(np.random.default_rng(6), OUTPUTS + TORQUE, 6)
    smooth, sigma, used = smooth_noise(one).smooth, np.ones(one.G.shape), FREQ_SMOOTHED_NOISE > 10
    sigma[~used] = np.inf
    split = Whitening(replace(smooth, right=smooth.right * used[:, None, None]), 0.0, one.G, sigma).matrix
    whole = Whitening(replace(smooth, left=None, right=None, matrix=smooth.full()), 0.0, one.G, sigma).matrix
    np.testing.assert_allclose(split, whole, rtol=1e-9, atol=1e-9 * np.abs(whole).max())
