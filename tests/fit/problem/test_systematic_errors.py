"""Systematic errors of known size: estimated with the parameters, or covered by their intervals."""

from dataclasses import replace

import numpy as np
import pytest
from plants.faults import SPEC, drawn, true_case
from plants.three_mass import FREQ, NO_FLOOR, measured, noise_of, parameters, plant

from elastid.fit.covariance import estimate_uncertainty
from elastid.fit.frf_problem import Assembly, relinearise
from elastid.fit.parameter_selection import choose
from elastid.fit.problem import systematic_errors
from elastid.fit.problem.frf_residuals import ElasticFit, elastic_fit
from elastid.fit.problem.least_squares import LocalOptimum, as_real
from elastid.fit.problem.systematic_errors import contrasts_of, find_factors, next_factors, with_modelled_bias
from elastid.fit.problem.weights import weigh
from elastid.linear.response.transfer import frequency_response
from elastid.response import Response

X = parameters().x
NOISE = noise_of(plant())


def data(seed: int, size: float, factor: float) -> Response:
    """Measured with noise, and times a factor with the error of a motor heavier by a part `size` of 0.0059 kg m^2."""
    clean = measured(plant(), NOISE, np.random.default_rng(seed))
    G = frequency_response(plant(), plant().theta_ref, FREQ)
    error = -(2j * np.pi * FREQ[:, None, None]) * 0.0059 * size * G**2
    return replace(clean, G=clean.G + factor * error, bias=np.stack([error, np.zeros_like(error)])[:, None])


def solved(response: Response) -> tuple[np.ndarray, np.ndarray, float]:
    """x and its covariance by Gauss-Newton steps, and the factor."""
    x, c, weights = X, np.zeros(1), [weigh(response, NO_FLOOR)]

    def without(c: np.ndarray) -> ElasticFit:
        clean = replace(response, G=response.G - c[0] * response.bias[0, 0])
        return elastic_fit([clean], [plant()], weights, parameters(), "complex")

    for _ in range(6):
        c = next_factors(without(c), [response], x, c)
        fit = without(c)
        ((r, J),) = fit.blocks(x)
        rows = as_real(J).reshape(len(x), -1).T
        x = x - np.linalg.lstsq(rows, as_real(r).ravel())[0]
    return x, estimate_uncertainty(fit, [response], weights, x).covariance, float(c[0])


def test_the_factor_is_that_of_generalised_least_squares() -> None:
    """x, c minimise |r + J dx - H c|^2 + |c|^2: the same x as with the covariance I + H H^T of all residuals."""
    response = data(0, 0.01, 1.0)
    x, _, c = solved(response)
    fit = elastic_fit([response], [plant()], [weigh(response, NO_FLOOR)], parameters(), "complex")
    factors, mixing = find_factors([response]), fit.frfs[0].mixing
    r, every, _ = systematic_errors.block_with_factors(fit, x, factors, fit.frfs[0], response, mixing)
    J, slopes = np.split(every, [len(x)])
    H = (contrasts_of(response, factors) @ as_real(slopes).reshape(len(slopes), -1)).T
    rows, residual = as_real(J).reshape(len(x), -1).T, as_real(r).ravel()
    whole = np.eye(len(rows)) + H @ H.T
    gradient = rows.T @ np.linalg.solve(whole, residual)
    step = np.linalg.solve(rows.T @ np.linalg.solve(whole, rows), gradient)
    deviation = np.sqrt(np.diag(np.linalg.inv(rows.T @ rows)))
    assert np.all(np.abs(step) < 0.01 * deviation)
    assert c == pytest.approx(float(-H[:, 0] @ np.linalg.solve(whole, residual)), abs=0.01)
    other = replace(response, configuration=replace(response.configuration, name="other"))
    pair = [replace(one, bias=one.bias[[0, 0]]) for one in (response, other)]
    assert sorted(contrasts_of(pair[0], find_factors(pair))[:, 1].tolist()) == [-0.5, 0.0, 0.5]


@pytest.mark.parametrize("size", [0.001, 0.02])
@pytest.mark.slow
def test_intervals_hold_with_a_factor_drawn_anew(size: float) -> None:
    """Factors from N(0, 1), 60 data sets: errors scatter as stated, whether the data show the factor or not."""
    rng, ratios = np.random.default_rng(1), []
    for seed in range(60):
        x, covariance, _ = solved(data(seed, size, rng.standard_normal()))
        ratios.append((x - X) / np.sqrt(np.diag(covariance)))
    rms = np.sqrt(np.mean(np.square(ratios), axis=0))
    assert np.all((rms > 0.7) & (rms < 1.25))


def test_error_from_noisy_response_equals_model_error() -> None:
    """z G^2 of the measured G is correlated with its noise; that of the model is exact."""
    G, exact = frequency_response(plant(), plant().theta_ref, FREQ), data(0, 0.01, 1.0)
    formed = replace(exact, bias=exact.bias * (exact.G / G) ** 2)
    np.testing.assert_allclose(with_modelled_bias(formed, G).bias, exact.bias, rtol=1e-9)


def test_systematic_errors_are_evaluated_at_final_model() -> None:
    """From stiffnesses 10 % off a fit ends within 0.01 standard deviations of one from the truth, in the same errors.

    Errors of the response at the start would differ from these by nearly their own size, and the ends with them.
    """
    case, responses = true_case(), []
    for exact, noisy in zip(case.responses, drawn(true_case(), np.random.default_rng(0), 0.01), strict=True):
        G = exact.G
        errors = np.array([-0.005 * G[:, :, [j]] * G[:, [j], :] / np.abs(G[-1, j, j]) for j in range(G.shape[2])])
        off = replace(noisy, G=noisy.G + errors.sum(axis=0), bias=np.stack([errors, np.zeros_like(errors)]))
        responses.append(off)
    parameters = choose(SPEC, case.robot, [one.configuration.name for one in responses])
    assembly = Assembly.of(responses, case.robot, SPEC, parameters)
    starts = [parameters.x + np.log(factor) for factor in (1.0, 1.1)]
    true, other = (relinearise(assembly, LocalOptimum(x, x, 0.0, 0, True, "given"), "complex") for x in starts)
    sure = estimate_uncertainty(true.fit, true.responses, true.weights, true.end.x)
    assert np.all(np.abs(other.end.x - true.end.x) < 0.01 * np.sqrt(np.diag(sure.covariance)))
    for measured_one, one, part in zip(responses, other.responses, other.fit.frfs, strict=True):
        G = part.kernel.response(part.theta(other.fit.parameters, other.end.x))
        modelled = with_modelled_bias(measured_one, G).bias
        assert modelled is not None
        np.testing.assert_allclose(one.bias, modelled, rtol=1e-3, atol=1e-4 * np.abs(modelled).max())
