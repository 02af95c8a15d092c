"""Static load tests in the least-squares problem: derivatives, counts, information, and what they do to a fit."""

from dataclasses import replace

import numpy as np
import pytest
from plants.arm import robot as arm
from plants.load_tests import NAMED, load_tests, measure
from plants.refusals import refused

from elastid.fit.frf_problem import Assembly
from elastid.fit.identify import fit_parameters, identify
from elastid.fit.load_tests import LoadTest
from elastid.fit.parameter_selection import choose
from elastid.fit.problem.static_loads import placed_tests
from elastid.fit.spec import FitSpec, ParameterSpec

SPRINGS = FitSpec(parameters={"k_*": ParameterSpec()}, starts=1)


@pytest.fixture(scope="module")
def responses():
    return measure(np.random.default_rng(0), noise=0.05)


def test_slopes_and_counts_of_the_problem(responses):
    """J by differences; dof grows by the readings, of which V expects one each."""
    parameters = choose(SPRINGS, arm(), [*NAMED])
    tests = load_tests(np.random.default_rng(1))
    with_loads = Assembly.of(responses, arm(), SPRINGS, parameters, loads=placed_tests(tests, NAMED)).at(
        parameters.x, "complex"
    )
    without = replace(with_loads, loads=None)
    x = parameters.x + np.array([0.1, -0.2])
    r, J = with_loads.static(x)
    assert with_loads.problem.dof == without.problem.dof + len(r)
    for i in range(2):
        step = 1e-5 * np.eye(2)[i]
        both = [with_loads.static(x + sign * step)[0] for sign in (1, -1)]
        np.testing.assert_allclose(J[:, i], (both[0] - both[1]) / 2e-5, rtol=1e-6, atol=1e-6)
    np.testing.assert_allclose(with_loads.evaluate(x).cost - without.evaluate(x).cost, r @ r, rtol=1e-9)
    np.testing.assert_allclose(with_loads.evaluate(x).gradient - without.evaluate(x).gradient, 2 * J.T @ r, rtol=1e-6)
    assert with_loads.n_residuals == without.n_residuals + len(r)
    loads, zero = with_loads.loads, np.zeros(len(r))
    samples = [loads.drawn(zero, np.random.default_rng(seed)).measured / loads.std for seed in range(400)]
    np.testing.assert_allclose(np.std(samples), 1.0, atol=0.05)


def test_what_a_test_must_say():
    """Posture once, a load, a direction of dials, an error."""
    good = {"configuration": "c1", "force": (0, 0, -1), "std": 1e-6}
    assert LoadTest(**good, deflection=(0, 0, 0)).n_readings == 3
    for wrong, words in (
        ({"angles": (0.1, 0.2)}, "one of them"), ({"force": (0, 0, 0)}, "without a load"),
        ({"deflection": 1e-3}, "a tracker three"), ({"deflection": (0, 0, 0), "along": "z"}, "a dial gauge has one"),
        ({"std": None}, "a positive number"), ({"std": -1e-6}, "a positive number"), ({"mass": -1}, "mass: "),
        ({"along": (0, 0, 0)}, "zero vector"),
    ):  # fmt: skip
        with pytest.raises(ValueError, match=words):
            LoadTest(**{**good, **wrong})


def test_unknown_places_are_named():
    """A configuration and a frame that are not there."""
    test = LoadTest(configuration="c7", force=(0, 0, -1), std=1e-6, deflection=(0, 0, 0))
    with refused("study/invalid", place="loads"):
        placed_tests([test], NAMED)


def test_covariance_adds_the_information_of_the_loads(responses):
    """C^-1 = C_responses^-1 + J^T J where the noise is known: a fit with load tests, held against that."""
    tests = load_tests(np.random.default_rng(2), std=2e-6)
    alone, both = (
        fit_parameters(responses, arm(), SPRINGS),
        identify(responses, arm(), SPRINGS, loads=placed_tests(tests, NAMED)),
    )
    parameters = choose(SPRINGS, arm(), [*NAMED])
    fit = Assembly.of(responses, arm(), SPRINGS, parameters, loads=placed_tests(tests, NAMED)).at(both.x, "complex")
    _, J = fit.static(both.x)
    expected = np.linalg.inv(np.linalg.inv(alone.covariance) + J.T @ J)
    np.testing.assert_allclose(np.diag(both.covariance), np.diag(expected), rtol=0.25)
    assert both.status == "converged", both.message
    assert np.all(np.abs(both.x - parameters.x) < 4 * np.sqrt(np.diag(both.covariance)))
    assert len(both.static.readings) == sum(test.n_readings for test in tests)
    assert not both.static.disagrees
    assert abs(both.static.ratio - 1) < 3.5 * both.static.ratio_std
    assert "fit/loads" not in {note.code for note in both.notes}
    assert max(reading.by_responses_std for reading in both.static.readings) > 1e-7
