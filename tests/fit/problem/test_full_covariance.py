"""Weights beyond one variance for each element: full covariance, factors of the study, normalisation, robust losses."""

from dataclasses import replace

import numpy as np
import pytest
from plants.three_mass import FREQ, NO_FLOOR, fit_of, measured, noise_of, parameters, plant
from plants.two_mass import circular

from elastid.fit.covariance import estimate_uncertainty
from elastid.fit.frf_problem import robust_factors
from elastid.fit.problem.frf_residuals import elastic_fit
from elastid.fit.problem.weights import weigh
from elastid.fit.solve.solvers import solve
from elastid.fit.spec import FactorSpec, FitSpec, WeightSpec
from elastid.linear.response.transfer import frequency_response
from elastid.response import Covariance, Response

FULL = FitSpec(weights=WeightSpec(model_error=0.0, covariance="auto"))
DIAGONAL = FitSpec(weights=WeightSpec(model_error=0.0, covariance="diagonal"))
UNEQUAL = FitSpec(weights=replace(DIAGONAL.weights, factors=(FactorSpec(30.0, band_hz=(2.0, 6.0)),)))
OUTPUTS, INPUTS = (0, 1, 2), (0, 2)


def correlated(rng: np.random.Generator, form: str = "full") -> Response:
    """A disturbing torque at the gear moves all outputs at once, beside a tenth of it in each of them alone."""
    model = plant(OUTPUTS, INPUTS)
    exact = measured(model, np.array([1.0]))
    column = frequency_response(plant(OUTPUTS, (1,)), model.theta_ref, FREQ)
    column = 0.05 * np.median(np.abs(exact.G)) / np.median(np.abs(column)) * column
    right = column @ column.conj().transpose(0, 2, 1)
    right = right + 0.01 * np.einsum("faa,ab->fab", right, np.eye(3)) / 3
    left = np.array([[1.0, 0.4j], [-0.4j, 1.0]]) * np.ones((len(FREQ), 1, 1))
    noise = np.linalg.cholesky(np.einsum("fab,fcd->facbd", left, right).reshape(len(FREQ), 6, 6))
    e = (noise @ circular(rng, (len(FREQ), 6, 1))).reshape(len(FREQ), 2, 3).transpose(0, 2, 1)
    variance = np.einsum("faa->fa", right).real[:, :, None] * np.ones((1, 1, 2))
    known = Covariance(variance, np.inf, left, right)
    if form == "full":
        known = Covariance(variance, np.inf, matrix=known.full())
    return replace(exact, G=exact.G + e, noise=known)


@pytest.mark.parametrize("form", ["full", "kronecker"])
def test_the_cost_is_the_mahalanobis_distance(form):
    """V = 2 e^H C^-1 e of a line, column-major as the covariance is."""
    response = correlated(np.random.default_rng(0), form)
    model = plant(OUTPUTS, INPUTS)
    fit = fit_of(response, model, FULL)
    x = parameters().x
    G = frequency_response(model, model.theta_ref, FREQ)
    used = fit.frfs[0].gain > 0
    e = np.where(used, response.G - G, 0.0)
    V = 0.0
    for k in range(len(FREQ)):
        keep = used[k].T.ravel()
        part = e[k].T.ravel()[keep]
        V += 2 * (part.conj() @ np.linalg.solve(response.noise.full()[k][np.ix_(keep, keep)], part)).real
    assert fit.evaluate(x).cost == pytest.approx(V, rel=1e-9)


