"""Any frozen dataclass as a group of HDF5, field by field, and back by the types of its fields.

Numbers and texts are attributes, arrays and tuples of either datasets, other tuples groups with an entry for each
member, mappings a dataset of their names beside their values; None is absent.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields, is_dataclass
from functools import cache
from types import NoneType, UnionType
from typing import Any, Literal, TypeVar, Union, get_args, get_origin, get_type_hints

import numpy as np

from elastid.store.files import attribute, scale, texts

T = TypeVar("T")
_SCALARS = (bool, int, float, str)


def write_value(group: Any, name: str, value: Any) -> None:
    """A value of a dataclass below a group; TypeError for a type that has no place in a file."""
    if value is None:
        return
    if isinstance(value, bool | int | str):
        group.attrs[name] = value
    elif isinstance(value, float):
        group.attrs[name] = float(value)
    elif isinstance(value, np.ndarray):
        group.create_dataset(name, data=value)
    elif isinstance(value, tuple):
        _write_tuple(group, name, value)
    elif isinstance(value, Mapping):
        inner = group.create_group(name)
        scale(inner, "names", tuple(value), "names of the values")
        _write_tuple(inner, "values", tuple(value.values()))
    elif is_dataclass(value):
        inner = group.create_group(name)
        for field in fields(value):
            write_value(inner, field.name, getattr(value, field.name))
    else:
        raise TypeError(f"{name} is a {type(value).__name__}, which has no place in a file")


def _write_tuple(group: Any, name: str, value: tuple[Any, ...]) -> None:
    if value and all(isinstance(each, str) for each in value):
        scale(group, name, value, name)
    elif value and all(isinstance(each, bool | int | float) for each in value):
        group.create_dataset(name, data=np.array(value))
    else:
        inner = group.create_group(name)
        inner.attrs["length"] = len(value)
        for i, each in enumerate(value):
            write_value(inner, str(i), each)


def is_array(kind: Any) -> bool:
    """Whether a type is that of an array; NumPy's alias of it is a type of its own from 2.5 and Python 3.12 on."""
    alias = getattr(get_origin(kind), "__value__", kind)
    return get_origin(alias) is np.ndarray


def read_value(group: Any, name: str, kind: Any) -> Any:
    """The value of a type that `write_value` has left below a group."""
    origin, arguments = get_origin(kind), get_args(kind)
    if origin in (Union, UnionType):
        present = name in group or name in group.attrs
        chosen = [option for option in arguments if option is not NoneType]
        return read_value(group, name, _stored_kind(group, name, chosen)) if present else None
    if origin is Literal:
        return attribute(group, name)
    if kind in _SCALARS:
        return kind(attribute(group, name))
    if is_array(kind):
        return group[name][()]
    if origin is tuple:
        return _read_tuple(group, name, arguments)
    if is_dataclass(kind):
        return _read_fields(group[name], kind)
    inner, of = group[name], arguments[1]  # a mapping
    return dict(zip(texts(inner, "names"), _read_tuple(inner, "values", (of, ...)), strict=True))


def _stored_kind(group: Any, name: str, options: list[Any]) -> Any:
    """Of several dataclasses the one whose fields were stored; the first option otherwise."""
    if len(options) == 1 or not all(is_dataclass(option) for option in options):
        return options[0]
    stored = {*group[name], *group[name].attrs}
    return min(options, key=lambda option: len(stored ^ set(_hints(option))))


def read_dataclass(group: Any, name: str, kind: type[T]) -> T:
    """A dataclass below a group."""
    found: T = _read_fields(group[name], kind)
    return found


def _read_fields(group: Any, kind: Any) -> Any:
    known = {name: read_value(group, name, hint) for name, hint in _hints(kind).items()}
    return kind(**known)


def _read_tuple(group: Any, name: str, arguments: tuple[Any, ...]) -> tuple[Any, ...]:
    entry = group[name]
    if "length" in entry.attrs:
        n = int(entry.attrs["length"])
        kinds = (arguments[0],) * n if arguments[1:] == (...,) else arguments
        return tuple(read_value(entry, str(i), of) for i, of in enumerate(kinds))
    if entry.dtype.kind == "O":
        return texts(group, name)
    return tuple(entry[()].tolist())


@cache
def _hints(kind: Any) -> dict[str, Any]:
    hints = get_type_hints(kind)
    return {field.name: hints[field.name] for field in fields(kind) if field.init}
