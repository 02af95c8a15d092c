"""Notes on an estimate: bounds, identifiability, correlations, starts, and configurations that differ."""

import math
from collections.abc import Iterator

import numpy as np

from elastid.base.arrays import BoolArray, FloatArray
from elastid.base.display import capitalise
from elastid.base.errors import Note
from elastid.base.names import posture_of
from elastid.base.statistics import max_cost_ratio
from elastid.fit.combinations import conditional_covariance, correlated_combinations
from elastid.fit.diagnosis.hypothesis import Evidence
from elastid.fit.diagnosis.limits import LIMITS
from elastid.fit.result import Result
from elastid.fit.status_terms import UNCERTAIN
from elastid.parameters import Parameters

NEAR_BOUND = 1e-4  # fraction of the range within which x is at its bound


def at_bound(parameters: Parameters, x: FloatArray) -> BoolArray:
    """Return True for each free parameter (n_x,) that ended at a bound."""
    lower, upper = parameters.x_bounds
    margin = NEAR_BOUND * np.where(np.isfinite(upper - lower), upper - lower, 1.0)
    return (x - lower < margin) | (upper - x < margin)


def bound_notes(result: Result) -> Iterator[Note]:
    """Yield a note for each estimate at a bound."""
    for i in np.flatnonzero(result.at_bound):
        parameter, x = result.parameters.free[i], float(result.x[i])
        low = x - parameter.to_x(parameter.lower) < parameter.to_x(parameter.upper) - x
        side, value = ("lower", parameter.lower) if low else ("upper", parameter.upper)
        advice = (
            "This is far outside its tolerance: check its nominal value in the robot model"
            if parameter.is_nuisance
            else "Widen the bound; if the estimate then ends at the new bound, the data only show that it is small or "
            "large, or the model lacks an effect"
        )
        text = f"{parameter.name} ended at its {side} bound of {value:.4g} {parameter.unit}. {advice}"
        yield Note("fit/at-bound", text)


def estimate_notes(evidence: Evidence) -> tuple[Note, ...]:
    """Return warnings about bounds, unidentifiable and weakly identifiable parameters, correlations and starts."""
    result = evidence.result
    return (*bound_notes(result), *_determination(result, evidence.uncertainty.unidentifiable), *_search(result))


def find_disagreement(evidence: Evidence) -> tuple[Note, ...]:
    """Return a note on each configuration with far larger residuals than the others, if no cause explains them.

    All amplitudes of a posture count as one configuration, because nonlinear gears make amplitudes differ.
    """
    result = evidence.result
    # If V is barely above the noise, the residuals that remain with a cause can be chance.
    remaining_cost, by_chance = result.cost - evidence.best.drop, max_cost_ratio(result.cost_dof) * result.cost_expected
    best = evidence.best
    is_explained = best.explained_fraction >= LIMITS.sufficient_fraction or (best.drop and remaining_cost < by_chance)
    if is_explained or result.inflation_factor <= 1:
        return ()
    sums: dict[str, tuple[float, int]] = {}
    for frf, cost in zip(evidence.optimum.fit.frfs, evidence.uncertainty.costs.tolist(), strict=True):
        if frf.n_residuals:
            name = posture_of(frf.configuration)
            V, count = sums.get(name, (0.0, 0))
            sums[name] = V + cost, count + frf.n_residuals
    rms = np.sqrt([V / count for V, count in sums.values()])
    remedy, notes = "Check that robot, load and angles are as stated, or exclude its records", list[Note]()
    for name, ratio in zip(sums, rms / float(np.median(rms)), strict=True):
        if len(sums) > 2 and ratio > LIMITS.residual_ratio:
            text = f"residuals {ratio:.0f} times the residuals of the other configurations"
            notes.append(Note("fit/inconsistent-responses", text, f"configuration {name}", remedy=remedy))
    return tuple(notes)


