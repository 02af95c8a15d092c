"""Beyond one covariance: blocks, profiles, bootstraps, what the uncertainty does to modes and responses."""

from dataclasses import replace
from itertools import product

import numpy as np
import pytest
from fit.solve.test_solvers import problem as problem_of
from plants.three_mass import FREQ, NO_FLOOR, TRUTH, estimate, fit_of, measured, noise_of, parameters, plant
from scipy.stats import t as student

from elastid.base.arrays import ComplexArray, FloatArray
from elastid.base.errors import Note
from elastid.base.execution import Execution
from elastid.base.statistics import exceeds_cost_limit, max_cost_ratio, small_sample_factors
from elastid.covariance import Covariance
from elastid.fit.covariance import (
    UNLIMITED_DATA,
    Contributions,
    Sums,
    compensation_error,
    estimate_uncertainty,
    friction_variance,
    information,
    model_error_covariance,
    noise_covariance,
    noise_dof,
    prior_variance,
    sandwich_variance,
    sum_up,
    unexplained_error,
)
from elastid.fit.intervals import bootstrap, profile_likelihood
from elastid.fit.problem.frf_residuals import ElasticFit, elastic_fit
from elastid.fit.problem.least_squares import LeastSquares
from elastid.fit.problem.weights import Weights, weigh
from elastid.fit.robust_covariance import (
    LineSums,
    autocovariance,
    block_variance,
    disagreement,
    jackknife_variance,
    sum_blocks,
)
from elastid.fit.solve.solvers import solve
from elastid.fit.spec import FitSpec, WeightSpec
from elastid.linear.response.transfer import frequency_response
from elastid.parameters import Parameter, Parameters, Prior
from elastid.record import Configuration
from elastid.response import UNEXPLAINED, Response

X = parameters().x


def test_variance_has_degrees_of_freedom_of_its_lines():
    """Of ten equal lines of nu complex ones 2 nu 10, of one among them that has all the information 2 nu."""
    power = np.zeros((10, 2))
    power[:, 0], power[3, 1] = 2.0, 1.0
    np.testing.assert_allclose(noise_dof([power], [4.0], np.zeros(2)), [80.0, 8.0])
    assert np.all(np.isinf(noise_dof([power], [np.inf], np.zeros(2))))


def distorted(G: ComplexArray, noise: Covariance, total: Covariance) -> Response:
    """A motor's response G (F,) at 1 Hz, 2 Hz and so on, whose distortion is unexplained."""
    one, freq_hz, here = ("motor 1",), np.arange(1.0, len(G) + 1), Configuration("a", np.zeros(1))
    notes = (Note(UNEXPLAINED, ""),)
    return Response(freq_hz, G[:, None, None], one, one, "acceleration", here, noise=noise, total=total, notes=notes)


