"""Status of a fit with its reason, and notes on the estimate: bounds, correlations, missed optima, model error.

misfit: a model that explains most of a response, but is wrong by more than its intervals.

By blocks of a configuration and a band, where three things hold at once: residuals exceed noise and distortion, V over
its expectation by `excess` and beyond what chance explains; they are structured, so that blocks disagree about the
parameters `disagreement` times as much as noise lets them, and `structure` times as much as white residuals of their
size would; and they matter, since the interval of a parameter by the scatter over blocks is `shift` times the one by
measured noise, ratios of gears and declared floor, and more than `size` of it.

By a number that the fit held, or a spring that the robot's file lacks, where all blocks may err equally or V is that of
the noise: a single number, or a common factor of several, whose freeing lowers V, in which the declared floor counts as
noise, by `drop`, and moves a parameter by `effect` of its standard deviations and by `size` of itself.

By a number that the data move beyond `LIMITS.prior` standard deviations of its prior or tolerance.

By static load tests, or responses at the tool, that contradict the responses of the motors (`static_and_tool_data`).

A damping that the responses do not show, or show as less than none, falls to zero, whose logarithm has no end: no
bound is wide enough there.
"""

import math
from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from elastid.base.arrays import BoolArray, FloatArray
from elastid.base.display import capital, percent
from elastid.base.errors import Note, notes_of
from elastid.base.names import matching, posture_of
from elastid.fit.covariance import Uncertainty
from elastid.fit.diagnosis.hypothesis import SCALE, Evidence, fault, phrase
from elastid.fit.diagnosis.limits import LIMITS
from elastid.fit.diagnosis.priors import (
    contradicted_priors,
    contradicted_tolerances,
    prior_moves,
)
from elastid.fit.result import (
    AT_BOUND,
    BIASED,
    BY_PRIOR,
    DISTORTED,
    GOOD,
    LARGE,
    UNCERTAIN,
    ModificationIndex,
    Result,
    Status,
    correlated,
    covariance_by_noise,
    largest_by_chance,
)
from elastid.fit.solve.solvers import DAMPING_UNITS
from elastid.fit.spec import USUAL_FLOOR
from elastid.parameters import Parameters
from elastid.response import UNEXPLAINED

NEAR_BOUND = 1e-4  # share of a range within which x is at its bound


def at_bound(parameters: Parameters, x: FloatArray) -> BoolArray:
    """True for each free parameter (n_x,) that ended at a bound."""
    lower, upper = parameters.x_bounds
    reach = NEAR_BOUND * np.where(np.isfinite(upper - lower), upper - lower, 1.0)
    return (x - lower < reach) | (upper - x < reach)


def bound_notes(result: Result) -> Iterator[Note]:
    """Notes on parameters that ended at a bound."""
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


def with_status(evidence: Evidence) -> Result:
    """The result with the worst status that applies, and a message: the verdict first, then the residual test."""
    result, end, unreached = evidence.result, evidence.optimum.end, evidence.uncertainty.unreached
    free = result.parameters.free_names
    starts = result.converged_starts
    held = f" with {listed(free, result.at_bound)} at a bound" if result.at_bound.any() else ""
    explained = f"the model explains {percent(max(evidence.explained, 0.0))} of the measured responses"

    def ended(status: Status, message: str) -> Result:
        return replace(result, status=status, message=f"{message}. {capital(result.residual_test)}; {starts}")

    misread = {SCALE, *(h.family for h in evidence.hypotheses if h.changes is not None)}
    readings = [index for index in result.indices if index.place and index.group in misread]
    if evidence.is_suspect and readings:
        return ended("model_error", f"{explained}. {capital(fault(readings[0], evidence))}")
    too_large = result.inflation_factor > LARGE or not result.noise_is_known
    if too_large and evidence.explained < LIMITS.half:
        return ended("model_error", f"{explained}. Check channels, gear ratios, bounds and the robot model")
    if not end.converged:
        return ended("not_converged", f"the search stopped before an optimum ({end.message})")
    if unreached.any():
        return ended("ill_conditioned", f"not identifiable: a combination of {listed(free, unreached)}")
    logarithmic = [p.name for p in result.parameters.asked if p.log]
    if logarithmic and all(_is_weak(result, name) for name in logarithmic):
        text = f"the std of every parameter is above {percent(LIMITS.stiffness_std)} of its estimate"
        return ended("ill_conditioned", f"{text}. Check the channels of each file, and the noise of the responses")
    result = replace(result, verdicts=_verdicts(evidence))
    by_blocks, cause = _by_blocks(evidence), evidence.cause
    if by_blocks and cause is not None and cause.explained_fraction >= LIMITS.reason_share:
        by_blocks = f"{fault(cause, evidence)}. {capital(by_blocks)}"
    misfit = _by_held_number(evidence) or _beyond_declared(evidence)
    # The intervals include ratios that differ from angle to angle.
    if not evidence.uncertainty.ratios.explains:
        contradicted = _by_prior(evidence) or next((note.text for note in contradictions(result)), "")
        misfit = by_blocks or misfit or contradicted
    if misfit:
        return ended("misfit", f"{misfit}{held and f'. The fit ended{held}'}")
    biased = [name for name, verdict in zip(free, result.verdicts, strict=False) if verdict.startswith(BIASED)]
    but = f", but {', '.join(biased)} biased" if biased else ""
    good: Status = "converged" if result.noise_is_known else "noise_unknown"
    return ended("at_bound" if held else good, f"converged{held}{but}")


