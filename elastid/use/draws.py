"""Robots drawn from the posterior of a fit: correlated parameters, including numbers of the robot model."""

from dataclasses import dataclass, replace

import numpy as np

from elastid.base.arrays import FloatArray
from elastid.base.errors import FitError
from elastid.base.propagation import principal_axes
from elastid.fit.result import Result
from elastid.parameters import DELAY
from elastid.robot import Robot


@dataclass(frozen=True, eq=False)
class DrawnRobots:
    """N posterior samples: names (n_p,) of the parameters including the delay, values (N, n_p), SI, and robots.

    x (N, n_x + n_d): as in `EstimatedTheta`.  fixed: parameters without a finite variance, which keep their estimate.
    """

    names: tuple[str, ...]
    x: FloatArray
    values: FloatArray
    robots: tuple[Robot, ...]
    fixed: tuple[str, ...]


def draw_robots(result: Result, count: int, seed: int = 0, configuration: str = "") -> DrawnRobots:
    """Draw `count` robots from the normal distribution of x (`Result.covariance_of_prediction`), within its bounds.

    configuration: whose parameters are drawn.  FitError if nearly no sample is a physical robot.
    """
    covariance, exact = result.covariance_of_prediction, replace(result.nominal_robot, tolerances="exact")
    names = result.parameters.dependent_names(configuration)
    axes, rng = principal_axes(covariance), np.random.default_rng(seed)
    samples, values, robots, n_bad, factors = [], [], list[Robot](), 0, result.model_error_factors
    while len(robots) < count:
        x = result.x + rng.standard_normal(len(axes)) @ axes
        sizes = rng.standard_normal(len(factors))
        model_error_shift = sum((z * factor.effects for z, factor in zip(sizes, factors, strict=True)), 0.0 * x)
        x = np.clip(x + model_error_shift, *result.parameters.x_bounds)
        numbers = result.parameters.numbers(x, configuration)
        row = [numbers[name] for name in names]
        numbers.pop(DELAY, None)
        for size, factor in zip(sizes, factors, strict=True):
            members = [name for name in factor.members if name in numbers]
            numbers |= {name: factor.with_error(name, numbers[name], float(size)) for name in members}
        try:
            robots.append(exact.with_parameters(numbers))
        except ValueError:
            n_bad += 1
            # With more than 20 impossible samples for each possible one, the fit is too uncertain.
            if n_bad > 20 * (len(robots) + 10):
                raise FitError(
                    "fit/impossible-inertia",
                    f"{n_bad} of {n_bad + len(robots)} posterior samples have impossible inertias. Give masses and "
                    "inertias a prior, or fix them",
                ) from None
        else:
            values.append(row)
            samples.append(np.append(x - model_error_shift, sizes))
    fixed = [p.name for p, v in zip(result.parameters.free, np.diag(covariance), strict=True) if np.isinf(v)]
    return DrawnRobots(names, np.array(samples), np.array(values), tuple(robots), tuple(fixed))
