"""A reading of the responses as a change of those of the model, and V after a step, or some steps, with it.

The response of the model and its derivatives are known from one evaluation, and so is V of every reading after one
Gauss-Newton step; data and weights stay as they are.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import TypeAlias

import numpy as np

from elastid.base.arrays import BoolArray, ComplexArray, FloatArray
from elastid.fit.diagnosis.modification.sensitivities import Evaluated
from elastid.fit.problem.elastic import ElasticFit, Part

# Of arrays (..., F, n_y, n_u) of one configuration.
Change: TypeAlias = Callable[[Evaluated, ComplexArray], ComplexArray]

# Real residuals that are looked at, and lines that a configuration keeps.
MAX_RESIDUALS = 8_000
MIN_LINES = 20
# Standard deviation of the prior of ln p that keeps a step near, for residuals of the size of the misfit.
STEP_STD = 0.5
# Of `settled`: steps of each criterion, the factor of that width after a good step, the relative decrease that ends it,
# and the weight of a line at most.
MAX_STEPS = 12
GROWTH = 4.0
MIN_DECREASE = 1e-2
MAX_LOG_GAIN = 10.0


@dataclass(frozen=True, eq=False)
class Reading:
    """name, in words, and group.  change: of the model's response.

    order: which configuration's model each measured response is of, where postures are exchanged.
    """

    name: str
    group: str
    change: Change
    order: tuple[int, ...] = ()


@dataclass(frozen=True, eq=False)
class Read:
    """A reading with V before and after one step, and the step (n_x,)."""

    reading: Reading
    before: float
    cost: float
    step: FloatArray


def thinned(fit: ElasticFit, residuals: int = MAX_RESIDUALS) -> ElasticFit:
    """The fit on every so many lines of each configuration, about so many real residuals of all."""
    every = max(1, math.ceil(fit.n_residuals / residuals))

    def thin(part: Part) -> Part:
        keep = slice(None, None, min(every, max(1, len(part.measured) // MIN_LINES)))
        kernel = replace(part.kernel, freq_hz=part.kernel.freq_hz[keep])
        whitening = part.whitening and part.whitening.lines(keep)
        return replace(part, kernel=kernel, measured=part.measured[keep], gain=part.gain[keep], whitening=whitening)

    return replace(fit, parts=tuple(thin(part) for part in fit.parts))


def evaluated_at(fit: ElasticFit, x: FloatArray) -> list[Evaluated]:
    """Every configuration at x (n_x,), with derivatives to the free parameters alone."""
    found = []
    for part in fit.parts:
        if part.n_residuals:
            G, slopes = part.kernel.evaluate(fit.theta(part, x))
            chain = fit.parameters.jacobian(x, part.configuration)[part.kernel.places]
            found.append(Evaluated(part, part.mixing, G, np.tensordot(chain.T, slopes, axes=1)))
    return found


def read(
    reading: Reading, evaluated: Sequence[Evaluated], prior: FloatArray, free: BoolArray, std: float = STEP_STD
) -> Read:
    """V after one Gauss-Newton step of the free ones (n_x,); prior (n_x,): 1 / s of their priors.

    std: of a prior of ln p that keeps the step near, for residuals of the size of the misfit.
    """
    n_x = len(prior)
    A, b, V, count = np.diag(prior**2), np.zeros(n_x), 0.0, 0
    for i, one in enumerate(evaluated):
        other = evaluated[reading.order[i]] if reading.order else one
        at = replace(one, G=reading.change(one, other.G))
        r, J = at.residual, -at.whitened(reading.change(one, other.free)) * free[:, None]
        A, b, V, count = A + J @ J.T, b + J @ r, V + float(r @ r), count + one.part.n_residuals
    near = V / max(count, 1) / std**2
    step = np.asarray(-np.linalg.solve(A + max(near, 1e-300) * np.eye(n_x), b), dtype=float)
    return Read(reading, V, V + float(step @ (2 * b + A @ step)), step)


def settled(
    reading: Reading, fit: ElasticFit, x: FloatArray, free: BoolArray, decrease: float = MIN_DECREASE
) -> tuple[float, FloatArray]:
    """V and x (n_x,) of an optimum that a few damped steps reach from x, of the logarithms first.

    decrease: the relative decrease of V from one step to the next below which they end.
    """
    V = math.inf
    lower, upper = fit.parameters.x_bounds
    for problem in (replace(fit, parts=tuple(map(_logarithmic, fit.parts))), fit):
        std, now = STEP_STD, read(reading, evaluated_at(problem, x), fit.prior_slopes, free)
        for _ in range(MAX_STEPS):
            there = np.clip(x + now.step, lower, upper)
            further = read(reading, evaluated_at(problem, there), fit.prior_slopes, free, std)
            if further.before < now.before:
                done = now.before - further.before < decrease * now.before
                x, now, std = there, further, GROWTH * std
                if done:
                    break
            else:
                std /= GROWTH
                now = read(reading, evaluated_at(problem, x), fit.prior_slopes, free, std)
        V = now.before
    return V, x


def _logarithmic(part: Part) -> Part:
    """The same with the logarithmic criterion, element by element."""
    gain = np.minimum(part.gain * np.abs(part.measured), MAX_LOG_GAIN)
    return replace(part, criterion="log", gain=gain, whitening=None)


def as_read() -> Reading:
    """As the responses were read."""
    return Reading("as read", "", lambda _, values: values)
