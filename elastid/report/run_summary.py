r"""First screen of the page in words: verdict, widths of intervals, model errors, next steps.

.. math:: \sigma_p'^2 = \sigma_p^2 / (1 + s_{qp} (m - 1))

for m times the experiments in a configuration q that has the fraction s_qp of the information about p.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from elastid.base.display import Questions, capitalise, number, percent
from elastid.base.statistics import QUANTILE_95
from elastid.fit.result import Result
from elastid.fit.status_terms import (
    BIASED,
    CONTRADICTED,
    DISTORTED,
    FIXED_VALUES,
    NO_CAUSE,
    OTHER_AMPLITUDE,
    REQUIRED,
    UNCERTAIN,
)
from elastid.nonlinear.gear_result import NOT_EXPLAINED, NOT_OPENED, GearResult
from elastid.parameters import DELAY
from elastid.report.content import ParameterRow, ReportContent, ResponsesContent
from elastid.validation.frf_error import FrfError, noise_p
from elastid.validation.residual_tests import FALSE_ALARM

if TYPE_CHECKING:
    from elastid.modal.modes import Modes  # a slow import: SciPy's linear algebra

# Limits of classes of the half-width of a 95 % interval over the estimate.
WIDTH_CLASSES = (0.02, 0.1, 0.5)
WIDTH_WORDS = ("±2 % or less", "±2 to 10 %", "±10 to 50 %", "wider")


def half_width(row: ParameterRow) -> float:
    """Return half of the 95 % interval over the estimate; infinite for an unidentifiable parameter."""
    low, high = row.interval
    return (high - low) / 2 / abs(row.estimate) if row.estimate and math.isfinite(high - low) else math.inf


def width_class(row: ParameterRow) -> int:
    """Return the index of the interval in WIDTH_WORDS."""
    return int(np.searchsorted(WIDTH_CLASSES, half_width(row)))


def springs_and_dampers(rows: Sequence[ParameterRow]) -> list[ParameterRow]:
    """Return rows of stiffness and damping; all rows without them."""
    return [row for row in rows if row.name.startswith(("k", "d")) and row.name != DELAY] or list(rows)


def widest(rows: Sequence[ParameterRow]) -> ParameterRow | None:
    """Return the row with the widest interval among springs and dampers; None without rows."""
    return max(springs_and_dampers(rows), key=half_width, default=None)


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
            requirement, is_number, _ = result.cause[0].removeprefix(REQUIRED).strip().partition(" instead of ")
            value = requirement if is_number else "the value that the data require"
            return f"Only if {value} is correct. The robot model states a different value."
        return f"{'No' if is_wrong(result) else 'Not yet'}. {capitalise(result.meaning.partition('. ')[0])}."
    if widest_row is None:
        return "No parameter was identified."
    poor = [row for row in rows if row.verdict.startswith((BIASED, UNCERTAIN))]
    with_verdicts = _verdict_phrases(poor)
    if result.exceeds_noise:
        error = (
            f"assumed model error of {percent(result.model_error)} of each FRF"
            if result.is_within_declared
            else "model error"
        )
        return f"With caution{with_verdicts and f': {with_verdicts}'}. The intervals include the {error}."
    if result.cause[0]:
        return f"With caution: {result.cause[0]}."
    if gears is not None and not gears.refused and gears.after > MAX_UNEXPLAINED_MOTION:
        return f"With caution: gears and springs leave {percent(gears.after)} of the position signal unexplained."
    if poor:
        return f"{'No' if len(poor) == len(rows) else 'Not all of them'}: {with_verdicts}."
    if half_width(widest_row) > WIDTH_CLASSES[-1]:
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
    test = f" {capitalise(result.residual_test)}."
    if cause := result.cause[0]:
        if cause.startswith(REQUIRED):
            ratio = result.residual_test.partition(": residuals ")[2]
            users = "The fit" + " and the validation" * any(agreement.is_validation for agreement in agreements)
            return f"{capitalise(cause)}. {users} used the value required by the data: residuals {ratio}."
        return f"{capitalise(cause)}.{test if result.exceeds_noise else ''}"
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
    if any(row.verdict.startswith((BIASED, UNCERTAIN)) for row in joint_rows):
        return ""  # the verdicts are more specific
    parameters = [row for row in rows if row not in joint_rows and not row.has_coulomb]
    largest = max(map(half_width, parameters), default=math.inf)
    last = f", and all {len(parameters)} other parameters of ±{percent(largest)} or less"
    first = _width_clause(joint_rows, kind)
    return first and f"{first}{last if largest <= WIDTH_CLASSES[-1] else ''} (half-width, 95 %)"


def _width_clause(rows: Sequence[ParameterRow], kind: str) -> str:
    widths = [half_width(row) for row in rows]
    widest = max(widths, default=math.inf)
    for limit in (widest,) if widest <= WIDTH_CLASSES[-1] else WIDTH_CLASSES:
        within = sum(width <= limit for width in widths)
        if within >= max(len(rows) / 2, 1):
            count = f"all {within}" if within == len(rows) else f"{within} of {len(rows)}"
            is_few, names = within == len(rows) <= 2, " and ".join(row.name for row in rows)
            subject = f"the parameter{'s' * (len(rows) > 1)} {names}" if is_few else f"{count} {kind}"
            return f"{subject} {'has an interval' if len(rows) == 1 else 'have intervals'} of ±{percent(limit)} or less"
    return ""


def summary_line(content: ReportContent) -> str:
    """State the number of configurations and experiments, and the robot's time."""
    n = len(content.frf)
    phrases = [f"{n} configuration{'s' if n != 1 else ''}"]
    if content.plan is not None:
        records = sum(content.plan.realisations) * len(content.plan.inputs)
        phrases += [f"{records} records", f"{number(content.plan.robot_time_s, 3)} s of robot time"]
    return " · ".join(phrases)


