"""Do fits reach the Cramer-Rao bound with weights from few realisations, and do V and verdicts say what they should?

    python scripts/studies/efficiency.py [--quick] [--sets 300] [--plant two-axes demo] [--noise torque]
                                         [--floor 0 0.001] [--seed 0] [--jobs 2]

Responses of known robots with noise of a known covariance, half of it on the outputs and half from torques at the
motors; the covariance of noise and of both noise and distortion are drawn as M realisations of P periods give them
(complex Wishart of M n_u (P - 1) and (M - 1) n_u degrees of freedom), and the parameters are fitted with the weights of
the product from the truth. The bound is that of the true covariance. One configuration is left out of each fit.

For each M and P, without a floor and with one: the scatter of the estimates over the bound (rms over the parameters),
the stated over the found standard deviation, the share of 95 % intervals that hold the truth, V over its expectation,
and how often a true model is said to leave more than the noise or coloured residuals, in the fitted configurations and
in the one left out, with a false alarm of 1 % each. The last line is one JSON object.

Two axes without a floor, 1000 data sets each: for M, P = 1, 2; 1, 5; 2, 2 the scatter is 1.024, 1.004 and 1.022 of the
bound, 95.1, 95.2 and 94.9 % of intervals hold the truth, and V is 1.000, 0.998 and 1.001 of its expectation. Of 1 %
asked for, `more than the noise` is said in 0.1 to 0.7 % of fits and 0.8 to 1.3 % of responses left out, `coloured` in
1.0 to 1.5 and 1.0 to 1.9 %. For 2, 5 and 4, 2
the scatter of 150 data sets is 1.013 and 1.039 of the bound, V 0.996 and 1.001 of its expectation; for 4, 5 that of
100 is 1.000 and V 0.998, with a floor of 0.001 V 0.996. These rates of `coloured` are those of its distribution with
two moments, 1.4 % in the mean; with the third one they were not drawn again at this size.
"""

# One BLAS thread must be asked for before NumPy is loaded.
# ruff: noqa: E402
import os

for variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ[variable] = "1"

import argparse
import json
import sys
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[2] / "tests"))
from plants.elastic_arm import arm
from study_plants import Plant, demo, responses

from elastid.base.arrays import ComplexArray, FloatArray
from elastid.base.execution import ordered
from elastid.base.statistics import QUANTILE_95
from elastid.fit.covariance import estimate_uncertainty, inverse_information
from elastid.fit.problem.elastic import elastic_fit, linear_model
from elastid.fit.problem.weights import weigh
from elastid.fit.spec import FitSpec, ParameterSpec, WeightSpec
from elastid.linear.fitted_model import response_shifts
from elastid.linear.linearise import Linearisation
from elastid.model.formulation import formulate
from elastid.record import Configuration
from elastid.response import Covariance, FrequencyResponse
from elastid.validation.agreement import agreement
from elastid.validation.residual_tests import FALSE_ALARM, exceeds_by_chance
from elastid.validation.results import are_white, noise_p

# Noise of a period relative to the median response, and the shares of it on the outputs and from torques.
NOISE = 0.01
KINDS = {"both": (1.0, 1.0), "outputs": (1.0, 1e-6), "torque": (1e-3, 1.0)}
CASES = ((1, 2), (1, 5), (2, 2), (2, 5), (4, 2), (4, 5))
MAX_SCATTER, MAX_OFF_EXPECTATION = 1.05, 0.02
COLUMNS = ("V / expected", "false alarms: noise", "colour", "noise, left out", "colour, left out")


def two_axes() -> Plant:
    """An arm of two driven elastic joints with two further elastic rotations, in four configurations."""
    angles = {"a": (0.0, 0.2), "b": (0.6, -0.7), "c": (-0.4, 0.9), "d": (1.0, 1.4)}
    spec = FitSpec(parameters={"k_*": ParameterSpec(), "d_*": ParameterSpec(), "fm_*": ParameterSpec()})
    configurations = tuple(Configuration(name, one) for name, one in angles.items())
    return Plant("two-axes", arm(), configurations, np.linspace(2, 50, 97), spec)


PLANTS: dict[str, Callable[[], Plant]] = {"two-axes": two_axes, "demo": demo}