def _verdicts(evidence: Evidence) -> tuple[str, ...]:
    """Verdict on each parameter asked for: good, uncertain, dominated by the prior, at its bound, or biased and why."""
    result, n = evidence.result, len(evidence.result.parameters.asked)
    index = decisive_index(result, evidence.uncertainty, result.indices)
    by_index = np.zeros(n) if index is None else _in_deviations(index.effects, result)
    by_blocks = _shifts(evidence) if _blocks_disagree(evidence) else np.zeros(n)
    std, prior = result.std, result.std_prior
    is_distorted = any(note.code == UNEXPLAINED for note in notes_of(evidence.assembly.responses))
    verdicts = []
    for i, parameter in enumerate(result.parameters.asked):
        if result.at_bound[i]:
            verdicts.append(AT_BOUND)
        elif index is not None and by_index[i] > LIMITS.shift:
            verdicts.append(f"{BIASED}: {phrase(index, evidence)} would change it by {by_index[i]:.1f} std")
        elif is_distorted and parameter.name.startswith("d_"):
            verdicts.append(DISTORTED)
        elif by_blocks[i] > LIMITS.shift:
            verdicts.append(f"{BIASED}: configurations and bands differ in it by {by_blocks[i]:.1f} std")
        elif parameter.log and _is_weak(result, parameter.name):
            verdicts.append(UNCERTAIN)
        else:
            verdicts.append(BY_PRIOR if 2 * prior[parameter.name] ** 2 > std[parameter.name] ** 2 else GOOD)
    return tuple(verdicts)


def _in_deviations(effects: FloatArray, result: Result) -> FloatArray:
    """Changes of the parameters that were asked for (n,), in standard deviations; 0 of those that are too small."""
    n = len(result.parameters.asked)
    with np.errstate(divide="ignore", invalid="ignore"):
        deviations = np.nan_to_num(np.abs(effects[:n]) / result.std_of_x[:n])
    return np.where(_matters(np.abs(effects[:n]), result), deviations, 0.0)


def _matters(change: FloatArray, result: Result) -> BoolArray:
    asked = result.parameters.asked
    size = [LIMITS.effect_on_damping if p.unit in DAMPING_UNITS else LIMITS.effect for p in asked]
    return change > size * np.where([p.log for p in asked], 1.0, np.abs(result.x[: len(asked)]))


def _shifts(evidence: Evidence) -> FloatArray:
    result = evidence.result
    std = result.std_of_x[: len(result.parameters.asked)]
    return np.where(_matters(std, result), evidence.uncertainty.shift[: len(std)], 0.0)


def _decides(evidence: Evidence) -> BoolArray:
    names, wanted = [p.name for p in evidence.result.parameters.asked], evidence.assembly.spec.focus
    matched = {name for key in wanted for name in matching(key, names)}
    return np.array([name in matched or not matched for name in names])