def find_wrong_frequency_unit(evidence: Evidence) -> tuple[Note, ...]:
    r"""Return a note if all stiffnesses changed by (2 pi)^2, as with frequencies in rad/s instead of Hz or vice versa.

    An acceleration per torque is the same for K, D at omega and (2 pi)^2 K, 2 pi D at 2 pi omega: residuals do not show
    the error.
    """
    result = evidence.result
    sure = result.std_of_x < LIMITS.stiffness_std
    stiff = [i for i, p in enumerate(result.parameters.free) if p.log and p.unit in ("N*m/rad", "N/m") and sure[i]]
    # The same error makes stated damping and friction wrong, so that these are no independent cause.
    is_friction = evidence.cause is not None and evidence.cause.name.startswith(("f_", "fm_", "d_"))
    if not stiff or (evidence.best.explained_fraction > LIMITS.sufficient_fraction and not is_friction):
        return ()
    change = result.x[stiff] - result.parameters.x[stiff]
    typical = float(np.median(change))
    if np.any(np.abs(change - math.copysign(2 * math.log(2 * math.pi), typical)) > math.log(LIMITS.factor_spread)):
        return ()
    actual_unit, assumed_unit = ("rad/s", "Hz") if typical > 0 else ("Hz", "rad/s")
    text = f"all estimates are {math.exp(typical):.3g} times their start values; the cause is not identifiable"
    remedy = (
        f"Check: frequencies in {actual_unit} instead of {assumed_unit} (factor 39), positions in degrees (57), "
        "torques on the other side of the gear (ratio)"
    )
    place = ", ".join(result.parameters.free[i].name for i in stiff)
    return (Note("fit/frequency-unit", text, place, remedy=remedy),)


def _determination(result: Result, unidentifiable: BoolArray) -> Iterator[Note]:
    names, values = result.parameters.free_names, result.singular_values
    if unidentifiable.any():
        yield Note(
            "fit/not-identifiable",
            f"{join_names(names, unidentifiable)}: only a combination of them is identifiable (smallest singular "
            f"value {values[-1]:.1e}, largest {values[0]:.1e}). Fix or tie one of them",
        )
    of_interest = result.parameters.of_interest
    for parameter in (p for p, beyond in zip(of_interest, unidentifiable, strict=False) if p.log and not beyond):
        if is_weak(result, parameter.name):
            yield Note("fit/weakly-identifiable", UNCERTAIN, parameter.name, remedy="Do not use the estimate")
    # Conditional on the nuisance parameters, whose errors correlate all estimates.
    yield from correlated_combinations(names, conditional_covariance(result.covariance, len(of_interest)))


def is_weak(result: Result, name: str) -> bool:
    """Return True if the std of a logarithmic parameter exceeds the limit of a weakly identifiable one."""
    return not result.std[name] <= LIMITS.stiffness_std * result.values[name]


def _search(result: Result) -> Iterator[Note]:
    starts = result.starts
    if failures := [start.message for start in starts if not math.isfinite(start.cost)]:
        yield Note("fit/starts", f"{len(failures)} of {len(starts)} starts failed, the first with: {failures[0]}")
    if result.n_converged_starts == 1 < len(starts) - len(failures):
        yield Note(
            "fit/starts",
            f"only 1 of {len(starts)} starts reached the best optimum; the residuals of the next are "
            f"{math.sqrt(starts[1].cost / max(starts[0].cost, 1e-300)):.4g} times as large. To look for a better "
            "optimum, raise fit.starts or lower fit.start_factor",
        )


def contradictions(result: Result) -> tuple[Note, ...]:
    """Return warnings where load tests, or responses at the tool, contradict the responses of the motors."""
    sources = ("fit/loads", "static load tests", result.static), ("fit/tool", "responses at the tool", result.tool)
    return tuple(
        Note(
            code,
            f"{source} contradict the responses of the motors ({comparison.sentence})",
            remedy=f"{capitalise(comparison.cause)}. The estimates are from the motors alone",
        )
        for code, source, comparison in sources
        if comparison is not None and comparison.disagrees
    )


def join_names(names: tuple[str, ...], selection: BoolArray) -> str:
    """Return the selected names as a list for a sentence."""
    return ", ".join(name for name, is_chosen in zip(names, selection, strict=True) if is_chosen)