@dataclass(frozen=True)
class Sets:
    """Data sets of one plant with M realisations of P periods: a number to a row of findings."""

    plant: str
    kind: str
    M: int
    P: int
    floor: float
    seed: int

    @cached_property
    def world(self) -> "World":
        """Built once in a process."""
        return world(self.plant, self.kind)

    def __call__(self, number: int) -> FloatArray:
        """x - truth and stated deviation (2 n_x), V / expected, then p of the verdicts as in COLUMNS."""
        w, rng = self.world, np.random.default_rng([self.seed, self.M, self.P, number])
        data = w.drawn(rng, self.M, self.P)
        spec = replace(w.plant.spec, weights=WeightSpec(floor=self.floor))
        weights = [weigh(one, spec) for one in data]
        fit = elastic_fit(data[:-1], w.models[:-1], weights[:-1], w.plant.parameters, "complex")
        truth = w.plant.parameters.x
        x = truth
        for _ in range(3):  # Gauss-Newton from the truth
            here = fit.evaluate(x)
            x = x - np.linalg.solve(here.hessian, here.gradient)
        sure = estimate_uncertainty(fit, data[:-1], weights[:-1], x)
        ratio = fit.evaluate(x).cost / sure.expected_cost
        every = elastic_fit(data, w.models, weights, w.plant.parameters, "complex").parts
        modelled = (part.kernel.response(fit.theta(part, x)) for part in every)
        pairs = [(one, replace(one, G=G)) for one, G in zip(data, modelled, strict=True)]
        shifts = response_shifts(w.models[-1], data[-1].freq_hz, w.plant.parameters, x, sure.covariance)
        fitted, left = [agreement(*pair) for pair in pairs[:-1]], [agreement(*pairs[-1], True, shifts)]
        found = [noise_p(fitted, exceeds_by_chance(ratio, sure.cost_dof)) < FALSE_ALARM, not are_white(fitted)]
        found += [noise_p(left) < FALSE_ALARM, not are_white(left)]
        return np.concatenate([x - truth, np.sqrt(np.diag(sure.covariance)), [ratio], found])


@dataclass(frozen=True, eq=False)
class World:
    """A plant, its exact responses with models, and the covariance C_V (F, n_y, n_y) of their errors in one period."""

    plant: Plant
    exact: tuple[FrequencyResponse, ...]
    models: tuple[Any, ...]
    error: tuple[ComplexArray, ...]

    def drawn(self, rng: np.random.Generator, M: int, P: int) -> list[FrequencyResponse]:
        """A data set: the mean over M n_u experiments of P periods, with the covariances that their scatter gives."""
        found = []
        for response, C in zip(self.exact, self.error, strict=True):
            F, _, n_u = response.G.shape
            left = np.broadcast_to(np.eye(n_u) / M, (F, n_u, n_u)).astype(complex)
            e = np.linalg.cholesky(C / (P * M)) @ _circular(rng, response.G.shape)
            noise = _kronecker(left / P, _wishart(rng, C, M * n_u * (P - 1)), M * n_u * (P - 1))
            total = _kronecker(left, _wishart(rng, C / P, (M - 1) * n_u), (M - 1) * n_u) if M > 1 else None
            found.append(replace(response, G=response.G + e, noise=noise, total=total))
        return found

    def bound(self, M: int, P: int) -> FloatArray:
        """The Cramer-Rao bound of x (n_x,) with the true covariance."""
        known = []
        for response, C in zip(self.exact[:-1], self.error, strict=False):
            F, _, n_u = response.G.shape
            left = np.broadcast_to(np.eye(n_u) / (M * P), (F, n_u, n_u)).astype(complex)
            known.append(replace(response, total=_kronecker(left, C, np.inf)))
        spec = replace(self.plant.spec, weights=WeightSpec(floor=0.0))
        weights = [weigh(one, spec) for one in known]
        fit = elastic_fit(known, self.models[:-1], weights, self.plant.parameters, "complex")
        _, J = fit.residual(self.plant.parameters.x)
        return np.linalg.norm(inverse_information(np.linalg.qr(J, mode="r"))[0], axis=0)


_WORLDS: dict[tuple[str, str], World] = {}


def world(name: str, kind: str) -> World:
    """The world of a plant, built once."""
    if (name, kind) not in _WORLDS:
        plant = PLANTS[name]()
        linearisation = Linearisation.of(formulate(plant.robot, plant.model))
        exact = responses(plant, linearisation, plant.robot)
        theta = [plant.parameters.expand(plant.parameters.x, one.configuration.name) for one in exact]
        models = tuple(linear_model(linearisation, one, at) for one, at in zip(exact, theta, strict=True))
        _WORLDS[name, kind] = World(plant, exact, models, tuple(_error(one, *KINDS[kind]) for one in exact))
    return _WORLDS[name, kind]


def _error(response: FrequencyResponse, outputs: float, torque: float) -> ComplexArray:
    """C_V: white noise on measured angles, and white noise of the torques that passes through the robot."""
    G, n_y = response.G, response.G.shape[1]
    angles = (response.freq_hz**4)[:, None, None] * np.eye(n_y)
    through = G @ np.swapaxes(G, 1, 2).conj()
    shapes = (angles / np.mean(np.einsum("faa->f", angles)), through / np.median(np.einsum("faa->f", through).real))
    level = NOISE**2 * n_y * np.median(np.abs(G) ** 2)
    return np.asarray(level * (outputs * shapes[0] + torque * shapes[1]), complex)


