"""Notes on an estimate: bounds, undetermined and correlated parameters, missed optima, model error."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from elastid.base.arrays import BoolArray, FloatArray
from elastid.base.note import Note
from elastid.fit.result import FitResult
from elastid.parameters import ParameterSet


@dataclass(frozen=True)
class Limits:
    """Thresholds of the notes on an estimate; false-alarm rates: not measured.

    near_bound: share of a range within which x is at its bound.  held_share: of the starts that end at a bound.
    interval_factor, unconstrained_factor: of the ends of an interval, beyond which a parameter is weakly determined, or
    not at all.  correlation: beyond which two parameters cannot be distinguished.  singular_value: the least, as a
    share of the largest; part_of_direction: of a parameter in its direction.  model_error: residuals over the noise.
    """

    near_bound: float = 1e-4
    held_share: float = 0.5
    interval_factor: float = 10.0
    unconstrained_factor: float = 1e6
    correlation: float = 0.99
    singular_value: float = 1e-3
    part_of_direction: float = 0.2
    model_error: float = 1.5


LIMITS = Limits()


def at_bound(parameters: ParameterSet, x: FloatArray) -> BoolArray:
    """True for each free parameter (n_x,) that ended at a bound."""
    lower, upper = parameters.x_bounds
    reach = LIMITS.near_bound * np.where(np.isfinite(upper - lower), upper - lower, 1.0)
    return np.asarray((x - lower < reach) | (upper - x < reach))


def estimate_notes(result: FitResult, unreached: BoolArray) -> tuple[Note, ...]:
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
    notes = []
    for parameter, x, held in zip(result.parameters.free, result.x, result.at_bound, strict=True):
        if held:
            low = x - parameter.to_x(parameter.lower) < parameter.to_x(parameter.upper) - x
            side, value = ("lower", parameter.lower) if low else ("upper", parameter.upper)
            text = (
                f"{parameter.name} ended at its {side} bound of {value:.4g} {parameter.unit}: widen the bound if values "
                "beyond it are plausible; otherwise the model lacks something that the data show"
            )
            notes.append(Note("at-bound", text))
    return notes


def _held_starts(result: FitResult) -> list[Note]:
    """Bounds at which most starts ended, the best one not among them."""
    ends = [start.x for start in result.starts if math.isfinite(start.cost)]
    if len(ends) < 3:
        return []
    share = np.mean([at_bound(result.parameters, x) for x in ends], axis=0)
    return [
        Note(
            "bound-in-most-starts",
            f"{name} ended at a bound in {round(100 * part)} % of the starts: widen its bounds, or start it elsewhere",
        )
        for name, part, held in zip(result.parameters.free_names, share, result.at_bound, strict=True)
        if part > LIMITS.held_share and not held
    ]


def _undetermined(result: FitResult, unreached: BoolArray) -> list[Note]:
    if not unreached.any():
        return []
    return [
        Note(
            "undetermined",
            f"{listed(result.parameters.free_names, unreached)}: only some combination of them is determined "
            f"(smallest singular value {result.singular_values[-1]:.1e}, largest {result.singular_values[0]:.1e}); "
            "fix or tie one",
        )
    ]


def _weak(result: FitResult, unreached: BoolArray) -> list[Note]:
    sentences = []
    for parameter, beyond in zip(result.parameters.free, unreached, strict=True):
        if parameter.log and not beyond:
            low, high = result.interval(parameter.name)
            if not high < LIMITS.interval_factor * low:
                interval = f"its 95 % interval is {low:.3g} to {high:.3g} {parameter.unit}"
                far = "the data barely constrain it" if not high < LIMITS.unconstrained_factor * low else interval
                sentences.append(Note("weakly-determined", f"{parameter.name} is weakly determined: {far}"))
    return sentences


def _correlated(result: FitResult) -> list[Note]:
    correlation, names = result.correlation, result.parameters.free_names
    return [
        Note("correlated", f"{names[i]} and {names[j]} cannot be distinguished (correlation {correlation[i, j]:.4f})")
        for i, j in zip(*np.triu_indices(len(names), 1), strict=True)
        if abs(correlation[i, j]) > LIMITS.correlation
    ]


def _weakest(result: FitResult) -> list[Note]:
    """The least determined combination, where the others are determined far better."""
    values = result.singular_values
    if (
        not len(result.weakest)
        or len(values) < 2
        or values[-1] > LIMITS.singular_value * values[0]
        or values[-1] < 1e-8 * values[0]
    ):
        return []
    places = [i for i in np.argsort(-np.abs(result.weakest)) if abs(result.weakest[i]) > LIMITS.part_of_direction]
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
    if result.exceeds_noise and result.model_error > LIMITS.model_error and math.isfinite(result.model_error):
        sentences.append(
            Note(
                "model-error",
                f"the residuals are {result.model_error:.2f} times what the noise explains: the model lacks something; "
                "the intervals are widened, but not for errors that are alike at all lines",
            )
        )
    return sentences


def listed(names: tuple[str, ...], chosen: BoolArray) -> str:
    """Names that are chosen, as a list in a sentence."""
    return ", ".join(name for name, is_chosen in zip(names, chosen, strict=True) if is_chosen)
