"""`@section`, a frozen dataclass that can be read from a study, unknown keys refused, and `Key`, the text of a field.

Each section of a study lives in the room that uses it and knows no YAML; `study` only gathers them.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import MISSING, dataclass, field, fields
from functools import cache
from types import NoneType, UnionType
from typing import Annotated, Any, Literal, TypeVar, Union, dataclass_transform, get_args, get_origin, get_type_hints

from elastid.base.names import NameRule, check_different
from elastid.base.units import InUnit

T = TypeVar("T")

# Read by pydantic when `study` validates the class, plain data otherwise. A name such as 1 needs no quotes.
_CONFIG = {"extra": "forbid", "coerce_numbers_to_str": True, "allow_inf_nan": False}


@dataclass(frozen=True)
class Key:
    """Text of a key of a study, in the annotation of its field: `Annotated[Time, Key("Period of ...", "longer ...")]`.

    text: the meaning; its first sentence needs no context.  advice: when to change the key, and the effect of it.
    above, least: bounds of its number, or of each of several; None for any.
    """

    text: str
    advice: str
    above: float | None = None
    least: float | None = None

    def refusal(self, number: float) -> str:
        """Why a number is out of the bounds; empty where it is not."""
        if self.above is not None and not number > self.above:
            return f"it must be above {self.above:g}" if self.above else "it must be positive"
        if self.least is not None and not number >= self.least:
            return f"it must be at least {self.least:g}" if self.least else "it must not be negative"
        return ""


def check_band(band_hz: tuple[float, float] | None) -> None:
    """Refuse a band that is empty or upside down; ValueError."""
    if band_hz is not None and not 0 <= band_hz[0] < band_hz[1]:
        raise ValueError(f"band_hz is [{band_hz[0]:g}, {band_hz[1]:g}]; give [lowest, highest]")


@dataclass_transform(frozen_default=True, field_specifiers=(field,))
def section(cls: type[T]) -> type[T]:
    """A frozen dataclass whose fields are the keys that a study may give.

    Made in Python, it refuses a word that is none of its choices, a text instead of a number and a text that is no
    name where one is due (`base.names`), by ValueError, and takes a list or an array for a tuple.
    """
    check: Callable[[T], None] | None = cls.__dict__.get("__post_init__")

    def checked(self: T) -> None:
        kind: Any = type(self)
        for name, rules in _rules(kind).items():
            given = getattr(self, name)
            value = rules.checked(kind.__name__, name, given)
            if value is not given:
                object.__setattr__(self, name, value)
        if check is not None:
            check(self)

    cls.__post_init__ = checked  # type: ignore[attr-defined]
    cls.__pydantic_config__ = _CONFIG  # type: ignore[attr-defined]
    return dataclass(frozen=True)(cls)


@dataclass(frozen=True)
class _Rules:
    """Rules of a field, by its annotation.

    expected: what may be given as a message says, of words of a choice, numbers and tuples alone.  key: with bounds.
    unit: behind a number where the name of the field does not say it.  names: of the value, or, by_name, of its keys.
    """

    words: tuple[Any, ...]
    expected: str
    key: Key | None
    unit: str
    names: NameRule | None
    by_name: bool
    default: Any

    def checked(self, section: str, name: str, value: Any) -> Any:
        """The value, plain where it may be; ValueError for one that is none of the field."""
        value = _plain(value) if self.expected else value
        if self.expected and isinstance(value, str) and value not in self.words:
            raise ValueError(f"{section}: {name} is '{value}'; give {self.expected}")
        if self.names is not None and value is not None and value != self.default:
            try:
                if not self.by_name and isinstance(value, str):
                    self.names.check(value)
                elif self.by_name and isinstance(value, dict):
                    for key in value:
                        self.names.check(key)
                    check_different("name", value)
            except ValueError as error:
                raise ValueError(f"{name}: {error}") from None
        for number in value if isinstance(value, tuple) else (value,):
            if self.key is not None and isinstance(number, int | float) and (refused := self.key.refusal(number)):
                raise ValueError(f"{name} is {number:g}{self.unit}; {refused}")
        return value


@cache
def _rules(cls: Any) -> dict[str, _Rules]:
    """The rules of each field."""
    rules, hints, plain = {}, get_type_hints(cls, include_extras=True), get_type_hints(cls)
    for member in fields(cls):
        marks = list(_marks(hints[member.name]))
        key = next((mark for mark, _ in marks if isinstance(mark, Key)), None)
        units = next((mark.units for mark, _ in marks if isinstance(mark, InUnit)), ("1",))
        unit = "" if len(units) > 1 or units[0] in ("1", "Hz") else f" {units[0]}"
        names, by_name = next(((mark, inner) for mark, inner in marks if isinstance(mark, NameRule)), (None, False))
        default = None if member.default is MISSING else member.default
        rules[member.name] = _Rules(*_choice(plain[member.name]), key, unit, names, by_name, default)
    return rules


def _marks(hint: Any, by_name: bool = False) -> Iterator[tuple[Any, bool]]:
    """Marks of an annotation, of its alternatives and of the keys of mappings, and whether they are of keys."""
    origin, inner = get_origin(hint), get_args(hint)
    if origin is Annotated:
        yield from ((mark, by_name) for mark in inner[1:])
    inside = inner if origin in (Union, UnionType) else inner[:1] if origin in (Annotated, dict) else ()
    for argument in inside:
        yield from _marks(argument, by_name or origin is dict)


def _plain(value: Any) -> Any:
    """A list or an array as a tuple, an array's number as one of Python: what is in a section has a hash."""
    value = value.tolist() if hasattr(value, "tolist") else value
    return tuple(map(_plain, value)) if isinstance(value, list) else value


def _choice(hint: Any) -> tuple[tuple[Any, ...], str]:
    """Words of a choice, and what may be given as a message says: empty unless words, numbers and tuples alone."""
    kinds = get_args(hint) if get_origin(hint) in (Union, UnionType) else (hint,)
    words = tuple(word for kind in kinds if get_origin(kind) is Literal for word in get_args(kind))
    numbers, tuples = {int, float} & {*kinds}, {kind for kind in kinds if get_origin(kind) is tuple}
    if any(get_origin(kind) is not Literal for kind in {*kinds} - numbers - tuples - {NoneType}):
        return words, ""
    expected = [f"one of {', '.join(map(str, words))}"] if words else []
    expected += ["a number in SI (text with a unit is for the file of a study)"] if numbers else []
    return words, ", or ".join([*expected, *(["a tuple"] if tuples else [])])