def decisive_index(
    result: Result, uncertainty: Uncertainty, indices: Sequence[ModificationIndex]
) -> ModificationIndex | None:
    """The cause that shows the model to be wrong by more than the intervals, if any does.

    A held number, freed alone, that does so; the likeliest cause in its place, where that does, too, and none where a
    far likelier cause explains the same and moves nothing.
    """
    if np.isnan(uncertainty.disagreement):  # no noise is known
        return None

    def moves(index: ModificationIndex) -> bool:
        return bool(np.any(_in_deviations(index.effects, result) > LIMITS.shift))

    # Of one direction: where several numbers are free at once, noise alone moves parameters far.
    alone = (index for index in indices if index.place == 0 and len(set(index.steps.tolist())) == 1)
    decisive = [i for i in alone if i.drop > LIMITS.drop and moves(i)]
    largest = max(decisive, key=lambda index: index.drop, default=None)
    likeliest = next((index for index in indices if index.place == 1), largest)
    if largest is None or likeliest is None or largest.name == likeliest.name:
        return largest
    if moves(likeliest):
        return likeliest
    equal = [index for index in decisive if index.name in likeliest.alike]
    explains_all = likeliest.drop > LIMITS.equal_drop * largest.drop
    return max(equal, key=lambda index: index.drop, default=None if explains_all else largest)


def _blocks_disagree(evidence: Evidence) -> bool:
    """True if configurations and bands disagree about the parameters by more than noise and model error together."""
    result = evidence.result
    excess = result.cost / result.cost_expected
    is_structured = evidence.uncertainty.disagreement > max(LIMITS.disagreement, LIMITS.structure * excess)
    return result.exceeds_noise and excess > LIMITS.excess and is_structured


def _by_blocks(evidence: Evidence) -> str:
    result, uncertainty = evidence.result, evidence.uncertainty
    shift = _shifts(evidence)
    moved = np.flatnonzero((shift > LIMITS.shift) & _decides(evidence))
    if not (_blocks_disagree(evidence) and moved.size):
        return ""
    worst = moved[np.argsort(-uncertainty.shift[moved])]
    names = ", ".join(result.parameters.free_names[i] for i in worst[: LIMITS.named])
    return (
        f"{len(worst)} of {len(shift)} parameters are biased by up to {shift[worst[0]]:.3g} std (largest: {names}), "
        "because configurations and frequency bands give different estimates"
    )


def _by_held_number(evidence: Evidence) -> str:
    result = evidence.result
    index = decisive_index(result, evidence.uncertainty, result.indices)
    if index is None:
        return ""
    moved = np.where(_decides(evidence), _in_deviations(index.effects, result), 0.0)
    worst = int(np.argmax(moved))
    if moved[worst] <= LIMITS.shift:
        return ""
    return f"{fault(index, evidence)}. Bias of {result.parameters.free_names[worst]}: {moved[worst]:.1f} std"


def _beyond_declared(evidence: Evidence) -> str:
    result = evidence.result
    if result.model_error <= USUAL_FLOOR or result.error_ratio < LARGE or not _blocks_disagree(evidence):
        return ""
    needed = f"fit.weights.model_error={result.model_error * result.error_ratio:.2g}"
    return f"the residuals exceed the declared model error. Find their cause, or set {needed}"


def _by_prior(evidence: Evidence) -> str:
    result = evidence.result
    if np.abs(prior_moves(result)).max() <= LIMITS.prior:
        return ""
    if evidence.cause is not None:
        return fault(evidence.cause, evidence)
    return next((note.text for note in (*contradicted_priors(result), *contradicted_tolerances(result))), "")


def estimate_notes(evidence: Evidence) -> tuple[Note, ...]:
    """Warnings about bounds, undetermined and weakly determined parameters, correlations, and the hit rate."""
    result = evidence.result
    return (*bound_notes(result), *_determination(result, evidence.uncertainty.unreached), *_search(result))


def find_disagreement(evidence: Evidence) -> tuple[Note, ...]:
    """A note on each configuration that the model explains far worse than the others, where no cause explains that.

    All amplitudes of a posture are one configuration here: gears that are not linear need no second robot.
    """
    result = evidence.result
    # What a cause leaves may be chance where V is little above the noise.
    left, by_chance = result.cost - evidence.best.drop, largest_by_chance(result.cost_dof) * result.cost_expected
    best = evidence.best
    is_explained = best.explained_fraction >= LIMITS.explained_share or (best.drop and left < by_chance)
    if is_explained or result.inflation_factor <= 1:
        return ()
    sums: dict[str, tuple[float, int]] = {}
    for part, cost in zip(evidence.optimum.fit.parts, evidence.uncertainty.costs.tolist(), strict=True):
        if part.n_residuals:
            name = posture_of(part.configuration)
            V, count = sums.get(name, (0.0, 0))
            sums[name] = V + cost, count + part.n_residuals
    level = np.sqrt([V / count for V, count in sums.values()])
    others = "the residuals of the other configurations"
    checks = "Check that robot, load and angles are as stated, or exclude its records"
    return tuple(
        Note("fit/inconsistent-responses", f"residuals {ratio:.0f} times {others}. {checks}", f"configuration {name}")
        for name, ratio in zip(sums, level / float(np.median(level)), strict=True)
        if len(sums) > 2 and ratio > LIMITS.residual_ratio
    )


