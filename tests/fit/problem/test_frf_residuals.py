"""Residuals, and the three-mass plant of Wernholt & Gunnarsson (2006): derivatives, efficiency, honest intervals."""

from dataclasses import replace

import numpy as np
import pytest
from plants.refusals import refused
from plants.three_mass import FREQ, NO_FLOOR, TRUTH, cramer_rao, estimate, fit_of, measured, noise_of, parameters, plant
from plants.two_mass import circular

from elastid.fit.covariance import Uncertainty, estimate_uncertainty
from elastid.fit.problem.frf_residuals import elastic_fit
from elastid.fit.problem.least_squares import Evaluation, ResidualKind, difference, distance_to_optimum, error_gain
from elastid.fit.problem.weights import weigh
from elastid.fit.robust_covariance import autocovariance, correlation_length
from elastid.fit.solve.solvers import solve
from elastid.fit.spec import FitSpec, WeightSpec
from elastid.parameters import Parameter, Prior


def test_the_cramer_rao_bound_is_the_published_one():
    """5 % relative noise per line: .0015, .0100, .0011, .0347."""
    np.testing.assert_allclose(cramer_rao(plant(), noise_of(plant())), [0.0015, 0.0100, 0.0011, 0.0347], rtol=0.05)


def test_inputs_and_outputs_are_matched_by_name():
    """A response that lists its outputs in another order than the model is fitted all the same."""
    model = plant((0, 1, 2))
    swapped = measured(plant((2, 0)), np.array([0.01]))
    assert fit_of(swapped, model).evaluate(parameters().x).cost < 1e-20
    with refused("fit/responses", place="configuration c1"):
        fit_of(swapped, plant((0, 1)))


def test_both_criteria_converge_from_far_starts():
    """30 starts up to a factor 7.4 off in all four parameters, three outputs, exact data: 27 or more hit the truth."""
    model = plant((0, 1, 2))
    response = measured(model, noise_of(model))
    starts = parameters().x + np.log(7.4) * np.random.default_rng(8).uniform(-1, 1, (30, 4))

    def hits(criterion) -> int:
        problem = fit_of(response, model, criterion=criterion).problem
        return sum(np.allclose(solve(problem, x).x, parameters().x, atol=1e-3) for x in starts)

    assert hits("log") >= 27
    assert hits("complex") >= 27


def test_a_floor_far_above_the_residuals_is_held_down():
    """0.05 % of noise contradicts a floor of 5 %: the intervals stay within four times those of the noise."""
    model = plant((0, 2))
    std, rng = 0.01 * noise_of(model), np.random.default_rng(10)
    _, sure = estimate(measured(model, std, rng), model, FitSpec(weights=WeightSpec(model_error=0.05)))
    assert np.all(np.sqrt(np.diag(sure.covariance)) < 4 * cramer_rao(model, std))


@pytest.mark.parametrize("wrong", ["delay", "mode", "gain"])
def test_intervals_widen_where_the_model_is_wrong(wrong):
    """1 ms of delay, a parallel mode or 2 % of gain that the model lacks, under 1 % of noise: the truth stays within
    three claimed standard deviations, where the noise alone would have it tens away."""
    model = plant()
    s = 1j * FREQ / 25
    factor = {
        "delay": np.exp(-2j * np.pi * FREQ * 1e-3),
        "mode": 1 + 0.1 * s**2 / (1 + s**2 + 0.1 * s),
        "gain": np.full_like(s, 1.02),
    }[wrong][:, None, None]
    std = 0.2 * noise_of(model)
    exact = measured(model, std, np.random.default_rng(6))
    end, sure = estimate(replace(exact, G=exact.G * factor), model)
    error = np.abs(end.x - parameters().x)
    assert np.all(error < 3 * np.sqrt(np.diag(sure.covariance)))
    assert np.any(error > 6 * cramer_rao(model, std))


def test_the_correlation_length_of_white_residuals_is_one():
    """tau of white noise is 1; of a moving mean over three lines it is 3."""
    white = circular(np.random.default_rng(7), (2000, 3))
    for residual, tau in ((white, 1.0), (white[2:] + white[1:-1] + white[:-2], 3.0)):
        found = correlation_length([autocovariance(residual)], 2 * residual.size)
        assert found == pytest.approx(tau, abs=0.1 * tau)


def test_a_prior_takes_part_like_a_measurement():
    """A prior as sure as the data halves the variance and draws the estimate half way; V counts it as one number."""
    model = plant()
    response = measured(model, noise_of(model))
    bound = cramer_rao(model, noise_of(model))[3]
    alone = {name: Parameter(name, v, log=True, free=False) for name, v in TRUTH.items() if name != "d_a"}
    weights = weigh(response, NO_FLOOR)

    def estimated(prior: Prior | None) -> tuple[float, Uncertainty]:
        free = parameters(**alone, d_a=Parameter("d_a", TRUTH["d_a"], "1", 1e-4, 1.0, log=True, prior=prior))
        fit = elastic_fit([response], [model], [weights], free, "complex")
        end = solve(fit.problem, free.x)
        return float(end.x[0]), estimate_uncertainty(fit, [response], [weights], end.x)

    x, sure = estimated(None)
    variance, n = float(sure.covariance[0, 0]), 2 * response.G.size
    assert variance < bound**2
    std = np.sqrt(variance)
    drawn, halved = estimated(Prior(float(np.exp(x + 0.1 * std)), std))
    assert halved.covariance[0, 0] == pytest.approx(variance / 2, rel=0.01)
    stated = [(each.cost_dof, each.expected_cost) for each in (sure, halved)]
    np.testing.assert_allclose(stated, [(n, n - 1), (n + 1, n)])
    assert drawn - x == pytest.approx(0.05 * std, rel=0.05)


G = np.array([1.0 + 2.0j, -3.0 + 0.5j])


@pytest.mark.parametrize("kind", ["complex", "log"])
def test_the_slope_of_a_residual_is_its_difference_quotient(kind: ResidualKind) -> None:
    """s = -de/dG, and the gain of a small error of the measured response is the same."""
    measured, step = 1.3 * G, 1e-7
    e, moved = (difference(kind, measured, model) for model in (G, G + step))
    np.testing.assert_allclose((e - moved) / step, error_gain(kind, G), rtol=1e-6)
    np.testing.assert_allclose(difference(kind, G + step, G) / step, error_gain(kind, G), rtol=1e-6)


def test_distance_to_optimum_of_parabola_is_in_std() -> None:
    """V = 4 (x - 3)^2 + dof at x = 5: the standard deviation is 1 / 2, twice that where V is four times its dof."""
    dof, offset = 10, 2.0
    for cost, expected in ((10.0, 4.0), (40.0, 2.0)):
        ending = Evaluation(cost, np.array([8.0 * offset]), np.array([[8.0]]))
        assert distance_to_optimum(ending, dof, np.array([False])) == pytest.approx(expected)
        assert distance_to_optimum(ending, dof, np.array([True])) == 0.0
    assert distance_to_optimum(Evaluation(np.inf, np.zeros(1), np.eye(1)), dof, np.array([False])) == np.inf
