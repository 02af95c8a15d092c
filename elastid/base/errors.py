"""Failures of a command, which `cli` turns into message and exit code, and notes; each has a code of `CODES`.

Codes of all errors and notes, each with what it means and what to do: `elastid explain CODE`.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence, Sized
from dataclasses import dataclass
from difflib import get_close_matches
from importlib import import_module
from types import UnionType
from typing import Any, Final, Literal, TypeAlias, TypeVar, get_args

T = TypeVar("T")


class ElastidError(Exception):
    """A failure that the user can act on: the message states fault, place, reason and remedy.

    code: of the table `CODES`, for programs ("records/period-mismatch").  text: one sentence with its
    numbers filled in.  place: the file, line, key, configuration or channel that it is about, printed in front.
    """

    exit_code = 1

    def __init__(self, code: str, text: str, place: object = "") -> None:
        super().__init__(code, text, str(place))
        self.code, self.text, self.place = code, text, str(place)

    def __str__(self) -> str:
        return f"{self.place}: {self.text}" if self.place else self.text


class StudyError(ElastidError):
    """The study, its robot or the command line is wrong: exit code 2, nothing was computed."""

    exit_code = 2


class DataError(ElastidError):
    """The measured data do not allow the analysis: exit code 1, the data are left untouched."""


class FitError(ElastidError):
    """The identification failed or cannot be trusted: exit code 1."""


class MisfitError(FitError):
    """The identification is done and written, but not to be believed as it stands: exit code 3."""

    exit_code = 3


class UnknownNameError(KeyError):
    """A name that is none of those there are, which the message lists."""

    def __str__(self) -> str:
        return str(self.args[0])  # without the quotes that KeyError puts around it


class Named(dict[str, T]):
    """Values by name; a name that is not there is refused with those there are.

    >>> Named("parameter", {"k_1": 2.0})["k_2"]
    Traceback (most recent call last):
    elastid.base.errors.UnknownNameError: no parameter k_2; there are k_1
    """

    def __init__(self, noun: str, values: Mapping[str, T]) -> None:
        super().__init__(values)
        self._noun = noun

    def __missing__(self, name: str) -> T:
        raise UnknownNameError(f"no {self._noun} {name}; there are {', '.join(self) or 'none'}")

    def __reduce__(self) -> tuple[type[Named[T]], tuple[str, dict[str, T]]]:
        return type(self), (self._noun, dict(self))


def check_kind(value: object, kind: type | UnionType, name: str, remedy: str) -> None:
    """TypeError where an argument is of another kind, or of none of several; remedy: how to get one of that kind."""
    if not isinstance(value, kind):
        wanted = " or ".join(type_.__name__ for type_ in get_args(kind) or (kind,))
        raise TypeError(f"{name} is of type {type(value).__name__}, not {wanted}; {remedy}")


def index_of(name: str, names: Sequence[str], noun: str) -> int:
    """The place of a name; UnknownNameError that lists those there are.

    >>> index_of("k_2", ("k_1", "k_2"), "parameter")
    1
    >>> index_of("k_3", ("k_1", "k_2"), "parameter")
    Traceback (most recent call last):
    elastid.base.errors.UnknownNameError: no parameter k_3; there are k_1, k_2
    """
    if name not in names:
        raise UnknownNameError(f"no {noun} {name}; there are {', '.join(names) or 'none'}")
    return names.index(name)


def check_theta(theta: Sized, names: Sequence[str]) -> None:
    """ValueError where numbers are not one for each parameter."""
    if len(theta) != len(names):
        raise ValueError(f"theta has {len(theta)} numbers for {len(names)} parameters: {', '.join(names)}")


def did_you_mean(name: str, known: Iterable[str], further: Iterable[str] = ()) -> str:
    """The known name nearest to an unknown one, or else all of them: the end of a message.

    further: known names that are too many to be listed.

    >>> did_you_mean("bamd_hz", ["band_hz", "period"])
    "did you mean 'band_hz'?"
    >>> did_you_mean("x", ["band_hz", "period"])
    'there are band_hz, period'
    """
    names = list(known)
    close = get_close_matches(name, [*names, *further], n=1)
    return f"did you mean '{close[0]}'?" if close else f"there are {', '.join(names) or 'none'}"


def installed(module: str, extra: str, place: object = "") -> Any:
    """A module of an extra; StudyError with the command that installs it where it is not there."""
    try:
        return import_module(module)
    except ImportError:
        text = (
            f"{module.partition('.')[0]} is not installed; install it with `uv sync --extra {extra}` (or `pip install "
        )
        raise StudyError("install/missing-package", f"{text}'elastid[{extra}]'`)", place) from None


Severity: TypeAlias = Literal["information", "warning"]


@dataclass(frozen=True)
class Note:
    """code: what kind of thing, for programs ("clipped-channel").  text: one sentence with its numbers filled in.

    place: the file, record, configuration, channel or parameter that it is about; printed in front of the text.
    """

    code: str
    text: str
    place: str = ""
    severity: Severity = "warning"

    def __str__(self) -> str:
        return f"{self.place}: {self.text}" if self.place else self.text


@dataclass(frozen=True)
class NoteGroup:
    """One note from `places`: one code, and texts that differ at most in their numbers."""

    first: Note
    places: tuple[str, ...]

    def __str__(self) -> str:
        if len(self.places) == 1:
            return str(self.first)
        if len(self.places) <= 3:
            return f"{', '.join(self.places)}: {self.first.text}"
        return f"{self.places[0]} and {len(self.places) - 1} more: {self.first.text}"


def grouped(notes: Iterable[Note]) -> tuple[NoteGroup, ...]:
    """The notes without repetition, in the order of their first appearance, each kind of each text once.

    >>> for group in grouped(Note("late-log", f"{t} samples late", f"log {i}") for i, t in enumerate((3, 4, 3, 5))):
    ...     print(group)
    log 0 and 3 more: 3 samples late
    """
    groups: dict[tuple[str, str, bool], dict[Note, None]] = {}
    for note in notes:
        # A note without a place is about one thing only: another number there is another thing.
        key = (note.code, re.sub(r"\d+(\.\d+)?", "#", note.text) if note.place else note.text, bool(note.place))
        groups.setdefault(key, {})[note] = None
    return tuple(
        NoteGroup(next(iter(members)), tuple(dict.fromkeys(note.place for note in members)))
        for members in groups.values()
    )


CODES: Final[Mapping[str, str]] = {
    "compare/variants": "The variants of a comparison leave nothing to compare, or one of them is no model.",
    "design/candidates": "No or too few candidate configurations are admissible: widen limits or candidates.",
    "design/goal": "The goal of a design names no parameter of the fit, or no width of an interval.",
    "design/limits": "An excitation had to be lowered, or none fits into the limits of the joints.",
    "design/sticking-motor": "The excitation is too weak to move a motor through its friction: give it more torque.",
    "excitation/lines": "The excited lines, their phases and the period do not go together.",
    "excitation/power": "The power of the excitation, or its division among the lines, cannot be had as asked.",
    "experiment/diverged": "The simulated robot was lost: its controller does not hold it on its path.",
    "experiment/limits": "A posture, a torque or a motion is beyond the limits of the robot.",
    "experiment/simulated": "A key of the simulated rig does not go with the robot, or was changed.",
    "export/not-representable": "The target of an export has no form for a part of this robot.",
    "export/target": "There is no such target of an export.",
    "files/damaged": "A file is damaged, cut short or of another kind than its name says: make or export it again.",
    "files/folder": "Results cannot be written into this folder: name another one.",
    "files/kind": "A file or folder of another kind is expected here; `elastid inspect` shows its content.",
    "files/missing": "There is no such file; a path is relative to the file that names it.",
    "files/table": "The rows and columns of a table do not go together.",
    "files/unsafe": "A file points to other files, or claims more than it holds, and is not opened.",
    "files/version": "A result was written by another version of elastid.",
    "filter/inconsistent": "The innovations of the friction filter are not those of its model: do not trust its bands.",
    "filter/not-excited": "The motion does not inform all states of the friction filter: their bands are wide.",
    "filter/record": "A record cannot be followed by the friction filter.",
    "filter/start": "A friction filter lacks a law, an inertia or a motion to start from.",
    "fit/at-bound": "A parameter ended at its bound: widen it, or look for what the model lacks.",
    "fit/bootstrap": "Draws of the bootstrap failed and are left out.",
    "fit/correlated": "Two parameters are strongly correlated: further postures or sensors separate them.",
    "fit/frequency-unit": "Frequencies are probably in another unit than stated.",
    "fit/held-as-exact": "What numbers of the robot's file that are held as exact would move, if they were off.",
    "fit/impossible-inertia": "A fitted inertia is one that no rigid body has: hold it, or give it a prior.",
    "fit/likely-cause": "The residuals exceed the noise, and this is the likeliest cause, or none explains them.",
    "fit/loads": "Load tests and responses contradict one another, or a load test cannot be used.",
    "fit/misfit": "The model does not describe the data: the numbers are not to be believed as they stand.",
    "fit/no-robot": "A result holds no robot: fit again with this version.",
    "fit/no-start": "No start leads to an optimum: move the start.",
    "fit/not-trusted": "The fit ended without an optimum that can be trusted.",
    "fit/parameters": "A key of fit.parameters does not go with the robot or with another key.",
    "fit/posture": "A response at a posture cannot be computed as asked.",
    "fit/posture-moved": "The robot stands or moves otherwise than its configuration says.",
    "fit/prior-contradicted": "The data contradict a prior or a tolerance of the robot's file.",
    "fit/profile": "An interval was taken from the profile of the cost.",
    "fit/responses": "Responses do not belong to this robot or do not go together.",
    "fit/starts": "Starts failed, or only one of them reached the best optimum.",
    "fit/tool": "Responses at the tool contradict those at the motors.",
    "fit/undetectable": "A part is held as rigid that no response shows; it would move the numbers by so much.",
    "fit/undetermined": "The responses do not determine these parameters: hold one, or measure elsewhere.",
    "fit/unlike-responses": "Responses of some configurations contradict those of the others.",
    "fit/weakly-determined": "The data barely constrain a parameter.",
    "fit/weights": "Weights cannot be formed from the covariance of the responses, or leave elements out.",
    "fleet/members": "Members of a fleet failed or are misfits, and are not compared.",
    "frf/barely-excited": "A channel barely stands out of its noise.",
    "frf/hits": "Hits of a hammer are double, cut, or drift.",
    "frf/inputs-together": "The experiments do not separate the inputs: take other phases or more of them.",
    "frf/lines": "Too few excited lines are in the band or in a window.",
    "frf/lines-left-out": "Lines without excitation, or without finite values, are left out.",
    "frf/method": "How the response was estimated, or why this estimator does not go with the records.",
    "frf/overload": "A sensor was overloaded: hit more softly, or take a wider range.",
    "frf/periods": "The records hold too few periods for this estimator.",
    "frf/periods-left-out": "Periods that differ from the others beyond the noise are left out.",
    "frf/records": "The records of a configuration do not go together.",
    "frf/segment": "The segments of records without a period are too short or too few.",
    "frf/transient-left-out": "Periods at the start are left out, since a transient is in them.",
    "frf/window": "The window of a local method is too wide for a resonance, or too narrow for its unknowns.",
    "friction/at-rest": "Stiffness and damping of the bristles cannot be identified from records at rest.",
    "friction/by-angle": "Friction changes with the angle.",
    "friction/inertia": "The inertia of a joint was taken from the robot's file.",
    "friction/law": "The levels do not determine this law of friction: measure at further speeds.",
    "friction/levels": "Levels of friction are not known well enough, or are impossible.",
    "friction/motion": "The friction of a motion cannot be identified.",
    "friction/no-record": "No record informs the friction of a joint.",
    "friction/passes": "Passes stick, clip, lean on gravity or move in one direction only.",
    "friction/plan": "The planned friction experiment is beyond the axis, or does not inform the law.",
    "friction/presliding": "Stiffness before sliding cannot be identified from these loops.",
    "friction/rigid-body": "The rigid body behind the friction of a motion is unknown or contradicts the robot's file.",
    "friction/warm-up": "A warm-up does not inform the thermal law.",
    "gears/coarse-encoder": "The steps of an encoder are coarse relative to the effects of its gear.",
    "gears/left-out": "An effect of a gear was looked for and left out.",
    "gears/records": "The records do not let the effects of gears be found.",
    "install/missing-package": "A package or a tool that is needed here is not installed.",
    "linear/state-space": "A state space has no form for this output or this element of the chain.",
    "live/goal": "The goal was not reached within the experiments that were allowed.",
    "live/logs": "Logs in the folder contradict the plan of the experiment.",
    "live/study": "A study lacks what the planning of the next experiment needs.",
    "modal/damping": "A resonance has too few lines for its damping, or the damping is partly that of the window.",
    "modal/lines": "Too few lines stand out of the noise to find modes.",
    "modal/poles": "No pole, or none that is narrow enough, was found in a band.",
    "model/variant": "The variant of a model does not go with the robot.",
    "nonlinear/friction-differs": "The level of friction differs between configurations or amplitudes.",
    "nonlinear/friction-left": "Friction is left in the torque, and why.",
    "nonlinear/friction-taken-out": "Friction of the motors was found and taken out of the torque.",
    "nonlinear/unexplained": "A part of the distortion is explained neither by noise nor by friction.",
    "options/invalid": "An option of the command line is wrong.",
    "predict/mismatch": "An identified robot cannot predict these logs.",
    "records/channels": "A log lacks a channel, or a channel has another shape than stated.",
    "records/clipped": "A channel is clipped.",
    "records/clock": "The time or the rate of a log is not as stated.",
    "records/cut": "Samples that are asked for are outside the log.",
    "records/disagree": "Logs of one experiment disagree.",
    "records/missing-samples": "Too many samples are missing to be filled from the other periods.",
    "records/not-excited": "An input has no excitation of its own.",
    "records/period-mismatch": "A log does not repeat with the stated period.",
    "records/quantised": "A channel has coarse steps.",
    "records/repaired": "Samples, periods or times of a log were mended from the other periods, and counted.",
    "records/same-signal": "Two channels are the same signal.",
    "records/text": "A text file cannot be read as a table of numbers.",
    "records/torque": "A measured torque is late or mirrored relative to its command.",
    "records/unused-reference": "A logged reference is not used.",
    "records/unwrapped": "Jumps of whole turns were taken out of an angle.",
    "records/values": "A channel has no finite or plausible values.",
    "responses/hold": "The hold of the commands was not taken out of responses.",
    "responses/lines": "Responses have no usable lines, or one of them twice.",
    "responses/table": "A file of responses lacks a part, or its parts do not go together.",
    "responses/units": "Units of a file of responses were taken from the file.",
    "robot/file": "A robot's file is not readable as a robot.",
    "robot/loops": "The loops of a robot do not close, are singular or lock.",
    "robot/no-rest": "The robot finds no rest at this posture: springs too soft, or signs and units wrong.",
    "robot/no-spring": "No elastic part is where one is needed.",
    "robot/operating-point": "A spring is inside its backlash at the posture of the linearisation.",
    "robot/unknown-name": "A robot has no part of this name.",
    "run/earlier-stage": "The result of an earlier stage is missing or of another study: run that stage again.",
    "study/invalid": "Keys of a study are wrong; each line names the place.",
    "study/recorded": "Channels or files of experiment.recorded do not go together.",
    "study/stage": "A study of this kind has no such stage or section.",
    "study/unknown-key": "There is no such key.",
    "study/yaml": "A file is not readable as YAML.",
    "use/gains": "No gains meet the margins, or a loop cannot be judged.",
    "use/move": "A move cannot be made within the limits and the error that are asked for.",
    "use/path": "A file of postures or poses is not readable as a path.",
    "use/unreachable": "A pose or posture is out of reach.",
    "validation/missing-mode": "A measured mode has no partner in the model.",
    "workers/cluster": "The cluster of workers cannot be used.",
    "workers/died": "Worker processes died, or could not be started.",
}
