"""First screen of the page in words: verdict, quality of the estimates, and errors of the model."""

import math
from collections.abc import Sequence

from elastid.base.display import capitalise, percent
from elastid.fit.result import Result
from elastid.fit.status_terms import CONTRADICTED, DISTORTED, FIXED_VALUES, UNCERTAIN
from elastid.nonlinear.gear_result import GearResult
from elastid.parameters import DELAY
from elastid.report.parameter_row import WIDTH_CLASSES, ParameterRow
from elastid.validation.frf_error import FrfError, noise_p
from elastid.validation.residual_tests import FALSE_ALARM


def springs_and_dampers(rows: Sequence[ParameterRow]) -> list[ParameterRow]:
    """Return rows of stiffness and damping; all rows without them."""
    return [row for row in rows if row.name.startswith(("k", "d")) and row.name != DELAY] or list(rows)


def widest(rows: Sequence[ParameterRow]) -> ParameterRow | None:
    """Return the row with the widest interval among springs and dampers; None without rows."""
    return max(springs_and_dampers(rows), key=lambda row: row.half_width, default=None)


def verdict_sentence(result: Result, rows: Sequence[ParameterRow], agreements: Sequence[FrfError] = ()) -> str:
    """State the verdict of the fit, its message if it did not converge, and the accuracy of the estimates."""
    return ". ".join(map(capitalise, filter(None, (_status_clause(result, agreements), accuracy(result, rows)))))


def accuracy(result: Result, rows: Sequence[ParameterRow]) -> str:
    """State half-widths of meaningful intervals, and the number of true values inside."""
    with_truth = [row for row in rows if row.truth is not None]
    inside = sum(row.interval[0] <= row.truth <= row.interval[1] for row in with_truth if row.truth is not None)
    count = f"All {inside}" if inside == len(with_truth) else f"{inside} of {len(with_truth)}"
    truths = f"{count} true values are inside their intervals" if with_truth else ""
    return ". ".join(filter(None, ("" if is_wrong(result) else capitalise(_widths_clause(rows)), truths)))


def is_wrong(result: Result) -> bool:
    """Return True if the model error exceeds the intervals, so that their widths are meaningless."""
    return result.status in ("misfit", "model_error")


MAX_UNEXPLAINED_MOTION = 0.01  # largest fraction of the position signal that the gear effects do not explain


def numbers_answer(result: Result, rows: Sequence[ParameterRow], gears: GearResult | None = None) -> str:
    """State the quality of the estimates, consistent with status, verdicts, causes and intervals."""
    widest_row = widest(rows)
    if result.status != "converged":
        if result.meaning == CONTRADICTED:
            required_value, is_number, _ = result.required_value.partition(" instead of ")
            value = required_value if is_number else "the value that the data require"
            return f"Only if {value} is correct. The robot model states a different value."
        return f"{'No' if is_wrong(result) else 'Not yet'}. {capitalise(result.meaning.clause)}."
    if widest_row is None:
        return "No parameter was identified."
    poor = [row for row in rows if row.is_poor]
    with_verdicts = _verdict_phrases(poor)
    if result.exceeds_noise:
        error = (
            f"assumed model error of {percent(result.model_error)} of each FRF"
            if result.is_within_declared
            else "model error"
        )
        return f"With caution{with_verdicts and f': {with_verdicts}'}. The intervals include the {error}."
    if result.cause.text:
        return f"With caution: {result.cause.fault}."
    if gears is not None and not gears.refused and gears.after > MAX_UNEXPLAINED_MOTION:
        return f"With caution: gears and springs leave {percent(gears.after)} of the position signal unexplained."
    if poor:
        return f"{'No' if len(poor) == len(rows) else 'Not all of them'}: {with_verdicts}."
    if widest_row.half_width > WIDTH_CLASSES[-1]:
        return f"Not all of them: the interval of {widest_row.name} is wider than ±{percent(WIDTH_CLASSES[-1])}."
    with_coulomb = ", ".join(row.name for row in rows if row.has_coulomb)
    but = f", except {with_coulomb} (may include Coulomb friction, which is not compensated)" if with_coulomb else ""
    if any(row.truth is not None for row in rows):  # a simulated robot equals its model
        return f"Yes{but}."
    base = next((f" {capitalise(row.base)}." for row in rows if row.base), "")
    is_exact = any(note.code == FIXED_VALUES for note in result.notes)
    return f"Yes{but}{', if the fixed values of the robot model are exact' * is_exact}.{base}"


