"""Do the intervals hold the truth as often as they say? Simulated data sets of robots whose numbers are known.

    python scripts/studies/calibration.py [--quick] [--sets 1000] [--robot three-mass demo] [--noise 0.02] [--seed 0]
                                        [--jobs 2]

Exact responses, with noise whose outputs are correlated, fitted from the truth with the inverse covariance as
weights: the share of the 95 % intervals that hold the truth, the scatter of the estimates over the Cramer-Rao bound,
and the deviation that the fit states over the scatter. Then with a model that is wrong: a mode that it lacks, masses
2 % off, friction that another configuration does not have; without a floor and with a floor of 1 %. The last line is
one JSON object.
"""

import json
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import study_run
import numpy as np
from study_plants import NOISE, PLANTS, Plant, Rig, exact_responses, three_mass

from elastid.base.arrays import BoolArray, FloatArray
from elastid.base.execution import Execution
from elastid.base.statistics import QUANTILE_95
from elastid.fit.covariance import Uncertainty, estimate_uncertainty, inverse_information
from elastid.fit.frf_problem import RelinearisedOptimum, relinearise
from elastid.fit.intervals import choose_profiles, profile_likelihood
from elastid.fit.problem.least_squares import LocalOptimum
from elastid.fit.spec import WeightSpec
from elastid.response import Response

ROBOTS: dict[str, Callable[[], Plant]] = {"three-mass": three_mass, "demo": PLANTS["demo"]}
WRONG = ("hidden mode", "masses 2 % off", "friction")
RIGS: dict[str, Rig] = {}


@dataclass(frozen=True)
class DataSets:
    """Data sets of one plant, each drawn and fitted by its number: x - truth, the stated deviation, and whether the
    interval holds the truth (3, n_x)."""

    plant: Plant
    seed: int
    wrong: str = ""
    floor: float = 0.0

    @property
    def rig(self) -> Rig:
        """Rig of the plant, built once per process."""
        if self.plant.name not in RIGS:
            RIGS[self.plant.name] = Rig.of(self.plant)
        return RIGS[self.plant.name]

    def __call__(self, number: int) -> FloatArray:
        """Fit the data set of an index; NaN if the fit did not converge."""
        rng = np.random.default_rng([self.seed, number])
        spec = replace(self.plant.spec, weights=WeightSpec(model_error=self.floor))
        data = self.rig.draw(rng, _truth(self.rig, self.wrong, rng))
        assembly = self.rig.assembly(data, spec)
        x = self.plant.parameters.x
        optimum = relinearise(assembly, LocalOptimum(x, x, 0.0, 0, True, "the truth"), "complex")
        if not optimum.end.converged:
            return np.full((3, len(x)), np.nan)
        sure = estimate_uncertainty(optimum.fit, optimum.responses, optimum.weights, optimum.end.x)
        return np.array([optimum.end.x - x, np.sqrt(np.diag(sure.covariance)), _holds(optimum, sure, x)])

    def bound(self) -> FloatArray:
        """Return the Cramer-Rao bound of the stds of x (n_x,) at the true values."""
        data = self.rig.draw(np.random.default_rng(0))
        exact = [replace(noisy, G=exact.G) for noisy, exact in zip(data, self.rig.exact, strict=True)]
        assembly = self.rig.assembly(exact, self.plant.spec)
        information = assembly.at(self.plant.parameters.x, "complex").evaluate(self.plant.parameters.x).hessian / 2
        return np.linalg.norm(inverse_information(np.linalg.cholesky(information).T)[0], axis=0)


def _holds(optimum: RelinearisedOptimum, sure: Uncertainty, x: FloatArray) -> BoolArray:
    """Return flags (n_x,) of the intervals that contain x: by profile likelihood if V is not quadratic."""
    problem, there, variance = optimum.fit.problem, optimum.end.x, np.diag(sure.covariance)
    names, _ = choose_profiles(problem.parameters, variance)
    low, high = profile_likelihood(problem, there, variance, names).T
    reach = QUANTILE_95 * np.sqrt(variance)
    return np.where(np.isnan(low), np.abs(there - x) < reach, (low < x) & (x < high))


