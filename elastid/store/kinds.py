"""Kinds of the fields of a value, by their annotations; the layout of a file, HDF5 or JSON, follows from them alone."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, fields, is_dataclass
from functools import cache, reduce
from operator import or_
from types import NoneType, UnionType
from typing import Any, Literal, TypeAlias, Union, get_args, get_origin, get_type_hints

import numpy as np

from elastid.base.arrays import NO_LABEL, Label, label_of
from elastid.robot import Robot

Form: TypeAlias = Literal["scalar", "text", "array", "optional", "union", "fields", "sequence", "record", "mapping"]
_SCALARS = (bool, int, float, str)
# Version of the form of summary.json and validation.json.
SCHEMA = 1


@dataclass(frozen=True)
class Kind:
    """Form of a value in a file and what it consists of.

    scalar: a number or text of `type`, one of `choices` where there are any.  array: of `type` as NumPy's.
    text: a robot, as JSON.
    optional: parts[0] or None.  union: one of several dataclasses.  fields: a dataclass `type`.
    sequence: a tuple of parts[0].  record: a tuple of fixed parts.  mapping: from texts to parts[0].
    """

    form: Form
    type: Any = None
    parts: tuple[Any, ...] = ()
    choices: tuple[Any, ...] = ()


@dataclass(frozen=True)
class FieldKind:
    """A field of a dataclass.  may_be_empty: an empty tuple or mapping is its default."""

    name: str
    annotation: Any
    label: Label
    may_be_empty: bool


def _kind_of_annotation(annotation: Any) -> Kind:
    """The kind of an annotated value; TypeError for a type that has no place in a file."""
    origin, arguments = get_origin(annotation), get_args(annotation)
    if annotation in _SCALARS:
        return Kind("scalar", annotation)
    if origin is Literal:
        return Kind("scalar", type(arguments[0]), choices=arguments)
    if is_array(annotation):
        number = arguments[-1]
        return Kind("array", get_args(number)[0] if get_origin(number) is np.dtype else number)
    if origin in (Union, UnionType):
        present = tuple(each for each in arguments if each is not NoneType)
        if len(present) < len(arguments):
            return Kind("optional", parts=(present[0] if len(present) == 1 else reduce(or_, present),))
        return Kind("union", parts=arguments)
    if origin is tuple:
        return Kind("sequence", parts=arguments[:1]) if arguments[1:] == (...,) else Kind("record", parts=arguments)
    if origin in (dict, Mapping):
        return Kind("mapping", parts=arguments[1:])
    if annotation is Robot:  # whose numbers may be words, too
        return Kind("text", annotation)
    if is_dataclass(annotation):
        return Kind("fields", annotation)
    raise TypeError(f"{annotation} has no place in a file")


kind_of_annotation: Callable[[Any], Kind] = cache(_kind_of_annotation)


def _fields_of(kind: Any) -> tuple[FieldKind, ...]:
    """The fields that a dataclass is made of."""
    hints = get_type_hints(kind)
    return tuple(
        FieldKind(each.name, hints[each.name], label_of(each), each.default == () or each.default_factory is dict)
        for each in fields(kind)
        if each.init
    )


fields_of: Callable[[Any], tuple[FieldKind, ...]] = cache(_fields_of)


@cache
def has_own_groups(annotation: Any, label: Label = NO_LABEL) -> bool:
    """True where each value of a tuple has a group: of dataclasses with arrays, unless its label says rows."""
    kind = kind_of_annotation(annotation)
    return kind.form == "union" or (kind.form == "fields" and not label.rows and _has_arrays(annotation))


def _has_arrays(annotation: Any) -> bool:
    kind = kind_of_annotation(annotation)
    inner = [each.annotation for each in fields_of(annotation)] if kind.form == "fields" else kind.parts
    return kind.form in ("array", "union") or any(_has_arrays(each) for each in inner)


def is_array(annotation: Any) -> bool:
    """True for a type of arrays; NumPy's alias of it is a type of its own from 2.5 and Python 3.12 on."""
    alias = getattr(get_origin(annotation), "__value__", annotation)
    return get_origin(alias) is np.ndarray


def text_of(value: Any, indent: int | None = None) -> str:
    """A section of a study as JSON without what is at its default."""
    kind: Any = type(value)
    return str(_adapter(kind).dump_json(value, indent=indent, exclude_defaults=True), "utf-8")


def from_text(text: str, kind: Any) -> Any:
    """The section of `text_of`; ValueError for text that is none."""
    return _adapter(kind).validate_json(text)


@cache
def _adapter(kind: Any) -> Any:
    from pydantic import TypeAdapter  # takes a while

    return TypeAdapter(kind)


def or_null(number: float) -> float | None:
    """A finite number, and null in place of others, which JSON lacks."""
    return number if math.isfinite(number) else None


def or_text(number: float) -> float | str | None:
    """A finite number, null in place of NaN, and an infinite one as text."""
    return None if math.isnan(number) else number if math.isfinite(number) else str(number)


def json_value(value: Any, number: Callable[[float], Any] = or_null) -> Any:
    """Lists of tuples and arrays, objects of mappings and dataclasses; number: of every floating-point number.

    float: to be read again by `from_json`; arrays then have their shape.
    """
    if number is float and isinstance(value, np.ndarray):
        flat = value.ravel()
        return {"shape": value.shape, "values": (flat.view(float) if flat.dtype == complex else flat).tolist()}
    if isinstance(value, np.ndarray | np.generic):
        value = value.tolist()
    if isinstance(value, float):
        return number(float(value))
    if isinstance(value, Mapping):
        return {name: json_value(each, number) for name, each in value.items()}
    if isinstance(value, list | tuple):
        return [json_value(each, number) for each in value]
    if hasattr(value, "__dataclass_fields__"):
        return {each.name: json_value(getattr(value, each.name), number) for each in fields_of(type(value))}
    return value


def from_json(content: Any, annotation: Any) -> Any:
    """The value of a type; KeyError, TypeError or ValueError for content that is none of that type."""
    kind = kind_of_annotation(annotation)
    match kind.form:
        case "optional":
            return None if content is None else from_json(content, kind.parts[0])
        case "scalar":
            return math.nan if kind.type is float and content is None else kind.type(content)
        case "array" if isinstance(content, list):
            return np.array([math.nan if each is None else each for each in content], kind.type)
        case "array":
            part = float if kind.type is np.complex128 else kind.type
            return np.array(content["values"], part).view(kind.type).reshape(content["shape"])
        case "fields":
            if not content.keys() <= {each.name for each in fields_of(kind.type)}:
                raise ValueError(f"{', '.join(content)} are not the fields of {kind.type.__name__}")
            known = [each for each in fields_of(kind.type) if each.name in content]
            return kind.type(**{each.name: from_json(content[each.name], each.annotation) for each in known})
        case "mapping":
            return {name: from_json(each, kind.parts[0]) for name, each in content.items()}
        case "sequence":
            return tuple(from_json(each, kind.parts[0]) for each in content)
        case _:
            return tuple(from_json(each, part) for each, part in zip(content, kind.parts, strict=True))
