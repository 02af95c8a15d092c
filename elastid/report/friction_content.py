"""Content of the page of a friction study: answers in sentences, and cells of its tables."""

from collections.abc import Mapping
from dataclasses import dataclass

from elastid.base.display import Questions, capitalise, digits, format_interval, number, percent
from elastid.base.errors import NoteGroup, group_notes, notes_of
from elastid.experiment.plan.friction import FrictionPlan
from elastid.friction_study.friction_tracking import TrackedFriction
from elastid.friction_study.result import FrictionNumber, FrictionResult, JointFriction
from elastid.friction_study.static_model_fit import ABSENT, NOT_ASKED, UnidentifiedTerm
from elastid.validation.log_comparison import LINK, NO_COMPARISON, LogComparison

# First answer by status.
GOOD = {
    "identified": "Yes.",
    "partly": "Yes, but some requested parameters are not identified.",
    "misfit": "No. Significant model error: do not use them.",
    "failed": "No parameter was identified.",
}
# Symbols in the sentence on a joint; with + and - if the directions differ.
HEADLINE_SYMBOLS = ("tau_f", "F_c", "F_s", "f")
MAX_ERROR = 0.1  # relative half-width of a good parameter, and relative rms error of a good simulation
# Names of model terms that are not identified.
TERM_NAMES = {
    "stribeck": "stiction and Stribeck velocity",
    "presliding": "presliding",
    "exponent": "exponent of the Stribeck curve",
    "quadratic": "quadratic friction",
    "directions": "difference of the directions",
    "directions.coulomb": "Coulomb friction by direction",
    "load": "dependence on load",
    "temperature": "dependence on temperature",
}


@dataclass(frozen=True)
class Refusal:
    """Term of the friction model that is not identified at some joints, and the reason."""

    term: str
    reason: str
    joints: tuple[str, ...]


@dataclass(frozen=True)
class FrictionContent:
    """Results of a friction study, its text and its provenance; without a date, so that the page is reproducible.

    plan: None without planned motions.  filters: of the joints that are tracked.  log_comparison: torque balance of
    motions, and simulation along them.  left_out: the same for validation logs.
    """

    title: str
    result: FrictionResult
    study_text: str
    provenance: Mapping[str, str]
    plan: FrictionPlan | None = None
    filters: tuple[TrackedFriction, ...] = ()
    log_comparison: LogComparison = NO_COMPARISON
    left_out: LogComparison = NO_COMPARISON

    @property
    def notes(self) -> tuple[NoteGroup, ...]:
        """Notes of the study and of all joints; equal notes are grouped."""
        return group_notes((*self.result.notes, *notes_of(self.result.joints), *notes_of(self.filters)))

    @property
    def questions(self) -> Questions:
        """Three questions of every page, each with its sentences."""
        return (
            ("Are the numbers good?", (self._good, *self._numbers)),
            ("Where does it fail, and why?", self._failures),
            ("What next?", self._next),
        )

    @property
    def short_questions(self) -> Questions:
        """Questions without the parameters of each joint, which a table has, and with the first advice only."""
        good, fails, following = self.questions
        return (good[0], (self._good, *self._truths)), fails, (following[0], following[1][:1])

    @property
    def _good(self) -> str:
        """Answer by status, largest simulation error, and widest interval of the headline parameters."""
        if self.result.status in ("identified", "partly") and self._simulation_error:
            return f"Yes, but {self._simulation_error}."
        rows = [row for row in self.result.numbers if row.symbol in HEADLINE_SYMBOLS and row.value]
        widths = {row.name: (row.high - row.low) / 2 / abs(row.value) for row in rows}
        widest = max(widths, key=widths.__getitem__, default="")
        if self.result.status != "identified" or not widest or widths[widest] <= MAX_ERROR:
            return GOOD[self.result.status]
        return f"Not all of them: {widest} has an interval of ±{percent(widths[widest])}."

    @property
    def _simulation_error(self) -> str:
        """Signal with the largest simulation error if the error exceeds MAX_ERROR; else empty."""
        runs = (*self.log_comparison.runs, *self.left_out.runs)
        if failure := next((run for run in runs if run.lost), None):
            return f"the simulation on {failure.log} diverges (see below)"
        errors = [(signal.error, signal, run) for run in runs for signal in run.signals if signal.kind != LINK]
        error, signal, run = max(errors, key=lambda row: row[0], default=(0.0, None, None))
        if signal is None or run is None or not error > MAX_ERROR:
            return ""
        return (
            f"the simulation on {run.log}, driven by its {run.drive}, has an error of {100 * error:.2g} % of the rms "
            f"{signal.kind} of {signal.place}"
        )

    @property
    def _numbers(self) -> tuple[str, ...]:
        """Sentences on the parameters and motions of each joint, and on true values of a simulated robot."""
        sentences = [joint_sentence(joint) for joint in self.result.joints]
        motions = [(joint, joint.motion) for joint in self.result.joints if joint.motion is not None]
        sentences += [f"Motions of joint {joint.joint}: {motion.time_summary}." for joint, motion in motions]
        return (*sentences, *self._truths)

    @property
    def _truths(self) -> tuple[str, ...]:
        """Sentence on true values inside their intervals; empty for a real robot."""
        truths = [(number.low, number.truth, number.high) for number in self.result.numbers if number.truth is not None]
        inside = sum(low <= truth <= high for low, truth, high in truths)
        return (f"{inside} of {len(truths)} true values inside their 95 % intervals.",) if truths else ()

    @property
    def _failures(self) -> tuple[str, ...]:
        sentences = [
            f"Joint {joint.joint} is a misfit: {joint.misfit}." for joint in self.result.joints if joint.misfit
        ]
        sentences += [sentence] if (sentence := _not_identified(self.result)) else []
        worst = max(self.log_comparison.balances, key=lambda balance: balance.unexplained_fraction, default=None)
        if worst is not None:
            sentences.append(
                f"Unexplained fraction of the mean-square torque of {worst.place} in {worst.log}: "
                f"{worst.unexplained_fraction:.2g}; without friction {worst.unexplained_without_friction:.2g}."
            )
        return tuple(sentences) or ("Nowhere in these logs.",)

    @property
    def _next(self) -> tuple[str, ...]:
        if self.result.status == "failed":
            return (f"{capitalise(self.result.message)}.",)
        gaps = {term_name(term): term.reason for joint in self.result.joints for term in joint.missing}
        if gaps:
            return tuple(f"For {name}: {reason}." for name, reason in list(gaps.items())[:3])
        return ("Use the friction model: `elastid export STUDY --run FOLDER --to robot` adds it to the robot model.",)


