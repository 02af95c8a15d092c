"""Errors, which the command line turns into a message and an exit code, and notes on data and results.

Each has a code of `base.codes`; `elastid explain CODE` prints meaning and remedy.
"""

import re
from collections.abc import Iterable, Mapping, Sequence, Sized
from dataclasses import dataclass
from difflib import get_close_matches
from importlib import import_module
from types import UnionType
from typing import Any, Literal, TypeAlias, TypeVar, get_args

T = TypeVar("T")


class ElastidError(Exception):
    """Failure that the user can correct: the message states fault, location, reason and remedy.

    code: of `base.codes`, for programs ("records/period-mismatch").  text: one sentence with its numbers.  place: the
    file, line, key, configuration or channel, printed before the text.
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
    """The identification finished and its results are written, but they are not reliable: exit code 3."""

    exit_code = 3


class ProgramError(RuntimeError):
    """Fault of elastid itself in another process, with its traceback as text."""


def is_program_fault(error: BaseException) -> bool:
    """Return True for a fault of elastid itself, such as a TypeError that its code raises."""
    if isinstance(error, ProgramError):
        return True
    trace = error.__traceback__
    while trace is not None and trace.tb_next is not None:
        trace = trace.tb_next
    module = "" if trace is None else str(trace.tb_frame.f_globals.get("__name__", ""))
    is_kind = isinstance(error, TypeError | AttributeError | NameError | AssertionError | NotImplementedError)
    return is_kind and module.partition(".")[0] == __name__.partition(".")[0]


class UnknownNameError(KeyError):
    """Unknown name; the message lists the existing names."""

    def __str__(self) -> str:
        return str(self.args[0])  # without the quotes of KeyError


class NamedValues(dict[str, T]):
    """Values by name; UnknownNameError lists the existing names.

    >>> NamedValues("parameter", {"k_1": 2.0})["k_2"]
    Traceback (most recent call last):
    elastid.base.errors.UnknownNameError: no parameter k_2; there are k_1
    """

    def __init__(self, noun: str, values: Mapping[str, T]) -> None:
        super().__init__(values)
        self._noun = noun

    def __missing__(self, name: str) -> T:
        raise UnknownNameError(f"no {self._noun} {name}; there are {', '.join(self) or 'none'}")

    def __reduce__(self) -> "tuple[type[NamedValues[T]], tuple[str, dict[str, T]]]":
        return type(self), (self._noun, dict(self))


def check_kind(value: object, kind: type | UnionType, name: str, remedy: str) -> None:
    """Raise TypeError if an argument has another type. remedy: how to obtain an argument of the right type."""
    if not isinstance(value, kind):
        names = " or ".join(type_.__name__ for type_ in get_args(kind) or (kind,))
        raise TypeError(f"{name} is of type {type(value).__name__}, not {names}; {remedy}")


def index_of(name: str, names: Sequence[str], noun: str) -> int:
    """Return the index of a name; UnknownNameError lists the existing names.

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
    """Raise ValueError unless theta has one value per parameter."""
    if len(theta) != len(names):
        raise ValueError(f"theta has {len(theta)} numbers for {len(names)} parameters: {', '.join(names)}")


def did_you_mean(name: str, valid: Iterable[str], further_names: Iterable[str] = ()) -> str:
    """Return the end of a message on an unknown name: the most similar valid name, or else a list of `valid`.

    further_names: valid names that are too many for the list.

    >>> did_you_mean("bamd_hz", ["band_hz", "period"])
    "did you mean 'band_hz'?"
    >>> did_you_mean("x", ["band_hz", "period"])
    'there are band_hz, period'
    """
    names = list(valid)
    close = get_close_matches(name, [*names, *further_names], n=1)
    return f"did you mean '{close[0]}'?" if close else f"there are {', '.join(names) or 'none'}"


def require_package(module: str, extra: str, place: object = "") -> Any:
    """Import a module of an extra; StudyError with the command that installs it."""
    try:
        return import_module(module)
    except ImportError:
        text = f"{module.partition('.')[0]} is not installed; install it with `uv sync --extra {extra}`"
        raise StudyError("install/missing-package", f"{text} (or `pip install 'elastid[{extra}]'`)", place) from None


Severity: TypeAlias = Literal["information", "warning"]


@dataclass(frozen=True)
class Note:
    """Note on data, a plan or a result, with the code, text and place of an `ElastidError`.

    remedy: next step in the imperative, where other texts state the fault without it; otherwise at the end of the text.
    """

    code: str
    text: str
    place: str = ""
    severity: Severity = "warning"
    remedy: str = ""

    @property
    def fault(self) -> str:
        """Place and text, without the remedy."""
        return f"{self.place}: {self.text}" if self.place else self.text

    @property
    def sentences(self) -> str:
        """Text and remedy, without the place."""
        return ". ".join(filter(None, (self.text, self.remedy)))

    def __str__(self) -> str:
        return ". ".join(filter(None, (self.fault, self.remedy)))


@dataclass(frozen=True)
class NoteGroup:
    """Notes of one code whose texts differ at most in their numbers: the first note, and the places of all."""

    first: Note
    places: tuple[str, ...]

    def __str__(self) -> str:
        if len(self.places) == 1:
            return str(self.first)
        if len(self.places) <= 3:
            return f"{', '.join(self.places)}: {self.first.sentences}"
        return f"{self.places[0]} and {len(self.places) - 1} more: {self.first.sentences}"


def notes_of(values: Iterable[Any]) -> tuple[Note, ...]:
    """Collect the notes of several values, such as records or responses, in their order."""
    return tuple(note for value in values for note in value.notes)


def group_notes(notes: Iterable[Note]) -> tuple[NoteGroup, ...]:
    """Group equal notes, in the order of their first appearance.

    >>> for group in group_notes(Note("late-log", f"{t} samples late", f"log {i}") for i, t in enumerate((3, 4, 3, 5))):
    ...     print(group)
    log 0 and 3 more: 3 samples late
    """
    groups: dict[tuple[str, str, bool], dict[Note, None]] = {}
    for note in notes:
        # Notes without a place are grouped only if their texts are equal, numbers included.
        texts = re.sub(r"\d+(\.\d+)?", "#" if note.place else r"\g<0>", note.sentences)
        key = (note.code, texts, bool(note.place))
        groups.setdefault(key, {})[note] = None
    return tuple(NoteGroup(next(iter(n)), tuple(dict.fromkeys(note.place for note in n))) for n in groups.values())