def _verdict_phrases(rows: Sequence[ParameterRow]) -> str:
    names: dict[str, list[str]] = {}
    for row in rows:
        has_size = row.verdict == UNCERTAIN and row.estimate != 0
        size = f" (std {percent(row.std / abs(row.estimate))})" if has_size else ""
        names.setdefault(row.verdict, []).append(f"{row.name}{size}")
    phrases = []
    for verdict, texts in names.items():
        word, _, reason = verdict.partition(": ")
        verb = "is" if len(texts) == 1 else "are"
        reason = "limit 50 %; do not use" if verdict == UNCERTAIN else reason
        phrases.append(f"{', '.join(texts)} {verb} {word}{reason and f' ({reason})'}")
    return ", and ".join(phrases)


def _noise_and_error(result: Result, agreements: Sequence[FrfError]) -> str:
    """Name the noise, and the model error if the residuals of fitted configurations exceed the noise alone."""
    exceeds = noise_p([agreement for agreement in agreements if not agreement.is_validation]) < FALSE_ALARM
    if not (exceeds or result.is_within_declared):
        return "noise"
    return f"noise and the model error of {percent(result.model_error)} that the fit assumes (fit.weights.model_error)"


def residual_sentence(result: Result, agreements: Sequence[FrfError]) -> str:
    """State the result of the residual test and the first cause of a model error."""
    if not result.noise_is_known:
        return "Unknown: without a measured noise no residual test is possible."
    test = f" {capitalise(str(result.residual_test))}."
    if result.cause.text:
        cause = capitalise(result.cause.fault)
        if result.required_value:
            users = "The fit" + " and the validation" * any(agreement.is_validation for agreement in agreements)
            return f"{cause}. {users} used the value required by the data: residuals {result.residual_test.ratio}."
        return f"{cause}.{test if result.exceeds_noise else ''}"
    if "error" in (noise := _noise_and_error(result, agreements)):
        return f"No error beyond {noise}.{test}"
    if DISTORTED in result.verdicts:
        return "Residuals consistent with noise, but motor friction does not explain the nonlinear distortion."
    return f"No model error detected.{test}"


def _status_clause(result: Result, agreements: Sequence[FrfError]) -> str:
    if result.status != "converged":
        return result.message.rstrip(".")
    if result.exceeds_noise and not result.is_within_declared:
        return f"residuals {result.residual_ratio:.3g} times the noise, which the intervals include"
    return f"residuals consistent with {_noise_and_error(result, agreements)}"


def _widths_clause(rows: Sequence[ParameterRow]) -> str:
    joint_rows = springs_and_dampers(rows)
    kind = "stiffnesses and dampings" if any(row.name.startswith(("k", "d")) for row in joint_rows) else "parameters"
    if any(row.is_poor for row in joint_rows):
        return ""  # the verdicts are more specific
    parameters = [row for row in rows if row not in joint_rows and not row.has_coulomb]
    largest = max((row.half_width for row in parameters), default=math.inf)
    last = f", and all {len(parameters)} other parameters of ±{percent(largest)} or less"
    first = _width_clause(joint_rows, kind)
    return first and f"{first}{last if largest <= WIDTH_CLASSES[-1] else ''} (half-width, 95 %)"


def _width_clause(rows: Sequence[ParameterRow], kind: str) -> str:
    widths = [row.half_width for row in rows]
    widest = max(widths, default=math.inf)
    for limit in (widest,) if widest <= WIDTH_CLASSES[-1] else WIDTH_CLASSES:
        within = sum(width <= limit for width in widths)
        if within >= max(len(rows) / 2, 1):
            count = f"all {within}" if within == len(rows) else f"{within} of {len(rows)}"
            is_few, names = within == len(rows) <= 2, " and ".join(row.name for row in rows)
            subject = f"the parameter{'s' * (len(rows) > 1)} {names}" if is_few else f"{count} {kind}"
            return f"{subject} {'has an interval' if len(rows) == 1 else 'have intervals'} of ±{percent(limit)} or less"
    return ""
