"""`@section`, a frozen dataclass that can be read from a study, unknown keys refused, and `Key`, the text of a field.

Each section of a study lives in the room that uses it and knows no YAML; `study` only gathers them.
"""

from __future__ import annotations

from collections.abc import Callable
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


@dataclass_transform(frozen_default=True, field_specifiers=(field,))
def section(cls: type[T]) -> type[T]:
    """A frozen dataclass whose fields are the keys that a study may give.

    Made in Python, it refuses a word that is none of its choices, a text instead of a number and a text that is no
    name where one is due (`base.names`), by ValueError, and takes a list or an array for a tuple.
    """
    check: Callable[[T], None] | None = cls.__dict__.get("__post_init__")

    def checked(self: T) -> None:
        kind: Any = type(self)
        for name, (words, expected) in _plain_fields(kind).items():
            given = getattr(self, name)
            value = _plain(given)
            if value is not given:
                object.__setattr__(self, name, value)
            if isinstance(value, str) and value not in words:
                raise ValueError(f"{kind.__name__}: {name} is '{value}'; give {expected}")
        _check_names(self)
        _check_bounds(self)
        if check is not None:
            check(self)

    cls.__post_init__ = checked  # type: ignore[attr-defined]
    cls.__pydantic_config__ = _CONFIG  # type: ignore[attr-defined]
    return dataclass(frozen=True)(cls)


def _check_names(owner: Any) -> None:
    """ValueError for a field that is no name, or a mapping by names whose keys are none or the same but for case."""
    kind: Any = type(owner)
    for name, (rule, default) in _name_rules(kind).items():
        given = getattr(owner, name)
        if given is None or given == default or isinstance(given, str) != isinstance(rule, NameRule):
            continue
        try:
            if isinstance(rule, NameRule):
                rule.check(given)
            elif isinstance(given, dict):
                for key in given:
                    rule[0].check(key)
                check_different("name", given)
        except ValueError as error:
            raise ValueError(f"{name}: {error}") from None


def _check_bounds(owner: Any) -> None:
    """ValueError for a number that is out of the bounds of its key."""
    kind: Any = type(owner)
    for name, (key, unit) in _bounded(kind).items():
        given = getattr(owner, name)
        for number in given if isinstance(given, tuple) else (given,):
            if isinstance(number, int | float) and (refused := key.refusal(number)):
                raise ValueError(f"{name} is {number:g}{unit}; {refused}")


@cache
def _bounded(cls: Any) -> dict[str, tuple[Key, str]]:
    """The keys with bounds, and the unit behind a number where the name does not say it."""
    bounded = {}
    for name, hint in get_type_hints(cls, include_extras=True).items():
        marks = list(getattr(hint, "__metadata__", ()))
        inner = get_args(hint)[0] if marks else None
        marks += [m for each in _alternatives(inner) for m in getattr(each, "__metadata__", ())]
        units = next((mark.units for mark in marks if isinstance(mark, InUnit)), ("1",))
        for key in (mark for mark in marks if isinstance(mark, Key) and (mark.above, mark.least) != (None, None)):
            bounded[name] = key, "" if len(units) > 1 or units[0] in ("1", "Hz") else f" {units[0]}"
    return bounded


@cache
def _name_rules(cls: Any) -> dict[str, tuple[NameRule | tuple[NameRule], Any]]:
    """The fields that are names, and in a tuple those that are mappings by names: their rule and default."""
    rules: dict[str, tuple[NameRule | tuple[NameRule], Any]] = {}
    hints = get_type_hints(cls, include_extras=True)
    for each in fields(cls):
        default = None if each.default is MISSING else each.default
        whole = hints[each.name]
        inner = get_args(whole)[0] if get_origin(whole) is Annotated else whole
        has_members = get_origin(inner) in (dict, Union, UnionType)  # otherwise the rule is a mark of the field
        for hint in _alternatives(inner) if has_members else (whole,):
            by_name = get_origin(hint) is dict
            marked = get_args(hint)[0] if by_name else hint
            marks = get_args(marked) if get_origin(marked) is Annotated else ()
            for rule in (mark for mark in marks if isinstance(mark, NameRule)):
                rules[each.name] = (rule,) if by_name else rule, default
    return rules


def _plain(value: Any) -> Any:
    """A list or an array as a tuple, an array's number as one of Python: what is in a section has a hash."""
    value = value.tolist() if hasattr(value, "tolist") else value
    return tuple(map(_plain, value)) if isinstance(value, list) else value


@cache
def _plain_fields(cls: Any) -> dict[str, tuple[tuple[Any, ...], str]]:
    """The fields that are words of a choice, numbers or tuples: the words, and what may be given as a message says."""
    plain = {}
    for name, hint in get_type_hints(cls).items():
        kinds = [kind for kind in _alternatives(hint) if kind is not NoneType]
        words = tuple(word for kind in kinds if get_origin(kind) is Literal for word in get_args(kind))
        others = [kind for kind in kinds if get_origin(kind) is not Literal]
        numbers, tuples = ([k for k in others if k in (int, float)], [k for k in others if get_origin(k) is tuple])
        if kinds and len(numbers) + len(tuples) == len(others):
            expected = [f"one of {', '.join(map(str, words))}"] if words else []
            expected += ["a number in SI (text with a unit is for the file of a study)"] if numbers else []
            plain[name] = words, ", or ".join([*expected, *(["a tuple"] if tuples else [])])
    return plain


def _alternatives(hint: Any) -> tuple[Any, ...]:
    return get_args(hint) if get_origin(hint) in (Union, UnionType) else (hint,)
