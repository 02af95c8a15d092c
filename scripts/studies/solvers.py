"""From how many starts does a solver reach the optimum, after how many evaluations, and what do intervals cost?

    python scripts/studies/solvers.py [--quick] [--starts 20] [--problem NAME ...] [--solver NAME ...] [--seed 1]

Every plant is measured with 2 % of noise and solved from the same starts by each solver as `elastid fit` does, the
logarithmic criterion first. `default`: starts that spread by a factor of 3 about the truth, dampings and frictions by
its square. `blind`: by up to a factor of 5 in stiffnesses and 10 in dampings and frictions. A start hits where V is
that of the optimum next to the truth within a tenth of what one standard deviation costs. An evaluation is cost,
gradient and normal matrix of all configurations, in both stages together; scipy's `least_squares` stacks residuals and
Jacobian instead and is here for comparison.

Then, for noise of 2 and 10 %: the evaluations of a whole search from 20 starts, those of its automatic intervals by
profile likelihood, and how far sqrt(V_p - V) at their ends, by IPOPT in the other variables, is off its level.

Hits, evaluations (median / worst) and CPU seconds of 20 starts:

                        trust_region            ipopt                   least_squares
    three-mass default  17   20 / 37   0.18     13   27 / 62   0.60     16   22 / 69   0.22
               blind    16   23 / 38   0.20      9   30 / 57   0.57     15   26 / 191  0.27
    demo       default  20   12 / 17   0.70     20   16 / 25   1.28     20   16 / 22   1.48
               blind    20   14 / 19   0.86     20   22 / 29   1.74     20   19 / 33   1.67
    linkage    default  20   25 / 45   0.94     20   54 / 81   2.24     20   38 / 52   1.23
               blind    20   26 / 46   1.10     20   38 / 63   1.92     20   38 / 56   1.28
    six-axis   default  20   14 / 22   1.39     20   21 / 34   2.22     20   20 / 24   5.56
               blind    20   16 / 22   1.77     20   24 / 29   2.78     20   22 / 29   6.50

Intervals cost 3 to 22 % of the evaluations of their search, at 10 % of noise up to 31 %; at their ends sqrt(V_p - V) is
off by 0.22 % at most.
"""

# One BLAS thread must be asked for before NumPy is loaded.
# ruff: noqa: E402
import os

for variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ[variable] = "1"

import argparse
import json
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Literal, TypeAlias

import numpy as np
from scipy.optimize import least_squares
from study_plants import Plant, Rig, demo, of_study, six_axes, three_mass

from elastid.base.arrays import FloatArray
from elastid.base.errors import FitError
from elastid.base.statistics import QUANTILE_95
from elastid.fit.intervals import choose_profiles, profile_ends
from elastid.fit.problem.elastic import ElasticFit
from elastid.fit.problem.least_squares import Evaluation, LeastSquares
from elastid.fit.solve.solvers import (
    DAMPING_UNITS,
    FINE,
    MAX_HIT_EXCESS,
    NEAR,
    ROUGH_ITERATIONS,
    multistart,
    solve,
    spread,
)
from elastid.parameters import ParameterSet

Solver: TypeAlias = Literal["trust_region", "ipopt", "least_squares"]
SOLVERS: tuple[Solver, ...] = ("trust_region", "ipopt", "least_squares")
STIFFNESS, DAMPING = 5.0, 10.0
# What this study asserts of the trust region: evaluations from any default start of the six-axis fit; those of the
# intervals beside those of the search; the error of sqrt(V_p - V) at an end.
MAX_EVALUATIONS, MAX_INTERVAL_COST, MAX_RISE_ERROR = 25, 1.0, 0.01


def linkage() -> Plant:
    """The linkage arm that is shipped, on 40 lines."""
    return of_study(Path(__file__).parents[2] / "configs" / "linkage_arm.yml", "linkage", 40)


PLANTS: dict[str, Callable[[], Plant]] = {
    "three-mass": three_mass,
    "demo": demo,
    "linkage": linkage,
    "six-axis": six_axes,
}


