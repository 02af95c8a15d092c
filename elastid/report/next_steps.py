r"""Next steps after a fit: remedy of a cause, action of the status, then measures for narrower intervals.

.. math:: \sigma_p'^2 = \sigma_p^2 / (1 + s_{qp} (m - 1))

for m times the experiments in a configuration q that has the fraction s_qp of the information about p.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from elastid.base.display import percent
from elastid.fit.result import Result
from elastid.fit.status_terms import DISTORTED, OTHER_AMPLITUDE
from elastid.nonlinear.gear_result import NOT_EXPLAINED, NOT_OPENED
from elastid.report.parameter_row import ParameterRow
from elastid.report.run_summary import is_wrong, widest

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
    if not result.has_cause or candidates[1] is OPEN_GEARS:  # a warning has the cause, too
        candidates.reverse()
    if poor is not None and poor.half_width > NARROW and not is_wrong(result):
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
    if result.status == "converged" or (result.status == "misfit" and result.cause.remedy):
        return None
    return Action(f"{result.meaning.action}.", "")  # the cause is printed above


def _action_of_cause(result: Result) -> Action | None:
    sentence, _, command = result.cause.remedy.partition(": `")
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
    width, new_width = percent(poor.half_width), percent(factor * poor.half_width)
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