def joint_sentence(joint: JointFriction) -> str:
    """Summarise the identified numbers of a joint in one sentence."""
    symbols = {estimate.symbol for estimate in joint.numbers}
    headline = [
        s
        for symbol in HEADLINE_SYMBOLS
        for s in ((f"{symbol}+", f"{symbol}-") if f"{symbol}+" in symbols else (symbol,))
    ]
    first = [estimate for symbol in headline for estimate in joint.numbers if estimate.symbol == symbol]
    if not first:
        return f"Joint {joint.joint}: no friction could be identified."
    numbers = ", ".join(f"{estimate.symbol} = {with_interval(estimate)}" for estimate in first)
    return f"Joint {joint.joint}: {numbers}."


def refusals(result: FrictionResult) -> tuple[Refusal, ...]:
    """List terms of the friction model that are not identified; joints with the same reason are grouped."""
    joints: dict[tuple[str, str], tuple[str, ...]] = {}
    for joint in result.joints:
        for term in joint.unidentified:
            key = term_name(term), term.reason
            joints[key] = (*joints.get(key, ()), joint.joint)
    return tuple(Refusal(name, reason, joint_names) for (name, reason), joint_names in joints.items())


def _not_identified(result: FrictionResult) -> str:
    """List terms that are not identifiable, with their joints unless these are all joints; empty without terms."""
    joints: dict[str, tuple[str, ...]] = {}
    for refusal in refusals(result):
        if not refusal.reason.startswith((NOT_ASKED, ABSENT)):
            joints[refusal.term] = joints.get(refusal.term, ()) + refusal.joints
    terms = [
        term if len(names) == len(result.joints) else f"{term} (joint {', '.join(names)})"
        for term, names in joints.items()
    ]
    return f"Not identifiable from these data: {', '.join(terms)}." if terms else ""


def term_name(row: UnidentifiedTerm) -> str:
    """Return the name of a term of the friction model for a sentence."""
    return TERM_NAMES.get(row.term, row.term)


def with_interval(row: FrictionNumber) -> str:
    """Format value and half-width of its 95 % interval with the unit: `9.71 ± 0.02 N*m`."""
    value, half = row.value, (row.high - row.low) / 2
    return f"{number(value, digits(value, half))} ± {number(half, 2)} {row.unit}".rstrip()


# Headings of the cells of `number_cells`.
NUMBER_HEADINGS = ("number", "symbol", "value", "std", "95 % interval", "unit", "identified from")


def number_cells(row: FrictionNumber) -> tuple[str, ...]:
    """Format one identified number under NUMBER_HEADINGS."""
    n = digits(row.value, row.std)
    cells = number(row.value, n), number(row.std, 2), " … ".join(format_interval((row.low, row.high), n))
    return row.name, row.symbol, *cells, row.unit, row.learnt_from