def _circular(rng: np.random.Generator, shape: tuple[int, ...]) -> ComplexArray:
    return np.asarray((rng.standard_normal(shape) + 1j * rng.standard_normal(shape)) / np.sqrt(2))


def _wishart(rng: np.random.Generator, C: ComplexArray, dof: int) -> ComplexArray:
    """Sample covariance (F, n, n) of dof draws."""
    z = np.linalg.cholesky(C) @ _circular(rng, (*C.shape[:2], dof))
    return np.asarray(z @ np.swapaxes(z, 1, 2).conj() / dof)


def _kronecker(left: ComplexArray, right: ComplexArray, dof: float) -> Covariance:
    variance = np.einsum("faa->fa", right).real[:, :, None] * np.einsum("faa->fa", left).real[:, None, :]
    return Covariance(variance, dof, left, right) if right.shape[1] <= dof else Covariance(variance, dof)


def measure(sets: Sets, count: int, jobs: int) -> dict[str, Any]:
    """The figures of one row over `count` data sets."""
    found = np.array(ordered(sets, list(range(count)), jobs))
    n_x = len(sets.world.plant.parameters.x)
    error, stated, rest = found[:, :n_x], found[:, n_x : 2 * n_x], found[:, 2 * n_x :]
    scatter = np.sqrt(np.mean(error**2, axis=0)) / sets.world.bound(sets.M, sets.P)
    relative = np.sqrt(np.mean(stated**2, axis=0)) / sets.world.bound(sets.M, sets.P)
    row = {
        "plant": sets.plant,
        "M": sets.M,
        "P": sets.P,
        "floor": sets.floor,
        "scatter / bound": float(np.sqrt(np.mean(scatter**2))),
        "stated / scatter": float(np.sqrt(np.mean(relative**2) / np.mean(scatter**2))),
        "coverage": float(np.mean(np.abs(error) < QUANTILE_95 * stated)),
    }
    return row | dict(zip(COLUMNS, rest.mean(axis=0).round(4).tolist(), strict=True))


def check(row: dict[str, Any], count: int) -> None:
    """The claims, each with three standard deviations of what the data sets can show."""
    scatter = 3 / np.sqrt(2 * count * 5)  # parameters are correlated: about five are independent
    if row["floor"] == 0:
        assert row["scatter / bound"] < MAX_SCATTER + scatter, row
        assert row["coverage"] > 0.95 - 3 * np.sqrt(0.95 * 0.05 / (5 * count)), row
    assert abs(row["V / expected"] - 1) < MAX_OFF_EXPECTATION + 3 * 0.05 / np.sqrt(count), row
    for name in COLUMNS[1:]:
        assert row[name] < FALSE_ALARM + 3 * np.sqrt(2 * FALSE_ALARM / count), row


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--quick", action="store_true", help="few data sets of one case, to see that it runs")
    parser.add_argument("--sets", type=int, default=300)
    parser.add_argument("--plant", nargs="*", default=list(PLANTS), choices=list(PLANTS))
    parser.add_argument("--noise", default="both", choices=list(KINDS))
    parser.add_argument("--floor", type=float, nargs="*", default=[0.0, 0.001])
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--jobs", type=int, default=2)
    given = parser.parse_args()
    count, jobs = (20, 1) if given.quick else (given.sets, given.jobs)
    plants, cases, floors = given.plant, CASES, given.floor
    if given.quick:
        plants, cases, floors = ["two-axes"], ((2, 2),), [0.0]
    print(
        f"{'plant':<9}{'M':>3}{'P':>3}{'floor':>7}{'scatter/bound':>15}{'stated/scatter':>16}{'coverage':>10}", end=""
    )
    print("".join(f"{name:>21}" for name in COLUMNS))
    rows = []
    for plant in plants:
        for floor in floors:
            for M, P in cases:
                row = measure(Sets(plant, given.noise, M, P, floor, given.seed), count, jobs)
                rows.append(row)
                print(
                    f"{plant:<9}{M:>3}{P:>3}{floor:>7g}{row['scatter / bound']:>15.3f}{row['stated / scatter']:>16.3f}"
                    f"{100 * row['coverage']:>8.1f} %{row[COLUMNS[0]]:>21.3f}"
                    + "".join(f"{100 * row[name]:>19.1f} %" for name in COLUMNS[1:]),
                    flush=True,
                )
    for row in rows:
        check(row, count)
    print(json.dumps({"sets": count, "rows": rows}))


if __name__ == "__main__":
    main()