@pytest.mark.slow
def test_full_weights_attain_cramer_rao_bound():
    """60 responses, two inputs and three outputs that a torque at the gear moves alike.

    With the inverse covariance the scatter is that of the bound, which the covariance states; element by element, and
    with a band that counts thirty times, it is larger, and the sandwich says so.
    """
    rng, model = np.random.default_rng(1), plant(OUTPUTS, INPUTS)
    scatter, claims = {}, {}
    for name, spec in (("full", FULL), ("diagonal", DIAGONAL), ("unequal", UNEQUAL)):
        errors, stated = [], []
        for _ in range(60):
            response = correlated(rng)
            weights = weigh(response, spec)
            fit = elastic_fit([response], [model], [weights], parameters(), "complex")
            end = solve(fit.problem, parameters().x)
            sure = estimate_uncertainty(fit, [response], [weights], end.x)
            errors.append(end.x - parameters().x)
            stated.append(np.sqrt(np.diag(sure.covariance)))
            if name != "unequal":
                assert sure.expected_cost == pytest.approx(fit.problem.dof, rel=1e-6 if name == "full" else 0.05)
        scatter[name], claims[name] = np.std(errors, axis=0), np.median(stated, axis=0)
        np.testing.assert_allclose(scatter[name], claims[name], rtol=0.35)
    assert np.all(scatter["full"] < 1.1 * scatter["diagonal"])
    assert np.min(scatter["full"] / scatter["diagonal"]) < 0.6


def test_a_singular_covariance_is_named():
    """Two outputs with exactly the same noise: no inverse; a floor makes one, `auto` weighs element by element."""
    response = correlated(np.random.default_rng(4), "kronecker")
    right = np.array(response.noise.right)
    right[7, 1], right[7, :, 1] = right[7, 0], right[7, :, 0]
    right[7, 1, 1] = right[7, 0, 0]
    known = replace(response.noise, right=right, variance=np.einsum("faa->fa", right).real[:, :, None] * np.ones(2))
    singular = replace(response, noise=known)
    assert weigh(singular, NO_FLOOR).correlated is None
    floored = weigh(singular, FitSpec(weights=WeightSpec(model_error=0.02, covariance="auto")))
    fit = elastic_fit([singular], [plant(OUTPUTS, INPUTS)], [floored], parameters(), "complex")
    assert np.isfinite(fit.evaluate(parameters().x).cost)


def test_factors_multiply_the_weights_where_all_that_is_given_matches():
    """4 in a band, 1/2 for an output, both where both match, 0 leaves out; the statistics keep the true variance."""
    model = plant((0, 1))
    response = measured(model, np.array([0.01]))
    factors = (
        FactorSpec(4.0, band_hz=(10.0, 20.0)),
        FactorSpec(0.5, output="joint 1"),
        FactorSpec(0.0, band_hz=(30.0, 40.0), configurations=("c1",)),
        FactorSpec(9.0, configurations=("other",)),
    )
    spec = FitSpec(weights=WeightSpec(model_error=0.0, factors=factors))
    plain, weighted = fit_of(response, model), fit_of(response, model, spec)
    ratio = (weighted.frfs[0].gain / plain.frfs[0].gain) ** 2
    band = (FREQ >= 10) & (FREQ <= 20)
    below = FREQ < 10
    np.testing.assert_allclose(ratio[band], np.broadcast_to([[4.0], [2.0]], ratio[band].shape))
    np.testing.assert_allclose(ratio[below], np.broadcast_to([[1.0], [0.5]], ratio[below].shape))
    assert np.all(ratio[FREQ >= 30] == 0)


def test_a_robust_loss_shrugs_off_outliers():
    """One line in twenty is off by half of G: least squares goes astray, the robust estimate stays ten times nearer."""
    model, rng = plant((0, 2)), np.random.default_rng(7)
    response = measured(model, noise_of(model) / 5, rng)
    spoilt = rng.random(response.G.shape) < 0.05
    response = replace(response, G=response.G * np.where(spoilt, 1.5 * np.exp(0.5j), 1.0))
    spec = WeightSpec(model_error=0.0, loss="huber")
    weights = weigh(response, FitSpec(weights=spec))
    x = parameters().x
    errors = []
    for _ in range(15):
        x = solve(elastic_fit([response], [model], [weights], parameters(), "complex").problem, x).x
        errors.append(np.abs(x - parameters().x).max())
        plain = weigh(response, FitSpec(weights=spec))
        factor = robust_factors(elastic_fit([response], [model], [plain], parameters(), "complex"), [plain], x)
        weights = replace(plain, factor=factor[0])
    assert errors[-1] < errors[0] / 5
    assert np.median(weights.factor[spoilt]) < 0.2 < 0.8 < np.median(weights.factor[~spoilt])