def _truth(rig: Rig, wrong: str, rng: np.random.Generator) -> tuple[Response, ...]:
    """Return exact responses of a robot with a random model error."""
    robot, freq_hz = rig.plant.robot, rig.plant.freq_hz
    if wrong == "hidden mode":
        place = float(np.exp(rng.uniform(np.log(freq_hz[0]), np.log(freq_hz[-1]))))
        r = 1j * freq_hz / place
        factor = 1 + 0.03 * r**2 / (1 + 0.06 * r + r**2)
        return tuple(replace(response, G=response.G * factor[:, None, None]) for response in rig.exact)
    if wrong == "masses 2 % off":
        heavy = [name for name in robot.parameters() if name.startswith(("m_", "I_"))]
        # A body keeps its shape: mass and inertia change together.
        scale = {body.name: 1 + 0.02 * rng.choice([-1, 1]) for body in robot.bodies}
        values = {n: robot.parameters()[n][0] * scale[n.split("_")[1]] for n in heavy if n.split("_")[1] in scale}
        return tuple(exact_responses(rig.plant, robot.with_parameters(values), linearisation=rig.linearisation))
    if wrong == "friction":
        # Coulomb friction looks viscous to a multisine, in each configuration by another amount.
        viscous, responses = {n: v for n, (v, _) in robot.parameters().items() if n.startswith("fm_")}, []
        for i in range(len(rig.exact)):
            other = robot.with_parameters({name: value * float(rng.uniform(1, 3)) for name, value in viscous.items()})
            responses.append(exact_responses(rig.plant, other, linearisation=rig.linearisation)[i])
        return tuple(responses)
    return rig.exact


def calibrate(sets: DataSets, n_sets: int, jobs: int) -> dict[str, Any]:
    """Return coverage, scatter and stated std of each free parameter over n_sets data sets."""
    rows = np.array(Execution(jobs).ordered(sets, range(n_sets)))
    good = np.isfinite(rows).all(axis=(1, 2))
    error, stated, holds = rows[good].swapaxes(0, 1)
    scatter, bound = np.sqrt(np.mean(error**2, axis=0)), sets.bound()
    return {
        "sets": int(good.sum()),
        "failed": int(np.sum(~good)),
        "coverage": float(holds.mean()),
        "coverage_by_parameter": holds.mean(axis=0).round(4).tolist(),
        "scatter_over_bound": (scatter / bound).round(4).tolist(),
        "stated_over_bound": (np.sqrt(np.mean(stated**2, axis=0)) / bound).round(4).tolist(),
    }


def main() -> None:
    quick = "few data sets of the smallest robot, to see that it runs"
    options = study_run.options(__doc__, quick, sets=1000, robot=tuple(ROBOTS), noise=NOISE, seed=0, jobs=2)
    n_sets, jobs = (40, 1) if options.quick else (options.sets, options.jobs)
    names = ["three-mass"] if options.quick else options.robot
    plants = [replace(ROBOTS[name](), noise=options.noise) for name in names]
    results = {plant.name: calibrate(DataSets(plant, options.seed), n_sets, jobs) for plant in plants}
    wrong: dict[str, dict[str, Any]] = {}
    for plant in plants:
        for what in WRONG[:1] if options.quick else WRONG:
            for floor in (0.0, 0.01):
                sets = DataSets(plant, options.seed + 1, what, floor)
                wrong[f"{plant.name}: {what}, floor {floor:g}"] = calibrate(sets, max(20, n_sets // 10), jobs)
    print(json.dumps({"calibration": results, "wrong_model": wrong}))


if __name__ == "__main__":
    main()