@dataclass(frozen=True)
class Problem:
    """The two stages of a fit, and the optimum next to the truth."""

    first: ElasticFit
    last: ElasticFit
    x: FloatArray
    cost: float

    @classmethod
    def of(cls, plant: Plant, seed: int) -> "Problem":
        """With noise of this seed."""
        rig, x = Rig.of(plant), plant.parameters.x
        assembly = rig.assembly(rig.drawn(np.random.default_rng(seed)), plant.spec)
        last = assembly.at(x, "complex")
        best = solve(last.problem, x)
        return cls(assembly.at(x, "log"), last, best.x, best.cost)


def counted(problem: LeastSquares, calls: list[int]) -> LeastSquares:
    """The same; every evaluation adds one to calls."""

    def evaluate(x: FloatArray) -> Evaluation:
        calls.append(1)
        return problem.evaluate(x)

    return replace(problem, evaluate=evaluate)


def stages(problem: Problem, start: FloatArray, solver: Solver, calls: list[int]) -> float:
    """V at the end of both stages."""
    x = start
    for fit, tolerance, most in ((problem.first, NEAR, ROUGH_ITERATIONS), (problem.last, FINE, 200)):
        if solver == "least_squares":
            x, cost = by_scipy(fit, x, calls)
        else:
            end = solve(counted(fit.problem, calls), x, tolerance, most, solver)
            x, cost = end.x, end.cost
    return cost


def by_scipy(fit: ElasticFit, start: FloatArray, calls: list[int]) -> tuple[FloatArray, float]:
    """SciPy's trust-region reflective method; the Jacobian of a point is that of its residuals."""
    seen: dict[bytes, tuple[FloatArray, FloatArray]] = {}

    def at(x: FloatArray) -> tuple[FloatArray, FloatArray]:
        if x.tobytes() not in seen:
            calls.append(1)
            seen[x.tobytes()] = fit.residual(x)
        return seen[x.tobytes()]

    lower, upper = fit.parameters.x_bounds
    try:
        end = least_squares(lambda x: at(x)[0], start, lambda x: at(x)[1], (lower, upper), max_nfev=200)
    except (ValueError, np.linalg.LinAlgError) as error:
        raise FitError(str(error)) from None
    return end.x, 2 * end.cost


def blind(parameters: ParameterSet, starts: int, seed: int) -> FloatArray:
    """Starts (starts, n_x) that are off by up to a factor of 5 in stiffnesses and 10 in dampings and frictions."""
    reach = np.log([DAMPING if p.unit in DAMPING_UNITS else STIFFNESS for p in parameters.free])
    cube = np.random.default_rng(seed).uniform(-1, 1, (starts, len(reach)))
    return np.clip(parameters.x + cube * reach, *parameters.x_bounds)


def solved(problem: Problem, starts: FloatArray, solver: Solver) -> dict[str, float]:
    """Hits, evaluations and CPU seconds of a solver from all starts."""
    allowed = MAX_HIT_EXCESS * max(1.0, problem.cost / problem.last.problem.dof)
    found, begin = [], time.process_time()
    for start in starts:
        calls: list[int] = []
        try:
            cost = stages(problem, start, solver, calls)
        except FitError:
            cost = np.inf
        found.append((cost <= problem.cost + allowed, len(calls)))
    hits, evaluations = np.array(found).T
    return {
        "hits": int(hits.sum()),
        "starts": len(starts),
        "median": float(np.median(evaluations)),
        "worst": int(evaluations.max()),
        "cpu_s": round(time.process_time() - begin, 2),
    }


def held(problem: LeastSquares, place: int, value: float) -> LeastSquares:
    """The problem of the other variables."""
    rest = np.delete(np.arange(len(problem.parameters.free)), place)
    name = problem.parameters.free_names[place]
    fixed = (replace(p, free=False) if p.name == name else p for p in problem.parameters)

    def evaluate(x: FloatArray) -> Evaluation:
        there = problem.evaluate(np.insert(x, place, value))
        return Evaluation(there.cost, there.gradient[rest], there.hessian[np.ix_(rest, rest)])

    return replace(problem, parameters=ParameterSet(tuple(fixed)), evaluate=evaluate)


