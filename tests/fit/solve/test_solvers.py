"""Two solvers with a Gauss-Newton Hessian, and many starts, on problems that know no robot."""

import math
import signal
from collections.abc import Callable
from dataclasses import replace

import casadi as ca
import numpy as np
import pytest
from plants.refusals import refused
from scipy.optimize import least_squares, lsq_linear

from elastid.base.arrays import FloatArray
from elastid.fit.problem.least_squares import Evaluation, LeastSquares
from elastid.fit.solve import solvers
from elastid.fit.solve.solvers import FINE, SHRINK, SolverName, _bounded_step, _next_radius, multistart, solve
from elastid.parameters import Parameter, Parameters

T = np.linspace(0, 1, 50)
DATA = 2 * np.exp(-3 * T) + 0.01 * np.random.default_rng(1).standard_normal(50)


def problem(parameters: Parameters, residual: Callable[[FloatArray], tuple[FloatArray, FloatArray]]) -> LeastSquares:
    def evaluate(x: FloatArray) -> Evaluation:
        r, J = residual(x)
        return Evaluation(float(r @ r), 2 * J.T @ r, 2 * J.T @ J)

    return LeastSquares(parameters, len(residual(parameters.x)[0]), evaluate)


def decayed(parameters: Parameters, x: FloatArray) -> tuple[FloatArray, FloatArray]:
    """The residuals of a exp(-b t) from DATA, whose noise is 0.01, and their slopes."""
    a, b = parameters.expand(x)
    model = a * np.exp(-b * T)
    slopes = np.column_stack([model / a, -T * model]) @ parameters.jacobian(x)
    return (model - DATA) / 0.01, slopes / 0.01


STARTS = Parameters(tuple(Parameter(name, x, lower=0.1, upper=100, log=True) for name, x in (("a", 1.0), ("b", 10.0))))
DECAY = problem(STARTS, lambda x: decayed(STARTS, x))

both_solvers = pytest.mark.parametrize("method", ["trust_region", "ipopt"])


@both_solvers
def test_the_optimum_is_that_of_an_independent_solver(method: SolverName):
    """SciPy's least_squares ends at the same place, to far below a standard deviation."""
    end = solve(DECAY, DECAY.parameters.x, method=method)
    reference = least_squares(lambda x: decayed(STARTS, x)[0], end.x_start, xtol=1e-14, ftol=1e-14, gtol=1e-14)
    std = np.sqrt(np.diag(np.linalg.inv(reference.jac.T @ reference.jac)))
    assert end.converged
    assert np.all(np.abs(end.x - reference.x) < 2 * FINE * std)
    assert end.cost == pytest.approx(2 * reference.cost, rel=1e-6)


@both_solvers
@pytest.mark.parametrize("seed", range(70, 80))
def test_many_bounds_hold_at_once_and_the_rest_is_optimal(seed: int, method: SolverName):
    """Linear problems of eight correlated variables between -1 and 1: V is that of a solver for such problems."""
    rng = np.random.default_rng(seed)
    A = rng.standard_normal((12, 8)) * 10 ** rng.uniform(-1.5, 1.5, 8) @ (np.eye(8) + rng.standard_normal((8, 8)))
    b = 30 * np.abs(A).max() * rng.standard_normal(12)
    parameters = Parameters(tuple(Parameter(f"p{i}", 0.1, lower=-1, upper=1) for i in range(8)))
    end = solve(problem(parameters, lambda x: (A @ x - b, A)), parameters.x, method=method)
    reference = lsq_linear(A, b, (-1, 1), method="bvls", tol=1e-12)
    assert end.converged
    assert end.cost == pytest.approx(2 * reference.cost, rel=1e-6)
    assert np.sum(np.abs(end.x) > 1 - 1e-6) >= 4


@both_solvers
def test_variables_of_very_different_size_are_solved_alike(method: SolverName):
    """A delay of 1e-4 s and a gain of 1e6, both linear, both from far off."""
    parameters = Parameters((Parameter("gain", 1e5, lower=0, upper=1e7), Parameter("delay", 5e-3, lower=0, upper=1e-2)))
    w = np.linspace(10, 300, 40)

    def residual(x: FloatArray) -> tuple[FloatArray, FloatArray]:
        gain, delay = x
        e, dg = 1e6 * np.exp(-1e-4j * w) - gain * np.exp(-1j * w * delay), -np.exp(-1j * w * delay)
        rows = np.column_stack([e, dg, -1j * w * gain * dg])
        stacked = np.vstack([rows.real, rows.imag]) / 100
        return stacked[:, 0], stacked[:, 1:]

    end = solve(problem(parameters, residual), parameters.x, method=method)
    assert end.converged
    np.testing.assert_allclose(end.x, [1e6, 1e-4], rtol=1e-6)