def find_wrong_frequency_unit(evidence: Evidence) -> tuple[Note, ...]:
    r"""A note where all stiffnesses suggest frequencies in rad/s instead of Hz, the other way round, or degrees.

    An acceleration per torque is the same for K, D at omega and (2 pi)^2 K, 2 pi D at 2 pi omega: no residual shows it.
    """
    result = evidence.result
    known = result.std_of_x < LIMITS.stiffness_std
    stiff = [i for i, p in enumerate(result.parameters.free) if p.log and p.unit in ("N*m/rad", "N/m") and known[i]]
    # Viscous friction that the file holds is off by the same reading, and no other cause of it.
    is_friction = evidence.cause is not None and evidence.cause.name.startswith(("f_", "fm_", "d_"))
    if not stiff or (evidence.best.explained_fraction > LIMITS.explained_share and not is_friction):
        return ()
    change = result.x[stiff] - result.parameters.x[stiff]
    typical = float(np.median(change))
    if np.any(np.abs(change - math.copysign(2 * math.log(2 * math.pi), typical)) > math.log(LIMITS.factor_spread)):
        return ()
    unit, taken = ("rad/s", "Hz") if typical > 0 else ("Hz", "rad/s")
    text = (
        f"all estimates are {math.exp(typical):.3g} times their start, which no residual shows. Check whether the "
        f"frequencies are in {unit} instead of {taken} (39 times), the positions in degrees (57 times), or the torques "
        "on the other side of the gear (its ratio)"
    )
    return (Note("fit/frequency-unit", text, ", ".join(result.parameters.free[i].name for i in stiff)),)


def _determination(result: Result, unreached: BoolArray) -> Iterator[Note]:
    names, values = result.parameters.free_names, result.singular_values
    if unreached.any():
        yield Note(
            "fit/not-identifiable",
            f"{listed(names, unreached)}: only a combination of them is identifiable (smallest singular value "
            f"{values[-1]:.1e}, largest {values[0]:.1e}). Fix or tie one of them",
        )
    wanted = result.parameters.asked
    for parameter in (p for p, beyond in zip(wanted, unreached, strict=False) if p.log and not beyond):
        if _is_weak(result, parameter.name):
            limit = percent(LIMITS.stiffness_std)
            text = f"weakly identifiable (std above {limit} of the estimate). Do not use the estimate"
            yield Note("fit/weakly-identifiable", text, parameter.name)
    # A file that is off moves all alike.
    yield from correlated(names, covariance_by_noise(result.covariance, len(wanted)))


def _is_weak(result: Result, name: str) -> bool:
    return not result.std[name] <= LIMITS.stiffness_std * result.values[name]


def _search(result: Result) -> Iterator[Note]:
    starts = result.starts
    if lost := [start.message for start in starts if not math.isfinite(start.cost)]:
        yield Note("fit/starts", f"{len(lost)} of {len(starts)} starts failed, the first with: {lost[0]}")
    if result.n_converged_starts == 1 < len(starts) - len(lost):
        yield Note(
            "fit/starts",
            f"only 1 of {len(starts)} starts reached the best optimum; the residuals of the next are "
            f"{math.sqrt(starts[1].cost / max(starts[0].cost, 1e-300)):.4g} times as large. To look for a better "
            "optimum, raise fit.starts or lower fit.start_factor",
        )


def contradictions(result: Result) -> tuple[Note, ...]:
    """Warnings where load tests, or responses at the tool, contradict the responses of the motors."""
    sources = ("fit/loads", "static load tests", result.static), ("fit/tool", "responses at the tool", result.tool)
    return tuple(
        Note(
            code,
            f"{source} contradict the responses of the motors ({found.sentence}). {capital(found.cause)}. "
            "The estimates are from the motors alone",
        )
        for code, source, found in sources
        if found is not None and found.disagrees
    )


def listed(names: tuple[str, ...], chosen: BoolArray) -> str:
    """Names that are chosen, as a list in a sentence."""
    return ", ".join(name for name, is_chosen in zip(names, chosen, strict=True) if is_chosen)