MAX_ACTIONS = 3  # on the page
NARROW = 0.005  # relative half-width of an interval that needs no further measurement


@dataclass(frozen=True)
class Action:
    """Next step: an imperative, the expected improvement (gain), and a command or keys to copy (text)."""

    sentence: str
    gain: str
    text: str = ""


USE = Action("Use the numbers.", "")
OPEN_GEARS = Action(
    "Check that channels, units, time and load are the same in all records.",
    "If they are, estimate the nonlinear effects of the gears.",
    "--set 'gears={}'",
)


def next_steps(result: Result, rows: Sequence[ParameterRow]) -> tuple[Action, ...]:
    """List the next steps: remedy of the first cause, action of the status, then a narrower interval."""
    poor = widest(rows)
    candidates = [_action_of_cause(result), _action_of_status(result)]
    if result.cause[0].startswith(NO_CAUSE) or candidates[1] is OPEN_GEARS:  # a warning has the cause, too
        candidates.reverse()
    if poor is not None and half_width(poor) > NARROW and not is_wrong(result):
        candidates.append(
            None if result.exceeds_noise else _action_of_tolerance(result, poor) or _action_of_experiments(result, poor)
        )
    if result.is_within_declared:
        candidates.append(Action(f"{OTHER_AMPLITUDE}.", ""))
    return tuple([action for action in candidates if action is not None][:MAX_ACTIONS] or [USE])


# Content and command of exports; the page contains no path, so that it is the same wherever it is made.
COMMANDS = tuple(
    (words, f"elastid export STUDY --run FOLDER --to {target}")
    for words, target in (("robot model with the estimates", "robot"), ("MATLAB", "matlab"), ("MuJoCo", "mujoco"))
)


def _action_of_status(result: Result) -> Action | None:
    if DISTORTED in result.verdicts and not any(words in result.message for words in (NOT_EXPLAINED, NOT_OPENED)):
        return OPEN_GEARS
    if result.status == "converged" or (result.status == "misfit" and result.cause[2]):
        return None
    return Action(f"{result.meaning.partition('. ')[2]}.", "")  # the cause is printed above


def _action_of_cause(result: Result) -> Action | None:
    sentence, _, command = result.cause[2].partition(": `")
    first, tied_names = result.indices[:1], {p.tie.to for p in result.parameters if p.tie is not None}
    # A parameter to which others are tied cannot be freed alone.
    is_tied = any(tied_names & {*index.members} for index in first)
    text = "" if is_tied and not command.startswith("elastid") else command.rstrip("`")
    return Action(f"{sentence}.", "", text) if sentence else None