def failed() -> None:
    raise ZeroDivisionError("of the model")


@both_solvers
@pytest.mark.usefixtures("ctrl_c")
@pytest.mark.parametrize(
    ("fail", "error"), [(failed, ZeroDivisionError), (lambda: signal.raise_signal(signal.SIGINT), KeyboardInterrupt)]
)
def test_an_error_in_the_problem_is_raised_as_it_is(method: SolverName, fail: Callable[[], None], error: type) -> None:
    """CasADi would swallow it, and Ctrl-C, and return a wrong x; nothing is evaluated after it."""
    calls = []

    def evaluate(x: FloatArray) -> Evaluation:
        calls.append(x)
        if len(calls) == 4:
            fail()
        return DECAY.evaluate(x)

    with pytest.raises(error):
        solve(replace(DECAY, evaluate=evaluate), DECAY.parameters.x, method=method)
    assert len(calls) == 4


def test_ctrl_c_inside_ipopt_stops_the_solve(monkeypatch):
    """IPOPT then returns a status and an x that is no solution."""

    class Interrupted:
        def __call__(self, **_: object) -> dict[str, object]:
            return {"x": np.zeros(2)}

        def stats(self) -> dict[str, object]:
            return {"return_status": "NonIpopt_Exception_Thrown", "iter_count": 1}

    monkeypatch.setattr(ca, "nlpsol", lambda *_: Interrupted())
    with pytest.raises(KeyboardInterrupt):
        solve(DECAY, DECAY.parameters.x, method="ipopt")


@both_solvers
def test_a_model_without_a_value_is_stepped_around(method: SolverName):
    """Where the cost is not finite on the way, the step is shortened; at the start it is an error."""

    def evaluate(x: FloatArray) -> Evaluation:
        here = DECAY.evaluate(x)
        return here if x[1] > math.log(2.5) else replace(here, cost=math.nan)

    gappy = replace(DECAY, evaluate=evaluate)
    ends = [solve(each, DECAY.parameters.x, method=method).x for each in (gappy, DECAY)]
    np.testing.assert_allclose(*ends, atol=1e-5)
    with refused("fit/no-start"):
        solve(gappy, np.array([0.0, math.log(2.0)]), method=method)


@both_solvers
def test_an_exhausted_solve_does_not_call_itself_converged(method: SolverName, capfd):
    """Two iterations are not enough, and IPOPT prints nothing."""
    assert not solve(DECAY, DECAY.parameters.x, max_iterations=2, method=method).converged
    assert capfd.readouterr() == ("", "")


def test_a_damping_that_hardly_acts_is_not_overshot():
    """r = p - 1 from p = 1e-4: a whole Gauss-Newton step in ln p would be to e^9999, or to its bound 1e8."""
    parameters = Parameters((Parameter("p", 1e-4, lower=1e-9, upper=1e8, log=True),))
    seen = []

    def residual(x: FloatArray) -> tuple[FloatArray, FloatArray]:
        p = parameters.expand(x)
        seen.append(p[0])
        return np.append(p - 1, 0.1), np.array([p, [0.0]])

    end = solve(problem(parameters, residual), parameters.x)
    assert end.converged
    assert math.exp(end.x[0]) == pytest.approx(1, abs=2 * FINE)
    assert max(seen) < 2
    assert len(seen) < 25


