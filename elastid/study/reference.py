"""What may stand at a key of a study, read from the types of the sections and put into words."""

from __future__ import annotations

from dataclasses import MISSING, fields, is_dataclass
from types import NoneType, UnionType
from typing import Annotated, Any, Literal, Union, get_args, get_origin, get_type_hints

from elastid.base.units import InUnit
from elastid.study.yaml_source import KeyPath

_SCALARS = {float: "a number", int: "a whole number", str: "a text", bool: "true or false"}


def type_at(root: Any, path: KeyPath) -> Any:
    """The type of what stands at a path below a section; Any where no section has such a key."""
    for step in path:
        root = _child(root, step)
    return root


def keys_of(annotation: Any) -> list[str]:
    """The keys of the section that an annotation allows."""
    return [f.name for option in _options(annotation) if is_dataclass(option) for f in fields(option)]


def words_of(annotation: Any) -> list[str]:
    """The fixed words that an annotation allows."""
    return [str(w) for option in _options(annotation) if get_origin(option) is Literal for w in get_args(option)]


def describe(annotation: Any) -> str:
    """A type in words.

    >>> describe(tuple[float, float] | None)
    'a list of 2, each a number'
    """
    return ", or ".join(dict.fromkeys(_describe(option) for option in _options(annotation)))


def _describe(option: Any, with_example: bool = True) -> str:
    arguments, origin = get_args(option), get_origin(option)
    if origin is Annotated:
        unit = next((" or ".join(mark.units) for mark in arguments if isinstance(mark, InUnit)), None)
        if unit is None:
            return describe(arguments[0])
        return f"a number in {unit}" + (f" or a text such as '1 {unit.split()[0]}'" if with_example else "")
    if origin is Literal:
        return f"one of {', '.join(str(word) for word in arguments)}"
    if origin is tuple and arguments[1:] == (...,):
        return f"a list, each {_describe(arguments[0], with_example=False)}"
    if origin is tuple:
        return f"a list of {len(arguments)}, each {_describe(arguments[0], with_example=False)}"
    if origin is dict:
        return "a mapping of names"
    if is_dataclass(option):
        needed = [f.name for f in fields(option) if f.default is MISSING and f.default_factory is MISSING]
        return f"a mapping with the keys {', '.join(needed)}" if needed else "a mapping ({} for the defaults)"
    return _SCALARS.get(option, "something else")


def _options(annotation: Any) -> list[Any]:
    """The members of a union, None left out; one option where it is no union."""
    if get_origin(annotation) in (Union, UnionType):
        return [option for option in get_args(annotation) if option is not NoneType]
    return [annotation]


def _child(annotation: Any, step: str | int) -> Any:
    for option in _options(annotation):
        arguments, origin = get_args(option), get_origin(option)
        if is_dataclass(option) and isinstance(option, type):
            hints = get_type_hints(option, include_extras=True)
            if step in hints:
                return hints[str(step)]
        elif origin is dict:
            return arguments[1]
        elif origin is tuple and isinstance(step, int) and arguments:
            return arguments[0] if arguments[1:] == (...,) else arguments[min(step, len(arguments) - 1)]
    return Any
