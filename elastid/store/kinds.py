"""Kinds of values in a file by their annotations, for HDF5 and JSON; values as JSON."""

import json
import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, fields, is_dataclass
from functools import cache, reduce
from itertools import starmap
from operator import or_
from pathlib import Path
from types import NoneType, UnionType
from typing import Any, Literal, TypeAlias, Union, get_args, get_origin, get_type_hints

import numpy as np

from elastid.base.arrays import NO_LABEL, Label
from elastid.robot import Robot
from elastid.store.files import write_text

Form: TypeAlias = Literal["scalar", "text", "array", "optional", "union", "fields", "sequence", "record", "mapping"]
_SCALARS = (bool, int, float, str)
SCHEMA = 1  # version of summary.json, validation.json and compare.json


@dataclass(frozen=True)
class Kind:
    """Form of a value in a file, its type, and the types of the values in it (parts).

    scalar: a number or text of `type`, one of `choices` if there are any.  array: numbers of `type`.  text: a robot, as
    JSON.  optional: parts[0] or None.  union: one of several dataclasses.  fields: a dataclass `type`.  sequence: a
    tuple of parts[0].  record: a tuple of fixed length.  mapping: from texts to parts[0].
    """

    form: Form
    type: Any = None
    parts: tuple[Any, ...] = ()
    choices: tuple[Any, ...] = ()


@dataclass(frozen=True)
class FieldKind:
    """Field of a dataclass.  may_be_empty: True if its default is an empty tuple or mapping."""

    name: str
    annotation: Any
    label: Label
    may_be_empty: bool


def _kind_of_annotation(annotation: Any) -> Kind:
    """Return the kind of a value by its annotation; TypeError for a type that cannot be stored."""
    origin, arguments = get_origin(annotation), get_args(annotation)
    if annotation in _SCALARS:
        return Kind("scalar", annotation)
    if origin is Literal:
        return Kind("scalar", type(arguments[0]), choices=arguments)
    # From NumPy 2.5 and Python 3.12 on, the alias of arrays is a type with a __value__.
    if get_origin(getattr(origin, "__value__", annotation)) is np.ndarray:
        number = arguments[-1]
        return Kind("array", get_args(number)[0] if get_origin(number) is np.dtype else number)
    if origin in (Union, UnionType):
        present = tuple(option for option in arguments if option is not NoneType)
        if len(present) < len(arguments):
            return Kind("optional", parts=(present[0] if len(present) == 1 else reduce(or_, present),))
        return Kind("union", parts=arguments)
    if origin is tuple:
        return Kind("sequence", parts=arguments[:1]) if arguments[1:] == (...,) else Kind("record", parts=arguments)
    if origin in (dict, Mapping):
        return Kind("mapping", parts=arguments[1:])
    if annotation is Robot:  # its numbers may also be texts
        return Kind("text", annotation)
    if is_dataclass(annotation):
        return Kind("fields", annotation)
    raise TypeError(f"{annotation} has no place in a file")


kind_of_annotation: Callable[[Any], Kind] = cache(_kind_of_annotation)  # so typed, since types are not Hashable


def _fields_of(kind: Any) -> tuple[FieldKind, ...]:
    """Return the fields of a dataclass that its constructor takes."""
    hints = get_type_hints(kind)
    return tuple(
        FieldKind(
            f.name, hints[f.name], f.metadata.get("label", NO_LABEL), f.default == () or f.default_factory is dict
        )
        for f in fields(kind)
        if f.init
    )


fields_of: Callable[[Any], tuple[FieldKind, ...]] = cache(_fields_of)


@cache
def needs_groups(annotation: Any, label: Label = NO_LABEL) -> bool:
    """Return True if each value of a tuple needs a group for its arrays; a label can request a table instead."""
    form = kind_of_annotation(annotation).form
    return form == "union" or (form in ("fields", "record") and not label.rows and _has_arrays(annotation))


def _has_arrays(annotation: Any) -> bool:
    kind = kind_of_annotation(annotation)
    inner = [slot.annotation for slot in fields_of(annotation)] if kind.form == "fields" else kind.parts
    return kind.form in ("array", "union") or any(_has_arrays(slot) for slot in inner)


def text_of(value: Any, indent: int | None = None) -> str:
    """Return a section of a study as JSON, without default values."""
    kind: Any = type(value)
    return str(_adapter(kind).dump_json(value, indent=indent, exclude_defaults=True), "utf-8")


def from_text(text: str, kind: Any) -> Any:
    """Return the section of a study from its JSON (`text_of`); raise ValueError for another text."""
    return _adapter(kind).validate_json(text)


@cache
def _adapter(kind: Any) -> Any:
    from pydantic import TypeAdapter  # a slow import

    return TypeAdapter(kind)


def or_null(number: float) -> float | None:
    """Return a finite number, and None in place of NaN and infinity, which JSON lacks."""
    return number if math.isfinite(number) else None


def or_text(number: float) -> float | str | None:
    """Return a finite number, None in place of NaN, and infinity as text."""
    return None if math.isnan(number) else number if math.isfinite(number) else str(number)


def json_value(value: Any, number: Callable[[float], Any] = or_null) -> Any:
    """Convert tuples and arrays to lists, mappings and dataclasses to objects, for JSON.

    number: converts every floating-point number; `float` keeps all numbers and the shapes of arrays for `from_json`.
    """
    if number is float and isinstance(value, np.ndarray):
        flat = value.ravel()
        return {"shape": value.shape, "values": (flat.view(float) if flat.dtype == complex else flat).tolist()}
    if isinstance(value, np.ndarray | np.generic):
        value = value.tolist()
    if isinstance(value, float):
        return number(float(value))
    if isinstance(value, Mapping):
        return {name: json_value(entry, number) for name, entry in value.items()}
    if isinstance(value, list | tuple):
        return [json_value(entry, number) for entry in value]
    if hasattr(value, "__dataclass_fields__"):
        return {field_.name: json_value(getattr(value, field_.name), number) for field_ in fields_of(type(value))}
    return value


def write_json(path: Path, content: Any, number: Callable[[float], Any] = or_null) -> None:
    """Write values as a JSON file, whole or not at all; number: converts every floating-point number."""
    write_text(path, json.dumps(json_value(content, number), indent=1, allow_nan=False) + "\n")


def from_json(content: Any, annotation: Any) -> Any:
    """Read a value of a type from JSON; raise KeyError, TypeError or ValueError for content of another type."""
    kind = kind_of_annotation(annotation)
    match kind.form:
        case "optional":
            return None if content is None else from_json(content, kind.parts[0])
        case "scalar":
            return math.nan if kind.type is float and content is None else kind.type(content)
        case "array" if isinstance(content, np.ndarray):
            return content
        case "array" if isinstance(content, list):
            return np.array([math.nan if number is None else number for number in content], kind.type)
        case "array":
            convert = float if kind.type is np.complex128 else kind.type
            return np.array(content["values"], convert).view(kind.type).reshape(content["shape"])
        case "fields":
            if not content.keys() <= {slot.name for slot in fields_of(kind.type)}:
                raise ValueError(f"{', '.join(content)} are not the fields of {kind.type.__name__}")
            slots = [slot for slot in fields_of(kind.type) if slot.name in content]
            return kind.type(**{slot.name: from_json(content[slot.name], slot.annotation) for slot in slots})
        case "mapping":
            return {name: from_json(entry, kind.parts[0]) for name, entry in content.items()}
        case "sequence":
            return tuple(from_json(entry, kind.parts[0]) for entry in content)
        case _:
            return tuple(starmap(from_json, zip(content, kind.parts, strict=True)))