def test_starts_spread_evenly_within_their_factor_and_bounds():
    """The first is the given one; ln k fills its range in strata, a damping spreads over the factor squared."""
    parameters = Parameters(
        (
            Parameter("k", 100.0, "N*m/rad", 1.0, 1e4, log=True),
            Parameter("d", 1.0, "N*m*s/rad", 0.5, 1e4, log=True),
            Parameter("delay", 0.0, "s", 0.0, 1e-2),
            Parameter("c", 0.3, "m"),
            Parameter("d_rod", 1.0, "N*s/m", 0.5, 1e4, log=True),
        )
    )
    x = solvers.latin_hypercube(parameters, 41, 3.0, seed=5)
    np.testing.assert_array_equal(x[0], parameters.x)
    k = np.sort(np.exp(x[1:, 0])) / 100
    assert k[0] < 3**-0.9 < 3**0.9 < k[-1] < 3
    strata = np.floor((np.log(k) / math.log(3) + 1) / 2 * 40)
    np.testing.assert_array_equal(strata, np.arange(40))
    assert pytest.approx(np.exp(x[:, 1].min())) == 0.5
    assert 6 < np.exp(x[:, 1].max()) < 9
    assert 0 == x[:, 2].min() < x[:, 2].max() < 1e-3
    assert np.all(x[:, 3] == 0.3)
    assert 6 < np.exp(x[:, 4].max()) < 9
    np.testing.assert_array_equal(x, solvers.latin_hypercube(parameters, 41, 3.0, seed=5))
    assert not np.array_equal(x, solvers.latin_hypercube(parameters, 41, 3.0, seed=6))


def wavy() -> LeastSquares:
    """sin(w t) fitted over its frequency alone: an optimum at w = 20 and many beside it."""
    parameters = Parameters((Parameter("w", 20.0, lower=1.0, upper=100.0, log=True),))

    def residual(x: FloatArray) -> tuple[FloatArray, FloatArray]:
        w = parameters.expand(x)[0]
        return (np.sin(w * T) - np.sin(20 * T)) / 0.1, (w * T * np.cos(w * T) / 0.1)[:, None]

    return problem(parameters, residual)


def test_converged_starts_count_those_at_best_cost():
    """Starts in the valley of w = 20 are hits, others end in optima of their own."""
    starts = np.log([[20.0], [21.0], [19.0], [45.0], [70.0]])
    rank, hits = multistart([wavy()], starts)
    assert hits == 3
    assert [end.cost for end in rank] == sorted(end.cost for end in rank)
    assert math.exp(rank[0].x[0]) == pytest.approx(20)
    assert rank[3].cost > 10


def test_starts_that_lead_nowhere_are_survived_unless_all_do():
    """One start without a finite cost ends last; none with one is an error that says how it ended."""
    ordinary = wavy()

    def evaluate(x: FloatArray) -> Evaluation:
        here = ordinary.evaluate(x)
        return here if x[0] < math.log(50) else replace(here, cost=math.inf)

    gappy = replace(ordinary, evaluate=evaluate)
    rank, hits = multistart([gappy], np.log([[60.0], [21.0]]))
    assert hits == 1
    assert math.isinf(rank[-1].cost)
    with refused("fit/no-start"):
        multistart([gappy], np.log([[60.0]]))


def test_radius_after_failed_step_is_fraction_of_step() -> None:
    assert _next_radius(2.0, 0.5, -math.inf, 1.0, -1.0) == SHRINK[0] * 0.5


@pytest.mark.parametrize("seed", range(8))
def test_bounded_step_is_within_and_descends(seed: int) -> None:
    """It satisfies radius and bounds. Without bounds it is the Newton step, or the optimal step on the radius."""
    rng = np.random.default_rng(seed)
    A, b = rng.standard_normal((9, 5)), 3 * rng.standard_normal(5)
    hessian, metric, none = A.T @ A, np.diag(rng.uniform(0.5, 2, 5)), np.zeros(5, bool)
    room, radius = (-rng.uniform(0.05, 1, 5), rng.uniform(0.05, 1, 5)), rng.uniform(0.3, 1)
    step = _bounded_step(b, hessian, metric, room, none, radius)
    assert step @ metric @ step <= (1.1 * radius) ** 2
    assert np.all((room[0] <= step) & (step <= room[1]))
    assert b @ step + step @ hessian @ step / 2 < 0
    wide = (np.full(5, -np.inf), np.full(5, np.inf))
    np.testing.assert_allclose(_bounded_step(b, hessian, metric, wide, none, 1e3), np.linalg.solve(hessian, -b))
    at_radius = _bounded_step(b, hessian, metric, wide, none, radius)
    multipliers = -(b + hessian @ at_radius) / (metric @ at_radius)
    np.testing.assert_allclose(multipliers, multipliers.mean(), rtol=1e-2)
    assert at_radius @ metric @ at_radius == pytest.approx(radius**2, rel=0.2)
    fixed = np.arange(5) == 2
    assert _bounded_step(b, hessian, metric, wide, fixed, radius)[2] == 0
