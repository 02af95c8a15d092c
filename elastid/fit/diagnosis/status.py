"""Status of a fit with its reason, and the verdict on each parameter.

The status `misfit` is a significant model error: the model explains most of the response, but its parameters are biased
by more than their intervals. One of four tests suffices; names in backticks are fields of `LIMITS`.

1. Blocks (a configuration and a frequency band) disagree, which has three conditions. V exceeds the limit of noise
   alone, and `excess` times its expectation. The scatter of the estimates over blocks is `disagreement` times the
   scatter by noise, and `structure` times the scatter by white residuals of the same size. A parameter of interest is
   biased by `min_shift` standard deviations, and by the fraction `effect`.
2. A fixed number, a common factor of several, or a spring that the robot model lacks: freeing it lowers V by `min_drop`
   and changes a parameter of interest by `min_shift` standard deviations and the fraction `effect`. This finds errors
   that all blocks share.
3. The data change a number by more than `max_prior_stds` standard deviations of its prior or tolerance.
4. Static load tests or responses at the tool contradict the responses of the motors (`static_and_tool_data`).

The logarithm of an unidentifiable damping has no finite estimate and ends at any bound.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from elastid.base.arrays import BoolArray, FloatArray
from elastid.base.display import capitalise, percent
from elastid.base.errors import notes_of
from elastid.base.names import match_names
from elastid.fit.covariance import Uncertainty
from elastid.fit.diagnosis.cause_notes import fault, phrase
from elastid.fit.diagnosis.estimate_notes import contradictions, is_weak, join_names
from elastid.fit.diagnosis.hypothesis import SCALE, Evidence
from elastid.fit.diagnosis.limits import LIMITS
from elastid.fit.diagnosis.priors import contradicted_priors, contradicted_tolerances
from elastid.fit.result import Result
from elastid.fit.result_rows import ModificationIndex
from elastid.fit.solve.solvers import DAMPING_UNITS
from elastid.fit.spec import TYPICAL_MODEL_ERROR
from elastid.fit.status_terms import AT_BOUND, BIASED, BY_PRIOR, DISTORTED, GOOD, LARGE, UNCERTAIN, Status
from elastid.response import UNEXPLAINED


def with_status(evidence: Evidence) -> Result:
    """Return the result with the worst status that applies, and its message: verdict, then residual test."""
    result, end, unidentifiable = evidence.result, evidence.optimum.end, evidence.uncertainty.unidentifiable
    free = result.parameters.free_names
    starts = result.converged_starts
    bound_text = f" with {join_names(free, result.at_bound)} at a bound" if result.at_bound.any() else ""
    fit_quality = f"the model explains {percent(max(evidence.explained, 0.0))} of the measured responses"

    def conclude(status: Status, message: str) -> Result:
        return replace(result, status=status, message=f"{message}. {capitalise(str(result.residual_test))}; {starts}")

    channel_families = {SCALE, *(h.family for h in evidence.hypotheses if h.changes is not None)}
    readings = [index for index in result.indices if index.place and index.group in channel_families]
    if evidence.is_suspect and readings:
        return conclude("model_error", f"{fit_quality}. {capitalise(fault(readings[0], evidence))}")
    too_large = result.inflation_factor > LARGE or not result.noise_is_known
    if too_large and evidence.explained < LIMITS.majority_fraction:
        return conclude("model_error", f"{fit_quality}. Check channels, gear ratios, bounds and the robot model")
    if not end.converged:
        return conclude("not_converged", f"the search stopped before an optimum ({end.message})")
    if unidentifiable.any():
        return conclude("ill_conditioned", f"not identifiable: a combination of {join_names(free, unidentifiable)}")
    logarithmic = [p.name for p in result.parameters.of_interest if p.log]
    if logarithmic and all(is_weak(result, name) for name in logarithmic):
        text = f"the std of every parameter is above {percent(LIMITS.stiffness_std)} of its estimate"
        return conclude("ill_conditioned", f"{text}. Check the channels of each file, and the noise of the responses")
    result = replace(result, verdicts=_verdicts(evidence))
    by_blocks, cause = _by_blocks(evidence), evidence.cause
    if by_blocks and cause is not None and cause.explained_fraction >= LIMITS.min_cause_fraction:
        by_blocks = f"{fault(cause, evidence)}. {capitalise(by_blocks)}"
    misfit = _by_fixed_number(evidence) or _beyond_declared(evidence)
    # The intervals include ratios that differ from angle to angle.
    if not evidence.uncertainty.ratios.explains:
        contradiction = _by_prior(evidence) or next((note.sentences for note in contradictions(result)), "")
        misfit = by_blocks or misfit or contradiction
    if misfit:
        return conclude("misfit", f"{misfit}{bound_text and f'. The fit ended{bound_text}'}")
    biased_names = [name for name, verdict in zip(free, result.verdicts, strict=False) if verdict.startswith(BIASED)]
    but = f", but {', '.join(biased_names)} biased" if biased_names else ""
    good: Status = "converged" if result.noise_is_known else "noise_unknown"
    return conclude("at_bound" if bound_text else good, f"converged{bound_text}{but}")


def _verdicts(evidence: Evidence) -> tuple[str, ...]:
    """Judge each parameter of interest: good, uncertain, dominated by the prior, at its bound, or biased."""
    result, n = evidence.result, len(evidence.result.parameters.of_interest)
    index = decisive_index(result, evidence.uncertainty, result.indices)
    by_index = np.zeros(n) if index is None else _in_deviations(index.effects, result)
    by_blocks = _shifts(evidence) if _blocks_disagree(evidence) else np.zeros(n)
    std, prior = result.std, result.std_prior
    is_distorted = any(note.code == UNEXPLAINED for note in notes_of(evidence.assembly.responses))
    verdicts = []
    for i, parameter in enumerate(result.parameters.of_interest):
        if result.at_bound[i]:
            verdicts.append(AT_BOUND)
        elif index is not None and by_index[i] > LIMITS.min_shift:
            verdicts.append(f"{BIASED}: {phrase(index, evidence)} would change it by {by_index[i]:.1f} std")
        elif is_distorted and parameter.name.startswith("d_"):
            verdicts.append(DISTORTED)
        elif by_blocks[i] > LIMITS.min_shift:
            verdicts.append(f"{BIASED}: configurations and bands differ in it by {by_blocks[i]:.1f} std")
        elif parameter.log and is_weak(result, parameter.name):
            verdicts.append(UNCERTAIN)
        else:
            verdicts.append(BY_PRIOR if 2 * prior[parameter.name] ** 2 > std[parameter.name] ** 2 else GOOD)
    return tuple(verdicts)


def _in_deviations(effects: FloatArray, result: Result) -> FloatArray:
    """Return the changes of the parameters of interest (n,) in standard deviations; 0 below the limits of an effect."""
    n = len(result.parameters.of_interest)
    with np.errstate(divide="ignore", invalid="ignore"):
        deviations = np.nan_to_num(np.abs(effects[:n]) / result.std_of_x[:n])
    return np.where(_is_significant(np.abs(effects[:n]), result), deviations, 0.0)


def _is_significant(change: FloatArray, result: Result) -> BoolArray:
    of_interest = result.parameters.of_interest
    size = [LIMITS.effect_on_damping if p.unit in DAMPING_UNITS else LIMITS.effect for p in of_interest]
    return change > size * np.where([p.log for p in of_interest], 1.0, np.abs(result.x[: len(of_interest)]))


def _shifts(evidence: Evidence) -> FloatArray:
    result = evidence.result
    std = result.std_of_x[: len(result.parameters.of_interest)]
    return np.where(_is_significant(std, result), evidence.uncertainty.shift[: len(std)], 0.0)


def _decides(evidence: Evidence) -> BoolArray:
    names, patterns = [p.name for p in evidence.result.parameters.of_interest], evidence.assembly.spec.focus
    of_interest = {name for key in patterns for name in match_names(key, names)}
    return np.array([name in of_interest or not of_interest for name in names])


def decisive_index(
    result: Result, uncertainty: Uncertainty, indices: Sequence[ModificationIndex]
) -> ModificationIndex | None:
    """Return the cause that proves a model error larger than the intervals; None without such a cause.

    The single number with the largest drop of V among those that change a parameter significantly. It is replaced by
    the likeliest cause if this also changes one, and by None if a likelier cause explains as much without changing any.
    """
    if np.isnan(uncertainty.disagreement):  # the noise is unknown
        return None

    def is_effective(index: ModificationIndex) -> bool:
        return bool(np.any(_in_deviations(index.effects, result) > LIMITS.min_shift))

    # Of one direction: with several free numbers the noise alone changes parameters far.
    single = (index for index in indices if index.place == 0 and len(set(index.steps.tolist())) == 1)
    decisive = [i for i in single if i.drop > LIMITS.min_drop and is_effective(i)]
    largest = max(decisive, key=lambda index: index.drop, default=None)
    likeliest = next((index for index in indices if index.place == 1), largest)
    if largest is None or likeliest is None or largest.name == likeliest.name:
        return largest
    if is_effective(likeliest):
        return likeliest
    equal = [index for index in decisive if index.name in likeliest.alike]
    explains_all = likeliest.drop > LIMITS.equal_drop * largest.drop
    return max(equal, key=lambda index: index.drop, default=None if explains_all else largest)


def _blocks_disagree(evidence: Evidence) -> bool:
    """Return True if configurations and bands disagree about the parameters by more than noise and model error."""
    result = evidence.result
    excess = result.cost / result.cost_expected
    is_structured = evidence.uncertainty.disagreement > max(LIMITS.disagreement, LIMITS.structure * excess)
    return result.exceeds_noise and excess > LIMITS.excess and is_structured


def _by_blocks(evidence: Evidence) -> str:
    result, uncertainty = evidence.result, evidence.uncertainty
    shift = _shifts(evidence)
    indices = np.flatnonzero((shift > LIMITS.min_shift) & _decides(evidence))
    if not (_blocks_disagree(evidence) and indices.size):
        return ""
    worst = indices[np.argsort(-uncertainty.shift[indices])]
    names = ", ".join(result.parameters.free_names[i] for i in worst[: LIMITS.n_named])
    return (
        f"{len(worst)} of {len(shift)} parameters are biased by up to {shift[worst[0]]:.3g} std (largest: {names}), "
        "because configurations and frequency bands give different estimates"
    )


def _by_fixed_number(evidence: Evidence) -> str:
    result = evidence.result
    index = decisive_index(result, evidence.uncertainty, result.indices)
    if index is None:
        return ""
    changes = np.where(_decides(evidence), _in_deviations(index.effects, result), 0.0)
    worst = int(np.argmax(changes))
    if changes[worst] <= LIMITS.min_shift:
        return ""
    return f"{fault(index, evidence)}. Bias of {result.parameters.free_names[worst]}: {changes[worst]:.1f} std"


def _beyond_declared(evidence: Evidence) -> str:
    result = evidence.result
    if result.model_error <= TYPICAL_MODEL_ERROR or result.error_ratio < LARGE or not _blocks_disagree(evidence):
        return ""
    option = f"fit.weights.model_error={result.model_error * result.error_ratio:.2g}"
    return f"the residuals exceed the declared model error. Find their cause, or set {option}"


def _by_prior(evidence: Evidence) -> str:
    result = evidence.result
    if np.abs(result.parameters.priors(result.x)[0]).max() <= LIMITS.max_prior_stds:
        return ""
    if evidence.cause is not None:
        return fault(evidence.cause, evidence)
    return next((note.sentences for note in (*contradicted_priors(result), *contradicted_tolerances(result))), "")
