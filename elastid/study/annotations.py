"""Annotations of the fields of sections: the type at a key path, and types in words."""

from dataclasses import MISSING, fields, is_dataclass
from functools import cache
from types import NoneType, UnionType
from typing import Annotated, Any, Literal, Union, get_args, get_origin, get_type_hints

from elastid.base.units import InUnit
from elastid.study.source import KeyPath

_SCALARS = {float: "a number", int: "a whole number", str: "a text", bool: "true or false"}


@cache
def hints_of(section: type) -> dict[str, Any]:
    """Return the annotations of a section by key."""
    return get_type_hints(section, include_extras=True)


def type_at(root: Any, path: KeyPath) -> Any:
    """Return the type of the value at a path below a section; Any for an unknown key."""
    for step in path:
        root = _child(root, step)
    return root


def names_in(annotation: Any) -> list[str]:
    """Return the keys of the sections that an annotation allows."""
    sections = [option for option in options_of(annotation) if is_dataclass(option) and isinstance(option, type)]
    return [f.name for section in sections for f in fields(section)]


def literal_choices(annotation: Any) -> list[str]:
    """Return the words of the Literal types in an annotation."""
    return [str(w) for option in options_of(annotation) if get_origin(option) is Literal for w in get_args(option)]


def describe(annotation: Any) -> str:
    """Return a type in words.

    >>> describe(tuple[float, float] | None)
    'a list of 2, each a number'
    """
    return ", or ".join(dict.fromkeys(_describe(option) for option in options_of(annotation)))


def _describe(option: Any, with_example: bool = True) -> str:
    arguments, origin = get_args(option), get_origin(option)
    if origin is Annotated:
        units = next(mark.units for mark in arguments if isinstance(mark, InUnit))
        return f"a number in {' or '.join(units)}" + (f" or a text such as '1 {units[0]}'" if with_example else "")
    if origin is Literal:
        return f"one of {', '.join(str(word) for word in arguments)}"
    if origin is tuple:
        count = "" if arguments[1:] == (...,) else f" of {len(arguments)}"
        entries = dict.fromkeys(_describe(choice, with_example=False) for choice in options_of(arguments[0]))
        return f"a list{count}, each {' or '.join(entries)}"
    if origin is dict:
        return "a mapping of names"
    if is_dataclass(option):
        obligatory = [f.name for f in fields(option) if f.default is MISSING and f.default_factory is MISSING]
        return f"a mapping with the keys {', '.join(obligatory)}" if obligatory else "a mapping ({} for the defaults)"
    return _SCALARS[option]


def options_of(annotation: Any) -> list[Any]:
    """Return the members of a union without None and `Key` metadata; one member for any other type."""
    if get_origin(annotation) is Annotated and not any(isinstance(m, InUnit) for m in annotation.__metadata__):
        return options_of(annotation.__origin__)
    if get_origin(annotation) in (Union, UnionType):
        return [option for option in get_args(annotation) if option is not NoneType]
    return [annotation]


def _child(annotation: Any, step: str | int) -> Any:
    for option in options_of(annotation):
        arguments, origin = get_args(option), get_origin(option)
        if is_dataclass(option) and isinstance(option, type):
            if step in hints_of(option):
                return hints_of(option)[str(step)]
        elif origin is dict:
            return arguments[1]
        elif origin is tuple and isinstance(step, int) and arguments:
            return arguments[0] if arguments[1:] == (...,) else arguments[min(step, len(arguments) - 1)]
    return Any