def intervals(plant: Plant, seed: int, starts: int) -> dict[str, Any]:
    """Evaluations of a search and of its automatic intervals, and the largest error of sqrt(V_p - V) at their ends."""
    problem = Problem.of(plant, seed)
    searched: list[int] = []
    drawn = spread(problem.last.parameters, starts, plant.spec.start_factor, seed)
    ranked, _ = multistart([counted(fit.problem, searched) for fit in (problem.first, problem.last)], drawn)
    calls: list[int] = []
    given, x = counted(problem.last.problem, calls), ranked[0].x
    variance = np.diag(np.linalg.pinv(problem.last.evaluate(x).hessian / 2, hermitian=True))
    names, _ = choose_profiles(given, x, variance)
    ends = profile_ends(given, x, variance, names)
    error = 0.0
    for place, row in enumerate(ends):
        for value in row[np.isfinite(row)]:
            lowest = solve(held(problem.last.problem, place, float(value)), np.delete(x, place), method="ipopt").cost
            error = max(error, abs(np.sqrt(lowest - ranked[0].cost) / QUANTILE_95 - 1))
    unbounded = int(np.isinf(ends).sum())
    return {
        "search": len(searched),
        "intervals": len(calls),
        "profiles": len(names),
        "unbounded_ends": unbounded,
        "rise_error": round(float(error), 5),
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--quick", action="store_true", help="a few starts of the smallest robot, to see that it runs")
    parser.add_argument("--starts", type=int, default=20)
    parser.add_argument("--problem", nargs="*", default=list(PLANTS), choices=list(PLANTS))
    parser.add_argument("--solver", nargs="*", default=list(SOLVERS), choices=list(SOLVERS))
    parser.add_argument("--seed", type=int, default=1)
    given = parser.parse_args()
    names, starts = (["three-mass"], 5) if given.quick else (given.problem, given.starts)
    results: dict[str, Any] = {}
    print(f"{'problem':<12}{'starts':<9}{'solver':<15}{'hits':>9}{'median':>8}{'worst':>7}{'CPU s':>8}")
    for name in names:
        problem = Problem.of(PLANTS[name](), given.seed)
        parameters = problem.last.parameters
        drawn = {
            "default": spread(parameters, starts + 1, 3.0, given.seed)[1:],
            "blind": blind(parameters, starts, given.seed),
        }
        for kind, x in drawn.items():
            for solver in given.solver:
                found = results[f"{name} {kind} {solver}"] = solved(problem, x, solver)
                hits = f"{found['hits']}/{found['starts']}"
                print(
                    f"{name:<12}{kind:<9}{solver:<15}{hits:>9}{found['median']:>8.0f}{found['worst']:>7}"
                    f"{found['cpu_s']:>8.2f}",
                    flush=True,
                )
    print(f"\n{'problem':<12}{'noise':<9}{'search':>9}{'intervals':>11}{'profiles':>10}{'error at ends':>15}")
    for name in names:
        for noise in (0.02, 0.1):
            found = intervals(replace(PLANTS[name](), noise=noise), given.seed, starts)
            results[f"{name} intervals {noise:g}"] = found
            print(
                f"{name:<12}{noise:<9.0%}{found['search']:>9}{found['intervals']:>11}{found['profiles']:>10}"
                f"{found['rise_error']:>15.2%}",
                flush=True,
            )
            assert found["rise_error"] < MAX_RISE_ERROR
            assert given.quick or found["intervals"] <= MAX_INTERVAL_COST * found["search"]
    check(results, names)
    print(json.dumps(results))


def check(results: dict[str, Any], names: list[str]) -> None:
    """The trust region needs few evaluations for six axes and misses no optimum that IPOPT finds, but by chance."""
    for name in names:
        for kind in ("default", "blind"):
            ours, theirs = (results.get(f"{name} {kind} {solver}") for solver in ("trust_region", "ipopt"))
            if ours and theirs:
                rate = theirs["hits"] / theirs["starts"]
                chance = 2 * np.sqrt(2 * theirs["starts"] * rate * (1 - rate))
                assert ours["hits"] >= theirs["hits"] - chance, (name, kind)
                assert ours["median"] <= theirs["median"], (name, kind)
    six = results.get("six-axis default trust_region")
    if six:
        assert six["hits"] == six["starts"]
        assert six["worst"] <= MAX_EVALUATIONS


if __name__ == "__main__":
    main()
