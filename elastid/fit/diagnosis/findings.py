"""Status and findings of a fit: bounds, undetermined and correlated parameters, missed optima, model error."""

from __future__ import annotations

import math

import numpy as np

from elastid.base.arrays import BoolArray, FloatArray
from elastid.base.note import Note
from elastid.fit.result import FitResult, Status
from elastid.fit.solve.local_optimum import LocalOptimum
from elastid.parameters import ParameterSet

# An interval wider than the first factor is weakly determined, than the second not constrained at all.
MAX_INTERVAL_FACTOR = 10.0
UNCONSTRAINED_FACTOR = 1e6
MAX_CORRELATION = 0.99
# A smaller singular value, as a share of the largest, is noted with the parameters that have a larger part in it.
MIN_SINGULAR_VALUE = 1e-3
MIN_PART_OF_DIRECTION = 0.2
# x within this share of its range from a bound is at it.
NEAR_BOUND = 1e-4
# A bound that holds a parameter in a larger share of the starts is noted.
MAX_HELD_SHARE = 0.5
# Residuals over what the noise explains beyond which the model is in error.
MAX_MODEL_ERROR = 1.5
# A model that explains less of what was measured does not describe the robot, unless small residuals alone are far
# beyond a still smaller noise.
MIN_EXPLAINED_SHARE = 0.5


def at_bound(parameters: ParameterSet, x: FloatArray) -> BoolArray:
    """Which free parameters (n_x,) ended at a bound."""
    lower, upper = parameters.x_bounds
    reach = NEAR_BOUND * np.where(np.isfinite(upper - lower), upper - lower, 1.0)
    return np.asarray((x - lower < reach) | (upper - x < reach))


def status_and_message(
    result: FitResult,
    end: LocalOptimum,
    unreached: BoolArray,
    explained: float,
    noise_is_known: bool = True,
    misread: bool = False,
    misfit: str = "",
) -> tuple[Status, str]:
    """The worst status that applies, and a sentence with the numbers.

    explained: the share of the measured responses, known noise aside, that the model explains.  misread: whether it
    would explain them far better if they were read another way.  misfit: how it is wrong (`describe_misfit`), if it is.
    """
    free = result.parameters.free_names
    fit = (
        f"V = {result.cost:.5g} for {result.dof} degrees of freedom; {result.hits} of {len(result.starts)} starts "
        f"reached it; {_beside_noise(result)}"
    )
    share = f"{100 * max(explained, 0.0):.0f} %"
    if misread:
        return "model_error", (
            f"the model does not describe the responses as they were read: it explains {share} of them, and another "
            f"reading of them far more (see the first warning); {fit}"
        )
    if explained < MIN_EXPLAINED_SHARE and (result.model_error > MAX_MODEL_ERROR or not noise_is_known):
        far = "" if end.converged else f" (and the fit did not converge: {end.message})"
        return "model_error", (
            f"the model does not describe the robot: it explains {share} of the measured response{far}; check signs, "
            f"units and places of the channels, gear ratios, bounds, and what is known of the robot; {fit}"
        )
    if not end.converged:
        return "not_converged", f"not converged ({end.message}); {fit}"
    if unreached.any():
        names = _listed(free, unreached)
        return "ill_conditioned", f"the data do not determine a combination of {names}; {fit}"
    held = f" with {_listed(free, result.at_bound)} at a bound" if result.at_bound.any() else ""
    if misfit:
        return "misfit", f"converged{held}, but {misfit}; {fit}"
    good: Status = "converged" if result.noise_is_known else "noise_unknown"
    return ("at_bound" if held else good), f"converged{held}; {fit}"


def _beside_noise(result: FitResult) -> str:
    """The residuals beside the noise, and whether chance explains the difference."""
    if not result.noise_is_known:
        return "the noise is unknown, so that the residuals cannot be judged and the intervals come from them alone"
    times = math.sqrt(result.cost / max(result.cost_expected, 1e-300))
    more = "more than" if result.exceeds_noise else "no more than"
    return (
        f"the residuals are {times:.3g} times what the noise explains, {more} chance allows (beyond it once in "
        "700 fits of a true model)"
    )


def findings(result: FitResult, unreached: BoolArray) -> tuple[Note, ...]:
    """Warnings about bounds, undetermined and weakly determined parameters, correlations, hit rate, model error."""
    return (
        *_bounds(result),
        *_held_starts(result),
        *_undetermined(result, unreached),
        *_weak(result, unreached),
        *_correlated(result),
        *_weakest(result),
        *_search(result),
    )


