"""Prediction of V where responses are read otherwise: a reading changes those of the model, data and weights stay.

The model's response and its derivatives follow from one evaluation, and so does V of every reading after one
Gauss-Newton step.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import TypeAlias

import numpy as np

from elastid.base.arrays import BoolArray, ComplexArray, FloatArray
from elastid.base.execution import HERE
from elastid.fit.diagnosis.sensitivities import Evaluated
from elastid.fit.problem.elastic import ElasticFit, Part
from elastid.parameters import Parameters

Change: TypeAlias = Callable[[Evaluated, ComplexArray], ComplexArray]  # of arrays (..., F, n_y, n_u)

STEP_STD = 0.5  # of the prior of ln p that keeps a step near, and a stiffness near its start, at residuals of a misfit
LEAST_DECREASE = 1e-2  # of V from one step to the next, relative, below which they end


@dataclass(frozen=True, eq=False)
class Reading:
    """A way to read the responses: name, in words, family, and the change of the model's response.

    order: the configuration whose model each measured response is of, where postures are exchanged.
    """

    name: str
    family: str
    change: Change
    order: tuple[int, ...] = ()


@dataclass(frozen=True, eq=False)
class Prediction:
    """V with a reading before and after one step (n_x,)."""

    before: float
    cost: float
    step: FloatArray


AS_READ = Reading("as read", "", lambda _, values: values)


# Configurations that a judgement of all together takes; of more, every so many.
CONFIGURATIONS = 32


def spread_out(count: int) -> slice:
    """So many of a number of configurations, spread over all of them."""
    return slice(None, None, max(1, math.ceil(count / CONFIGURATIONS)))


def thinned(fit: ElasticFit, residuals: int = 8_000) -> ElasticFit:
    """The fit on every so many lines of each configuration, about so many real residuals in total.

    Without static load tests, which say nothing about readings of the responses.
    """
    return replace(fit, parts=tuple(map(thinning(fit, residuals), fit.parts)), loads=None, home=HERE)


def thinning(fit: ElasticFit, residuals: int) -> Callable[[Part], Part]:
    """Function from a part to every so many of its lines, about so many real residuals in total.

    At least 20 lines each, 5 of very many configurations: V of one by itself is judged, too.
    """
    every, least = max(1, math.ceil(fit.n_residuals / residuals)), max(5, min(20, 1280 // max(1, len(fit.parts))))
    return partial(_thin, every, least)


def _thin(every: int, least: int, part: Part) -> Part:
    lines = slice(None, None, min(every, max(1, len(part.measured) // least)))
    kernel = replace(part.kernel, freq_hz=part.kernel.freq_hz[lines])
    whitening = part.whitening and part.whitening.lines(lines)
    return replace(part, kernel=kernel, measured=part.measured[lines], gain=part.gain[lines], whitening=whitening)


def evaluate(fit: ElasticFit, x: FloatArray) -> list[Evaluated]:
    """Every configuration at x (n_x,), with derivatives to the free parameters alone."""
    evaluated = []
    for part in (part for part in fit.parts if part.n_residuals):
        G, slopes = part.kernel.evaluate(fit.theta(part, x))
        chain = fit.parameters.jacobian(x, part.configuration)[part.kernel.places]
        evaluated.append(Evaluated(part, part.mixing, G, np.tensordot(chain.T, slopes, axes=1)))
    return evaluated


def start_distance(parameters: Parameters, x: FloatArray) -> float:
    """-2 ln of the prior of stiffnesses that end at x (n_x,) about where the study starts them, as `ranking` has it."""
    asked = (i for i, p in enumerate(parameters.free) if not p.tolerated and p.log and p.stands_for.startswith("k_"))
    return sum(2 * math.log1p(((x[i] - parameters.x[i]) / STEP_STD) ** 2) for i in asked)


def squares(evaluated: Sequence[Evaluated]) -> list[float]:
    """V of each configuration."""
    return [float(e.residual @ e.residual) for e in evaluated]


def predict(
    reading: Reading, evaluated: Sequence[Evaluated], prior: FloatArray, free: BoolArray, std: float = STEP_STD
) -> Prediction:
    """V after one Gauss-Newton step of the free parameters (n_x,); prior (n_x,): 1 / s of theirs; std: as STEP_STD."""
    n_x = len(prior)
    A, b, V, count = np.diag(prior**2), np.zeros(n_x), 0.0, 0
    for i, measured in enumerate(evaluated):
        model = evaluated[reading.order[i]] if reading.order else measured
        changed = replace(measured, G=reading.change(measured, model.G))
        r, J = changed.residual, -changed.whitened(reading.change(measured, model.free)) * free[:, None]
        A, b, V, count = A + J @ J.T, b + J @ r, V + float(r @ r), count + measured.part.n_residuals
    near = V / max(count, 1) / std**2
    step = np.asarray(-np.linalg.solve(A + max(near, 1e-300) * np.eye(n_x), b), dtype=float)
    return Prediction(V, V + float(step @ (2 * b + A @ step)), step)


def settle(reading: Reading, fit: ElasticFit, x: FloatArray, free: BoolArray) -> tuple[float, FloatArray]:
    """V and x (n_x,) of an optimum that a few damped steps reach from x, of the logarithms first."""

    def predict_at(problem: ElasticFit, x: FloatArray, std: float) -> Prediction:
        return predict(reading, evaluate(problem, x), fit.prior_slopes, free, std)

    for problem in (replace(fit, parts=tuple(map(logarithmic, fit.parts))), fit):
        std, now = STEP_STD, predict_at(problem, x, STEP_STD)
        for _ in range(12):
            x_next = np.clip(x + now.step, *fit.parameters.x_bounds)
            further = predict_at(problem, x_next, std)
            if further.before < now.before:
                done = now.before - further.before < LEAST_DECREASE * now.before
                x, now, std = x_next, further, 4 * std
                if done:
                    break
            else:
                std /= 4
                now = predict_at(problem, x, std)
    return now.before, x


def logarithmic(part: Part) -> Part:
    """The part with the logarithmic criterion, element by element, no line with a weight above 10."""
    gain = np.minimum(part.gain * np.abs(part.measured), 10.0)
    return replace(part, criterion="log", gain=gain, whitening=None)