def test_distortion_tells_how_far_what_makes_it_moves_a_response() -> None:
    """Of a sign in multisines of random phases: the response is off by what the scatter of realisations says."""
    rng, N, M, level = np.random.default_rng(0), 4096, 40, 0.1
    lines = np.arange(1, N // 2)
    spectra = np.zeros((M, N // 2 + 1), complex)
    spectra[:, lines] = np.exp(2j * np.pi * rng.random((M, len(lines))))
    v = np.fft.irfft(spectra, axis=1)
    G = 1 + level * np.fft.rfft(np.sign(v) * v.std(), axis=1)[:, lines] / spectra[:, lines]
    variance = np.var(G, axis=0, ddof=1)[:, None, None] / M
    total, noise = Covariance(variance, float(M - 1)), Covariance(1e-6 * variance, np.inf)
    unexplained = distorted(G.mean(axis=0), noise, total)
    free = (("k_1", "N*m/rad"), ("d_1", "N*m*s/rad"), ("Jm_1", "kg*m^2"))
    parameters = Parameters(tuple(Parameter(name, 1.0, unit, log=True) for name, unit in free))
    stiffness, damping, inertia = compensation_error(parameters)
    assert inertia == 0 < stiffness < damping
    error = abs(G.mean()) - 1
    np.testing.assert_allclose(unexplained_error(parameters, [unexplained]), [error, 2 * error, 0.0], rtol=0.1)
    assert not unexplained_error(parameters, [replace(unexplained, notes=())]).any()


def test_a_floor_is_one_error_of_each_element_and_octave() -> None:
    """Where V leaves room, x has the scatter of refits whose elements are off by the floor, in phase and out of it."""
    model, octave = plant((0, 2)), np.floor(np.log2(FREQ / FREQ[0]))
    response = measured(model, noise_of(model))

    def fitted(G: FloatArray, floor: float) -> tuple[ElasticFit, Weights]:
        weights = weigh(response, FitSpec(weights=WeightSpec(model_error=floor)))
        return elastic_fit([replace(response, G=G)], [model], [weights], parameters(), "complex"), weights

    covariances, expected = [], np.zeros((4, 4))
    for floor in (0.002, 0.0):
        fit, weights = fitted(response.G, floor)
        covariances.append(estimate_uncertainty(fit, [response], [weights], X, is_forecast=True).covariance)
    for o, output, error in product(np.unique(octave), range(2), (0.002, 0.002j)):
        off = np.where((octave == o)[:, None, None] & (np.arange(2) == output)[:, None], 1 + error, 1.0)
        end = fitted(response.G * off, 0.002)[0].evaluate(X)
        expected += 0.5 * np.outer(*2 * [np.linalg.solve(end.hessian, end.gradient)])
    np.testing.assert_allclose(covariances[0] - covariances[1], expected, rtol=1e-3, atol=1e-5 * np.abs(expected).max())


def test_a_profile_knows_that_data_only_bound_a_parameter():
    """r = exp(-x) - 0 under noise of 1: any large x will do, and the interval is open to that side."""
    free = Parameters((Parameter("x", 3.0, lower=-50, upper=50), Parameter("y", 0.1, lower=-9, upper=9)))

    def residual(x):
        return np.array([4 * np.exp(-x[0]), x[1], x[1] - 0.2]), np.array([[-4 * np.exp(-x[0]), 0], [0, 1], [0, 1]])

    problem = problem_of(free, residual)
    variance = np.diag(np.linalg.inv(problem.evaluate(free.x).hessian / 2))
    interval, _ = profile_likelihood(problem, free.x, variance, ["x"])
    assert interval[1] == np.inf
    assert interval[0] == pytest.approx(-np.log(np.sqrt(1.96**2 + 16 * np.exp(-6)) / 4), abs=0.1)


def linear_in_damping(relative: float) -> LeastSquares:
    """r = (d - 1) / relative with x = log d, as G nearly is in a damping, and another number."""
    free = Parameters((Parameter("d", 1.0, lower=1e-9, upper=1e3, log=True), Parameter("y", 0.0, lower=-9, upper=9)))

    def residual(x):
        d = np.exp(x[0])
        return np.array([(d - 1) / relative, 100 * x[1], x[1]]), np.array([[d / relative, 0], [0, 100], [0, 1]])

    return problem_of(free, residual)


def test_interval_of_uncertain_damping_is_on_linear_scale():
    """r is linear in d: exactly d +- 1.96 std, which no interval symmetric in log d is, in a few evaluations."""
    problem, calls = linear_in_damping(0.3), []

    def evaluate(x):
        calls.append(x)
        return problem.evaluate(x)

    interval, _ = profile_likelihood(replace(problem, evaluate=evaluate), np.zeros(2), np.array([0.09, 5e-5]), ["d"])
    np.testing.assert_allclose(np.exp(interval), [1 - 1.96 * 0.3, 1 + 1.96 * 0.3], atol=2e-3)
    assert len(calls) < 25


def test_an_end_is_found_beyond_a_place_without_a_model():
    """V is infinite from x = 1 on, which is within reach: the end lies between, and is found from the inside."""
    problem = linear_in_damping(0.3)

    def evaluate(x):
        here = problem.evaluate(x)
        return here if x[0] < 1 else replace(here, cost=np.inf)

    interval, _ = profile_likelihood(replace(problem, evaluate=evaluate), np.zeros(2), np.array([0.6, 5e-5]), ["d"])
    assert np.exp(interval[0]) < 0.2
    assert interval[1] == pytest.approx(np.log(1 + 1.96 * np.sqrt(0.6)), abs=0.01)


@pytest.mark.parametrize(("criterion", "is_known"), [("complex", True), ("log", True), ("complex", False)])
def test_bootstraps_scatter_as_the_covariance_says(criterion, is_known):
    """60 repetitions: standard deviations within what 60 draws allow, of noise that is measured or only supposed."""
    model = plant((0, 2), (0, 2))
    response = measured(model, noise_of(model), np.random.default_rng(1))
    end, sure = estimate(response, model, criterion=criterion)
    fit = fit_of(response, model, criterion=criterion)
    floored = replace(response, noise=None), FitSpec(weights=WeightSpec(model_error=0.05))
    draws = bootstrap(fit, [weigh(*(response, NO_FLOOR) if is_known else floored)], end.x, 60, seed=4)
    ratio = draws.std(axis=0) / np.sqrt(np.diag(sure.covariance))
    assert np.all((ratio > 0.65) & (ratio < 1.35)), ratio


F, N_X, SETS = 240, 3, 400


def drawn(rng: np.random.Generator, length: int, band: int) -> tuple[np.ndarray, np.ndarray, list[float]]:
    """Estimates (SETS, N_X) of a line fit under noise averaged over `length` lines, their variances, and T."""
    J = rng.standard_normal((F, N_X)) + np.linspace(-1, 1, F)[:, None]
    A_inverse = np.linalg.inv(J.T @ J)
    found, stated, parted = [], [], []
    for _ in range(SETS):
        white = rng.standard_normal(F + length - 1)
        r = np.convolve(white, np.ones(length) / np.sqrt(length), "valid")
        x = A_inverse @ J.T @ r
        pull = (J * (r - J @ x)[:, None]).T
        blocks, _, parts = sum_blocks(pull, J.T[:, :, None] + 0j, 2 * np.ones((F, 1, 1), complex), band / 2)
        found.append(x)
        stated.append(block_variance([pull.T if band == 1 else blocks], A_inverse))
        parted.append(disagreement([parts], N_X))
    return np.array(found), np.array(stated), parted


def test_of_white_residuals_blocks_state_the_scatter_and_agree() -> None:
    """Variances to 15 %, T = 1.00 to 2 %, whatever the blocks."""
    x, variance, parted = drawn(np.random.default_rng(0), 1, 12)
    np.testing.assert_allclose(variance.mean(axis=0), x.var(axis=0), rtol=0.2)
    assert np.mean(parted) == pytest.approx(1.0, abs=0.02)
    assert max(parted) < 1.8


@pytest.mark.slow
def test_long_blocks_of_correlated_residuals_give_scatter() -> None:
    """Noise averaged over ten lines: single lines state a fraction of the variance, blocks of thirty nearly all."""
    x, variance, parted = drawn(np.random.default_rng(1), 10, 30)
    x_again, single, _ = drawn(np.random.default_rng(1), 10, 1)
    np.testing.assert_array_equal(x, x_again)
    place = int(np.argmax(x.var(axis=0)))
    assert variance[:, place].mean() > 0.7 * x[:, place].var()
    assert single[:, place].mean() < 0.5 * x[:, place].var()
    assert np.mean(parted) > 2


def test_few_blocks_and_unknown_noise_say_nothing() -> None:
    """One block has no scatter; pulls without a covariance do not disagree."""
    assert not block_variance([np.ones((1, 2))], np.eye(2)).any()
    assert np.isnan(disagreement([sum_blocks(np.ones((2, 20)), np.ones((2, 20, 1)) + 0j, None, 2.0)[2]], 2))


def evidence_of(J, r) -> LineSums:
    """A configuration of real residuals r (N,) with slopes J (N, n_x)."""
    pull = (J * r[:, None]).T
    lags, unknown = autocovariance(r[:, None] + 0j), (np.nan, np.nan, np.inf, 0.0, {}, {})
    return LineSums(np.ones(len(r)), J, J**2, lags, len(r), pull, pull.T, None, (0.0, 0), *unknown)


@pytest.mark.parametrize("Q", [3, 5, 40])
def test_influence_of_linear_model_equals_refits_without_each(Q):
    rng = np.random.default_rng(Q)
    blocks, y = [rng.standard_normal((6, 3)) * (1, 1e4, 1e-5) for _ in range(Q)], rng.standard_normal((Q, 6))
    x = np.linalg.lstsq(np.vstack(blocks), np.concatenate(y))[0]
    H = np.linalg.inv(np.linalg.qr(np.vstack(blocks), mode="r")).T
    parts = [evidence_of(J @ H.T, J @ x - one) for J, one in zip(blocks, y, strict=True)]
    found = jackknife_variance(parts, H)
    scatter = np.array([
        np.linalg.lstsq(np.vstack(blocks[:i] + blocks[i + 1 :]), np.delete(y, i, axis=0).ravel())[0] for i in range(Q)
    ])  # fmt: skip
    expected = (Q - 1) / Q * np.sum((scatter - scatter.mean(axis=0)) ** 2, axis=0)
    t = student.ppf(0.975, Q - 1) / student.ppf(0.975, np.inf)
    np.testing.assert_allclose(found, t**2 * expected, rtol=1e-8)


@pytest.mark.parametrize("dof", [8, 500])
def test_cost_above_noise_is_model_error(dof: int):
    """Once in 700 draws of V, of few degrees of freedom, whose distribution is skew, as of many."""
    draws = np.random.default_rng(0).chisquare(dof, 700_000)
    assert np.mean(draws > dof * max_cost_ratio(dof)) == pytest.approx(1 / 700, rel=0.1)
    assert exceeds_cost_limit(1.4 * 500.0, 500.0, 500)


J, R = (np.random.default_rng(7).standard_normal(shape) for shape in ((30, 2), 30))
HALF = np.diag([2.0, 0.1])


def sums_of(*parts: LineSums, **given) -> Sums:
    """Sums in which A^-1 = H^T H, without priors, load tests or floor unless given."""
    none, count = np.zeros((0, 2)), sum(part.n_residuals for part in parts)
    return replace(Sums(parts, HALF, np.ones(2), none, none, none, none[:, 0], {}, count, count - 2), **given)


def test_residuals_count_by_dof_and_jointly_at_frequency() -> None:
    """N / (N - n_x) of 30; two configurations alike add up before they are squared; tau = 2."""
    white = replace(evidence_of(J, R), freq_hz=np.arange(30.0), autocovariance=np.array([R @ R]))
    single = np.sum((J * R[:, None]) ** 2, axis=0) * [4.0, 0.01]
    for sums, expected in (
        (sums_of(white), 30 / 28 * single),
        (sums_of(white, white), 60 / 58 * 4 * single),
        (sums_of(white, replace(white, freq_hz=white.freq_hz + 100)), 60 / 58 * 2 * single),
        (sums_of(replace(white, autocovariance=np.eye(30)[0] + 0.5 * np.eye(30)[1])), 30 / 28 * 2 * single),
    ):
        np.testing.assert_allclose(sandwich_variance(sums), expected)


def test_measured_noise_counts_and_unknown_noise_is_residual() -> None:
    """Covariance H^T S H with priors and load tests; V of the power less what the parameters take; its dof."""
    one, prior = evidence_of(J, R), np.diag([0.4, 0.0])
    measured = replace(one, noise=np.array([[0.5, 0.1], [0.1, 0.3]]), noise_power=50.0, noise_spread=90.0)
    level, S = R @ R / 28, measured.noise + prior**2 + J[:3].T @ J[:3]
    for sums, meat, power, dof in (
        (sums_of(measured, prior_J=prior, static_J=J[:3]), S, 54.0, 2 * 54**2 / (90 + 8)),
        (sums_of(one), level * J.T @ J, level * 30, np.nan),
    ):
        covariance, *cost_and_dof = noise_covariance(sums)
        np.testing.assert_allclose(covariance, HALF @ meat @ HALF)
        assert cost_and_dof == pytest.approx([power - np.trace(meat), dof], nan_ok=True)


def test_model_error_power_is_at_most_excess_cost() -> None:
    """Above the expected cost and two of its standard deviations, of 200 degrees of freedom 20 of 100."""
    part = replace(evidence_of(J, R), model_error_power=40.0)
    sums = sums_of(part, model_error_pulls={("y", "u", 0): np.array([1.0, 1j]), ("y", "u", 1): np.array([2.0, 0])})
    for cost, share in ((160.0, 1.0), (80.0, 0.0), (100.0, 0.5), (110.0, 0.75)):
        np.testing.assert_allclose(model_error_covariance(sums, cost, 100.0, 200.0), share * np.diag([10.0, 0.005]))


def test_covariance_is_the_largest_of_three_contributions_plus_the_others() -> None:
    """Per parameter, of widened noise, residuals and blocks, with the noise's correlation; model error etc. add up."""
    noise, other = np.array([[4.0, 1.0], [1.0, 1.0]]), np.array([[0.2, 0.1], [0.1, 0.3]])
    every = Contributions(
        noise=noise, widening=np.array([1.5, 1.0]), residuals=np.array([1.0, 2.25]), blocks=np.array([0.0, 1.5]),
        model_error=other, ratios=2 * other, friction=np.array([0.5, 0.0]),
    )  # fmt: skip
    variance = np.array([9.0, 2.25])
    largest = np.sqrt(np.outer(variance, variance)) * [[1, 0.5], [0.5, 1]]
    expected = largest + 3 * other + np.diag([0.5, 0.0])
    covariance = every.covariance(np.eye(2))
    np.testing.assert_allclose(covariance, expected)
    blocks = replace(every, blocks=np.array([16.0, 0.0])).covariance(np.eye(2))
    np.testing.assert_allclose(np.diag(blocks), [16 + 1.1, 2.25 + 0.9])
    exact = replace(every, noise=np.zeros((2, 2))).covariance(np.array([[2.0, 1.0]]))  # correlation of A^-1
    np.testing.assert_allclose(exact[0, 1], np.sqrt(1.0 * 2.25) + 0.3)
    np.testing.assert_allclose(every.random, [4 + 0.4 + 0.5, 1 + 0.6])
    np.testing.assert_allclose(every.random_fraction(covariance, True), [9.9 / 10.1, 1.6 / 3.15])
    np.testing.assert_allclose(every.random_fraction(covariance, False), 1 - np.diag(other) / np.diag(covariance))


def test_prior_variance_persists_with_endless_data() -> None:
    """H^T Q H by the tolerances now, and (s A_data + P)^-1 with s times the data, in closed form."""
    A_data, P = J.T @ J, np.diag([0.0, 50.0])
    H = np.linalg.inv(np.linalg.cholesky(A_data + P))
    sums = replace(sums_of(evidence_of(J, R)), H=H, prior_J=np.sqrt(P) @ H.T)
    now, persistent = prior_variance(sums, [1])
    loads = np.array([[2.0, 1.0], [0.0, 3.0], [1.0, 1.0]])
    np.testing.assert_allclose(replace(sums, static_J=loads).load_power, np.diag(H.T @ loads.T @ loads @ H))
    C = np.linalg.inv(A_data + P)
    np.testing.assert_allclose(now, np.diag(C @ P @ C))
    np.testing.assert_allclose(persistent, np.diag(np.linalg.inv(UNLIMITED_DATA * A_data + P)))


def test_information_sums_to_one_with_load_tests() -> None:
    """Two configurations with 3/6 and 2/6, load tests the rest; the band contains the middle half."""
    power, loads = [np.full((4, 1), 0.75), np.full((4, 1), 0.5)], np.array([1.0])
    fraction, band = information(power, [np.arange(1.0, 5.0), np.arange(11.0, 15.0)], loads)
    np.testing.assert_allclose(fraction, [[3 / 6], [2 / 6]])
    np.testing.assert_array_equal(band, [[2.0, 12.0]])


def test_friction_variance_needs_compensation_or_distortion() -> None:
    """(0.02 %)^2 of a stiffness if friction was compensated; springs of motors leave 1 % of the distortion's."""
    noise, total = Covariance(np.zeros((5, 1, 1)), np.inf), Covariance(np.full((5, 1, 1), 1e-4), 3.0)
    response = distorted(np.ones(5, complex), noise, total)
    stiffness = Parameter("k_1", 1.0, "N*m/rad", log=True)
    rigid, relaxing = Parameters((stiffness,)), Parameters((stiffness, Parameter("relaxation_1", 1.0, "1/s", log=True)))
    by_distortion = 2 / (np.pi - 2) * 4e-4
    np.testing.assert_allclose(friction_variance(rigid, [], True), [4e-8])
    np.testing.assert_allclose(friction_variance(rigid, [response], False), [by_distortion])
    np.testing.assert_allclose(friction_variance(relaxing, [response], True)[0], 4e-8 + 0.01 * by_distortion)


def test_few_repetitions_widen_the_noise() -> None:
    """Of 4 degrees of freedom a line, standard deviations by Student's quantile at the dof of all lines."""
    model = plant()
    response = measured(model, noise_of(model))
    exact = weigh(response, NO_FLOOR)
    assert exact.noise is not None
    few = replace(exact, noise=replace(exact.noise, measured=replace(exact.noise.measured, dof=4.0)))
    fit = elastic_fit([response], [model], [exact], parameters(), "complex")
    known, widened = (estimate_uncertainty(fit, [response], [w], X, is_forecast=True) for w in (exact, few))
    factor = small_sample_factors(noise_dof(known.power, [4.0], np.zeros(4)))
    ratio = np.sqrt(np.diag(widened.covariance) / np.diag(known.covariance))
    np.testing.assert_allclose(ratio, factor)
    assert np.all(factor > 1.001)
    np.testing.assert_allclose(known.averaging_fraction, 1.0)


def test_tolerances_persist_by_what_endless_data_leave() -> None:
    """The persistent fraction of the variance is that of the priors with endless data, and not their whole part."""
    model, std = plant(), 2e-4
    nuisance = Parameter(
        "k_a", TRUTH["k_a"], "1", 1e-3, 1e3, log=True, is_nuisance=True, prior=Prior(TRUTH["k_a"], std)
    )
    free, response = parameters(k_a=nuisance), measured(model, noise_of(model))
    weights = weigh(response, NO_FLOOR)
    fit = elastic_fit([response], [model], [weights], free, "complex")
    sure = estimate_uncertainty(fit, [response], [weights], free.x, is_forecast=True)
    place = [p.is_nuisance for p in free.free].index(True)
    now, persistent = prior_variance(sum_up(fit, [response], [weights], free.x, Execution()), [place])
    variance = np.diag(sure.covariance)
    np.testing.assert_allclose(sure.persistent_fraction, np.minimum(persistent, now) / variance)
    np.testing.assert_allclose(sure.averaging_fraction, (variance - now) / variance)
    assert np.all(persistent[place] < 0.5 * now[place])


def test_configurations_that_disagree_widen_to_their_jackknife() -> None:
    """Of three configurations with other stiffnesses, variances are at least those of the jackknife."""
    model, responses = plant(), []
    for name, factor in (("a", 0.9), ("b", 1.0), ("c", 1.1)):
        theta = model.theta_ref * np.where(np.array(model.parameters) == "k_g", factor, 1.0)
        G = frequency_response(model, theta, FREQ)
        responses.append(replace(measured(model, noise_of(model)), G=G, configuration=Configuration(name, [0.0])))
    weights = [weigh(response, NO_FLOOR) for response in responses]
    fit = elastic_fit(responses, [model] * 3, weights, parameters(), "log")
    end = solve(fit.problem, X)
    sums = sum_up(fit, responses, weights, end.x, Execution())
    scatter = jackknife_variance(sums.line_sums, sums.H)
    variance = np.diag(estimate_uncertainty(fit, responses, weights, end.x).covariance)
    assert np.any(scatter > 1.01 * np.maximum(block_variance([part.blocks for part in sums.line_sums], sums.H), 0))
    assert np.all(variance >= (1 - 1e-12) * scatter)  # rounding


def test_block_variance_matches_direct_sum() -> None:
    """Of three blocks t^2 3 / 2 sum (H^T g)^2, t of two degrees of freedom."""
    blocks = np.array([[1.0, 2.0], [0.5, -1.0], [-1.5, -1.0]])
    t = student.ppf(0.975, 2) / student.ppf(0.975, np.inf)
    expected = t**2 * 3 / 2 * np.sum((blocks @ HALF) ** 2, axis=0)
    np.testing.assert_allclose(block_variance([blocks[:1], blocks[1:]], HALF), expected)
