"""Searches in few dimensions among modification indices, against those of SciPy, and what spares some of them."""

from __future__ import annotations

from functools import partial

import numpy as np
import pytest
from plants.faults import FAULTS, SPEC, drawn, true_case
from scipy.optimize import lsq_linear

from elastid.fit.diagnosis import unlike_configurations
from elastid.fit.diagnosis.modification.lateness import least_between
from elastid.fit.diagnosis.modification.score_test import least_within
from elastid.fit.diagnosis.two_robots import costs_alone, find_two_groups
from elastid.fit.diagnosis.unlike_configurations import find_foreign_configurations
from elastid.fit.setup.assembly import Assembly
from elastid.fit.setup.parameter_choice import choose
from elastid.fit.solve.solvers import solve


def test_steps_within_limits_are_those_of_bounded_least_squares() -> None:
    """To 1e-8 of the largest, of 200 problems in which between none and all of up to seven limits hold."""
    rng = np.random.default_rng(0)
    held = set()
    for _ in range(200):
        n = int(rng.integers(1, 8))
        A, b = rng.standard_normal((n + 2, n)), rng.standard_normal(n + 2)
        limits = np.array([-rng.uniform(0, 0.5, n), rng.uniform(0, 0.5, n)])
        found = least_within(A.T @ A, A.T @ b, limits)
        wanted = lsq_linear(A, -b, limits, method="bvls", tol=1e-14).x
        np.testing.assert_allclose(found, wanted, atol=1e-8)
        held.add(int(np.sum((found == limits[0]) | (found == limits[1]))))
    assert {0, 1, 2, 3} <= held


def skew(least: float, T: float) -> float:
    return float((T - least) ** 2 * np.exp(0.3 * T))


def test_the_least_of_a_function_is_found_to_a_thousandth_of_the_way() -> None:
    """Of a skew one, wherever in the interval or at its ends it is least."""
    for least in (-0.2, 0.0, 0.11, 0.5, 0.83, 1.0, 1.3):
        found = least_between(partial(skew, least), 0.0, 1.0, 13)
        assert abs(found - np.clip(least, 0.0, 1.0)) < (1e-3 if 0 < least < 1 else 5e-3)


def test_logs_that_own_parameters_describe_no_better_are_not_parted(monkeypatch: pytest.MonkeyPatch) -> None:
    """A reference recorded as current is as wrong in each configuration: no step is taken without any of them."""
    case = FAULTS["reference recorded as current"](true_case())
    responses = drawn(case, np.random.default_rng(0))
    parameters = choose(SPEC, case.robot, [one.configuration.name for one in responses])
    fit = Assembly.of(responses, case.robot, SPEC, parameters).at(parameters.x, "complex")
    end = solve(fit.problem, parameters.x, 0.1)
    alone, tried = costs_alone(fit, end.x), list[int]()

    def settled(*_: object) -> tuple[float, np.ndarray]:
        tried.append(1)
        return np.inf, end.x

    monkeypatch.setattr(unlike_configurations, "settled", settled)
    assert alone is not None
    assert find_two_groups(fit, end.x, alone, end.cost, 0.0, {}) == ()
    assert find_foreign_configurations(fit, end.x, alone) == ()
    assert not tried
    assert find_foreign_configurations(fit, end.x) == ()
    assert len(tried) == 2 * len(responses)