def _bounds(result: FitResult) -> list[Note]:
    sentences = []
    for parameter, x, held in zip(result.parameters.free, result.x, result.at_bound, strict=True):
        if held:
            low = x - parameter.to_x(parameter.lower) < parameter.to_x(parameter.upper) - x
            side, value = ("lower", parameter.lower) if low else ("upper", parameter.upper)
            sentences.append(
                Note(
                    "at-bound",
                    f"{parameter.name} ended at its {side} bound of {value:.4g} {parameter.unit}: widen the bound if "
                    "values beyond it are plausible; otherwise the model lacks something that the data show",
                )
            )
    return sentences


def _held_starts(result: FitResult) -> list[Note]:
    """Bounds at which most starts ended, the best one not among them."""
    ends = [start.x for start in result.starts if math.isfinite(start.cost)]
    if len(ends) < 3:
        return []
    share = np.mean([at_bound(result.parameters, x) for x in ends], axis=0)
    return [
        Note(
            "bound-in-most-starts",
            f"{name} ended at a bound in {round(100 * one)} % of the starts: widen its bounds, or start it elsewhere",
        )
        for name, one, held in zip(result.parameters.free_names, share, result.at_bound, strict=True)
        if one > MAX_HELD_SHARE and not held
    ]


def _undetermined(result: FitResult, unreached: BoolArray) -> list[Note]:
    if not unreached.any():
        return []
    return [
        Note(
            "undetermined",
            f"{_listed(result.parameters.free_names, unreached)}: only some combination of them is determined "
            f"(smallest singular value {result.singular_values[-1]:.1e}, largest {result.singular_values[0]:.1e}); "
            "fix or tie one",
        )
    ]


def _weak(result: FitResult, unreached: BoolArray) -> list[Note]:
    sentences = []
    for parameter, beyond in zip(result.parameters.free, unreached, strict=True):
        if parameter.log and not beyond:
            low, high = result.interval(parameter.name)
            if not high < MAX_INTERVAL_FACTOR * low:
                interval = f"its 95 % interval is {low:.3g} to {high:.3g} {parameter.unit}"
                far = "the data barely constrain it" if not high < UNCONSTRAINED_FACTOR * low else interval
                sentences.append(Note("weakly-determined", f"{parameter.name} is weakly determined: {far}"))
    return sentences


def _correlated(result: FitResult) -> list[Note]:
    correlation, names = result.correlation, result.parameters.free_names
    pairs = [
        (i, j) for i, j in zip(*np.triu_indices(len(names), 1), strict=True) if abs(correlation[i, j]) > MAX_CORRELATION
    ]
    return [
        Note(
            "correlated",
            f"{names[i]} and {names[j]} cannot be distinguished (correlation {correlation[i, j]:.4f})",
        )
        for i, j in pairs
    ]


def _weakest(result: FitResult) -> list[Note]:
    """The least determined combination, where the others are determined far better."""
    values = result.singular_values
    if (
        not len(result.weakest)
        or len(values) < 2
        or values[-1] > MIN_SINGULAR_VALUE * values[0]
        or values[-1] < 1e-8 * values[0]
    ):
        return []
    places = [i for i in np.argsort(-np.abs(result.weakest)) if abs(result.weakest[i]) > MIN_PART_OF_DIRECTION]
    names = result.parameters.free_names
    terms = " ".join(f"{result.weakest[i]:+.2f} {names[i]}" for i in places)
    return [
        Note(
            "weakest-combination",
            f"the combination {terms} (of relative effects) is the least determined: singular value "
            f"{values[-1] / values[0]:.1e} of the largest; measure where their effects differ, or tie them",
        )
    ]


def _search(result: FitResult) -> list[Note]:
    sentences = []
    lost = sum(not math.isfinite(start.cost) for start in result.starts)
    if lost:
        sentences.append(
            Note(
                "failed-starts",
                f"{lost} of {len(result.starts)} starts failed; the first with: "
                f"{next(start.message for start in result.starts if not math.isfinite(start.cost))}",
            )
        )
    if result.hits == 1 < len(result.starts) - lost:
        second = result.starts[1].cost
        sentences.append(
            Note(
                "one-hit",
                f"only 1 of {len(result.starts)} starts reached the best cost (V = {result.starts[0].cost:.5g}, the "
                f"next {second:.5g}): there may be a better optimum; raise fit.starts or lower fit.start_factor",
            )
        )
    if result.exceeds_noise and result.model_error > MAX_MODEL_ERROR and math.isfinite(result.model_error):
        sentences.append(
            Note(
                "model-error",
                f"the residuals are {result.model_error:.2f} times what the noise explains: the model lacks something; "
                "the intervals are widened, but not for errors that are alike at all lines",
            )
        )
    return sentences


def _listed(names: tuple[str, ...], chosen: BoolArray) -> str:
    return ", ".join(name for name, one in zip(names, chosen, strict=True) if one)