# Values of a robot model that are measured together, by the beginnings of their names.
TOLERANCES = {
    "gain_u_": "Calibrate {} (torque constant)", "Jm_": "Measure {} (motor inertia)", "m_": "Measure {} (mass)",
    "I_": "Measure {} (inertia)", "c_": "Measure {} (centre of mass)", "p": "Measure {} (length)",
    "zero_": "Calibrate {} (zero angle)",
}  # fmt: skip


def _action_of_tolerance(result: Result, poor: ParameterRow) -> Action | None:
    """Advise to measure values whose tolerances cause at least half of a variance, C_xn C_nn^-1 C_nx; else None."""
    C, names = result.covariance, result.parameters.free_names
    i, n, fractions = names.index(poor.name), len(result.parameters.of_interest), {}
    for beginning in TOLERANCES:
        indices = [j for j in range(n, len(names)) if names[j].startswith(beginning)]
        cross = C[i, indices]
        fractions[beginning] = float(cross @ np.linalg.pinv(C[np.ix_(indices, indices)]) @ cross / C[i, i])
    largest = max(fractions, key=lambda beginning: fractions[beginning])
    if 2 * fractions[largest] < 1:
        return None
    sentence = f"{TOLERANCES[largest].format(', '.join(name for name in names[n:] if name.startswith(largest)))}."
    fraction = percent(fractions[largest])
    reason = f"The tolerance causes {fraction} of the variance of {poor.name}. Without it, the interval shrinks"
    return _narrower(sentence, poor, reason, math.sqrt(max(1 - fractions[largest], 0.0)))


def _narrower(measure: str, poor: ParameterRow, reason: str, factor: float) -> Action | None:
    width, new_width = percent(half_width(poor)), percent(factor * half_width(poor))
    return None if width == new_width else Action(measure, f"{reason} from ±{width} to ±{new_width}.")


def _action_of_experiments(result: Result, poor: ParameterRow) -> Action | None:
    column = result.parameters.free_names.index(poor.name)
    if not result.information_fraction.size or not np.isfinite(result.information_fraction[:, column]).any():
        return None
    q = int(np.nanargmax(result.information_fraction[:, column]))
    # Errors of the robot model do not average out in further measurements.
    averaging = float(result.averaging_fraction[column]) if len(result.averaging_fraction) else 1.0
    fraction, name = averaging * float(result.information_fraction[q, column]), result.configurations[q]
    reason = f"The interval of {poor.name} then shrinks"
    return _narrower(f"Measure twice as long in “{name}”.", poor, reason, 1 / math.sqrt(1 + fraction))


MAX_MODES = 3  # configurations whose modes the first screen lists


def questions_of_responses(content: ResponsesContent) -> Questions:
    """Answer the three questions of the page of responses without a robot."""
    warnings = sum(note.first.severity == "warning" for note in content.notes)
    stds = [float(np.nanmedian(modes.relative_std)) for modes in content.modes if np.isfinite(modes.relative_std).any()]
    good = [f"Noise is {percent(max(stds))} of the response at a line." if stds else "The noise is unknown."]
    good += [f"Warnings below: {warnings}."] if warnings else []
    with_modes = [modes for modes in content.modes if modes.n_modes]
    modes = []
    for mode_set in with_modes[:MAX_MODES]:
        low, high = (number(float(mode_set.freq_hz[i]), 4) for i in (0, -1))
        count = f"{mode_set.n_modes} modes from {low} to" if mode_set.n_modes > 1 else "one mode at"
        modes.append(f"{mode_set.configuration}: {count} {high} {mode_set.frequency_unit}.")
    n_more = len(with_modes) - MAX_MODES
    modes += [f"{n_more} further configurations: below."] if n_more > 0 else []
    return (
        ("Are the responses good?", tuple(good)),
        ("Which modes are there?", tuple(modes) or ("No significant mode.",)),
        ("What next?", (_action_of_damping(with_modes),)),
    )


def _action_of_damping(rows: Sequence[Modes]) -> str:
    if not rows:
        return "Measure longer, or hit more often: a factor of four halves the noise."
    widths = [QUANTILE_95 * modes.zeta_std / modes.zeta for modes in rows]
    modes, width = max(zip(rows, widths, strict=True), key=lambda pair: float(pair[1].max()))
    index = int(width.argmax())
    return (
        f"The damping at {number(float(modes.freq_hz[index]), 4)} {modes.frequency_unit} has the widest interval, "
        f"±{percent(float(width[index]))}; a record four times as long, or four times the hits, halves it."
    )
