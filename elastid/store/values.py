"""Values as groups of HDF5 or as JSON: the one writer of all artefacts, by the fields of frozen dataclasses alone.

A dataclass is a group, numbers and texts in it are attributes, arrays datasets with unit, meaning and dimension scales.
None is absent, and so is an empty tuple or mapping that is the default.  A tuple of numbers or texts is a dataset.  A
tuple of dataclasses is a table, with a column for each field; where these hold arrays, it is a group with an entry for
each instead.  A mapping is a group of `names` and `values`.  A column of anything but numbers, texts, arrays of one
shape and dataclasses is JSON, a text for each row.
"""

import json
import math
import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, fields, is_dataclass
from functools import cache, reduce
from itertools import starmap
from operator import attrgetter, or_
from pathlib import Path
from types import MappingProxyType, NoneType, UnionType
from typing import Any, Literal, TypeAlias, Union, get_args, get_origin, get_type_hints

import numpy as np
from h5py import h5ds

from elastid.base.arrays import NO_LABEL, Label, unit_of_name
from elastid.base.escape import group_name
from elastid.base.large_arrays import PIECE_VALUES, LargeArray, release
from elastid.robot import Robot
from elastid.store.artefacts import NO_STAMP, TEXT, Stamp, create_artefact
from elastid.store.files import write_text

Form: TypeAlias = Literal["scalar", "text", "array", "optional", "union", "fields", "sequence", "record", "mapping"]
_SCALARS = (bool, int, float, str)
# Version of the form of summary.json, validation.json and compare.json.
SCHEMA = 1


@dataclass(frozen=True)
class Kind:
    """Form of a value in a file and the types of its parts.

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
    """Return the kind of an annotated value; TypeError for a type that has no place in a file."""
    origin, arguments = get_origin(annotation), get_args(annotation)
    if annotation in _SCALARS:
        return Kind("scalar", annotation)
    if origin is Literal:
        return Kind("scalar", type(arguments[0]), choices=arguments)
    # NumPy's alias of arrays is a type of its own from 2.5 and Python 3.12 on.
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
    if annotation is Robot:  # whose numbers may be words, too
        return Kind("text", annotation)
    if is_dataclass(annotation):
        return Kind("fields", annotation)
    raise TypeError(f"{annotation} has no place in a file")


kind_of_annotation: Callable[[Any], Kind] = cache(_kind_of_annotation)


def _fields_of(kind: Any) -> tuple[FieldKind, ...]:
    hints = get_type_hints(kind)
    return tuple(
        FieldKind(
            p.name, hints[p.name], p.metadata.get("label", NO_LABEL), p.default == () or p.default_factory is dict
        )
        for p in fields(kind)
        if p.init
    )


fields_of: Callable[[Any], tuple[FieldKind, ...]] = cache(_fields_of)


@cache
def needs_groups(annotation: Any, label: Label = NO_LABEL) -> bool:
    """Return True if each value of a tuple has a group, for its arrays; a label can request rows instead."""
    form = kind_of_annotation(annotation).form
    return form == "union" or (form in ("fields", "record") and not label.rows and _has_arrays(annotation))


def _has_arrays(annotation: Any) -> bool:
    kind = kind_of_annotation(annotation)
    inner = [slot.annotation for slot in fields_of(annotation)] if kind.form == "fields" else kind.parts
    return kind.form in ("array", "union") or any(_has_arrays(slot) for slot in inner)


def text_of(value: Any, indent: int | None = None) -> str:
    """Return section of a study as JSON, without default values."""
    kind: Any = type(value)
    return str(_adapter(kind).dump_json(value, indent=indent, exclude_defaults=True), "utf-8")


def from_text(text: str, kind: Any) -> Any:
    """Return section from the text of `text_of`; raise ValueError for other text."""
    return _adapter(kind).validate_json(text)


@cache
def _adapter(kind: Any) -> Any:
    from pydantic import TypeAdapter  # takes a while

    return TypeAdapter(kind)


def or_null(number: float) -> float | None:
    """Return a finite number, and null in place of others, which JSON lacks."""
    return number if math.isfinite(number) else None


def or_text(number: float) -> float | str | None:
    """Return a finite number, null in place of NaN, and an infinite one as text."""
    return None if math.isnan(number) else number if math.isfinite(number) else str(number)


def json_value(value: Any, number: Callable[[float], Any] = or_null) -> Any:
    """Return lists of tuples and arrays, objects of mappings and dataclasses; number: of every floating-point number.

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
        return {name: json_value(entry, number) for name, entry in value.items()}
    if isinstance(value, list | tuple):
        return [json_value(entry, number) for entry in value]
    if hasattr(value, "__dataclass_fields__"):
        return {field_.name: json_value(getattr(value, field_.name), number) for field_ in fields_of(type(value))}
    return value


def write_json(path: Path, content: Any, number: Callable[[float], Any] = or_null) -> None:
    """Write values as a file of JSON, whole or absent; number: converts every floating-point number."""
    write_text(path, json.dumps(json_value(content, number), indent=1, allow_nan=False) + "\n")


def from_json(content: Any, annotation: Any) -> Any:
    """Return the value of a type from JSON; raise KeyError, TypeError or ValueError for content of another type."""
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


# Texts along a group of named entries, whose own names are escaped: none of them is this.
NAMES = "%names"
# Units of time and frequency where the sampling rate is not known.
_UNIT_OF_SAMPLES = {"s": "samples", "Hz": "sampling rate"}


@dataclass
class _Scope:
    """A group that is being filled, the value of its fields, and the datasets in it that may be axes of others."""

    group: Any
    value: Any
    axes: dict[str, Any] = field(default_factory=dict)


def write_value(
    group: Any, name: str, value: Any, annotation: Any = None, label: Label = NO_LABEL, above: tuple[_Scope, ...] = ()
) -> Any:
    """Write a value below a group, by its type or an annotation; TypeError for a type that no file can have.

    A tuple of entries with groups of their own may be any iterable, of which each is written before the next is taken.
    Returns the dataset that may be an axis of others, or None.
    """
    if value is None:
        return None
    kind = kind_of_annotation(type(value) if annotation is None else annotation)
    if kind.form == "optional":
        return write_value(group, name, value, kind.parts[0], label, above)
    return _WRITERS[kind.form](group, name, value, kind, label, above)


def _write_scalar(group: Any, name: str, value: Any, kind: Kind, *_: Any) -> None:
    if kind.type is str and len(value) >= 4096:  # an attribute holds 64 KB at most
        group.create_dataset(name, data=value, dtype=TEXT)
    else:
        group.attrs[name] = kind.type(value)


def _write_fields(group: Any, name: str, value: Any, kind: Kind, label: Label, above: tuple[_Scope, ...]) -> None:
    """Write a dataclass to a group; fields that are dataclasses come last, since their axes may be in this one."""
    group = group.create_group(name)
    scopes = (_Scope(group, value), *above)
    inner, with_label = [], []
    for slot in fields_of(type(value)):
        content = getattr(value, slot.name)
        if content is None or (slot.may_be_empty and not content):
            continue
        if hasattr(content, "__dataclass_fields__"):
            inner.append(slot)
            continue
        dataset = write_value(group, slot.name, content, slot.annotation, slot.label, scopes)
        if dataset is not None:
            scopes[0].axes[slot.name] = dataset
            # The times of a large record would take as much room as its signals.
            if slot.label.axes and not isinstance(content, LargeArray):
                with_label.append((dataset, slot.label.axes))
    for dataset, axes in with_label:
        _attach(dataset, axes, scopes)
    for slot in inner:
        write_value(group, slot.name, getattr(value, slot.name), slot.annotation, slot.label, scopes)


def _write_union(group: Any, name: str, value: Any, kind: Kind, label: Label, above: tuple[_Scope, ...]) -> None:
    _write_fields(group, name, value, kind, label, above)
    group[name].attrs["type"] = type(value).__name__


def _write_array(group: Any, name: str, value: Any, kind: Kind, label: Label, above: tuple[_Scope, ...]) -> Any:
    if not isinstance(value, np.memmap | LargeArray):
        dataset = group.create_dataset(name, data=value)
    else:
        dataset = group.create_dataset(name, value.shape, value.dtype)
        rows = max(1, PIECE_VALUES * len(value) // value.size)
        for first in range(0, len(value), rows):
            last = min(len(value), first + rows)
            dataset[first:last] = value.rows(first, last) if isinstance(value, LargeArray) else value[first:last]
            release(value)
    return _describe(dataset, name, label, above)


def _write_sequence(group: Any, name: str, value: Iterable[Any], kind: Kind, label: Label, above: Any) -> Any:
    (annotation,) = kind.parts
    if not needs_groups(annotation, label):
        return _write_column(group, name, tuple(value), annotation, label, above)
    entries, names, name_of = group.create_group(name), [], attrgetter(label.entry) if label.entry else None
    if name_of is not None and isinstance(value, tuple) and len(set(map(name_of, value))) < len(value):
        name_of = None
    for i, entry in enumerate(value):
        names.append(str(i) if name_of is None else str(name_of(entry)))
        write_value(entries, group_name(names[-1]), entry, annotation, above=above)
    if name_of is not None:
        entries.create_dataset(NAMES, data=names, dtype=TEXT)
    return None


def _write_record(group: Any, name: str, value: tuple[Any, ...], kind: Kind, label: Label, above: Any) -> Any:
    if _are_numbers(kind.parts):
        return _describe(group.create_dataset(name, data=np.array(value, kind.parts[0])), name, label, above)
    inner = group.create_group(name)
    for i, (entry, annotation) in enumerate(zip(value, kind.parts, strict=True)):
        write_value(inner, str(i), entry, annotation)
    return None


def _write_mapping(group: Any, name: str, value: Any, kind: Kind, label: Label, above: tuple[_Scope, ...]) -> Any:
    inner = group.create_group(name)
    names = inner.create_dataset("names", data=list(value), dtype=TEXT)
    write_value(inner, "values", tuple(value.values()), tuple[kind.parts[0], ...], label, above)  # type: ignore[name-defined]
    return names


_WRITERS: dict[str, Callable[..., Any]] = {
    "scalar": _write_scalar, "array": _write_array, "union": _write_union, "fields": _write_fields,
    "sequence": _write_sequence, "record": _write_record, "mapping": _write_mapping,
    "text": lambda group, name, value, *_: group.create_dataset(name, data=text_of(value), dtype=TEXT),
}  # fmt: skip


def _write_column(group: Any, name: str, values: Sequence[Any], annotation: Any, label: Label, above: Any) -> Any:
    """Write values of one type as a column; return the dataset that may be an axis."""
    kind = kind_of_annotation(annotation)
    if kind.form == "scalar" and kind.type is str:
        return _describe(group.create_dataset(name, data=list(values), dtype=TEXT), name, label, above)
    if kind.form == "scalar" or (kind.form == "record" and _are_numbers(kind.parts)):
        number, shape = (kind.type, (-1,)) if kind.form == "scalar" else (kind.parts[0], (-1, len(kind.parts)))
        data = np.array(values, number).reshape(shape if values else (0, *shape[1:]))
        return _describe(group.create_dataset(name, data=data), name, label, above)
    if kind.form == "array" and len({array.shape for array in values}) < 2:
        data = np.stack(values) if values else np.zeros(0, kind.type)
        return _describe(group.create_dataset(name, data=data), name, label, above)
    if kind.form == "fields":
        inner = group.create_group(name)
        inner.attrs["length"] = len(values)
        columns = [(part, [getattr(value, part.name) for value in values]) for part in fields_of(kind.type) if values]
        axes = [_write_column(inner, part.name, c, part.annotation, part.label, above) for part, c in columns]
        return axes[0] if axes else None
    group.create_dataset(name, data=[json.dumps(json_value(value, float)) for value in values], dtype=TEXT)
    return None


def _are_numbers(parts: Sequence[Any]) -> bool:
    return len(set(parts)) == 1 and parts[0] in (bool, int, float)


def _describe(dataset: Any, name: str, label: Label, scopes: tuple[_Scope, ...]) -> Any:
    if label.text:
        dataset.attrs["long_name"] = label.text
    if unit := _unit(label.unit or unit_of_name(name), scopes):
        dataset.attrs["units"] = unit
    return dataset


def _unit(unit: str, scopes: tuple[_Scope, ...]) -> str:
    if unit in _UNIT_OF_SAMPLES and not _attribute(scopes, "has_rate", True):
        return _UNIT_OF_SAMPLES[unit]

    def words(match: re.Match[str]) -> str:
        units = _attribute(scopes, match[1], "")
        return units if isinstance(units, str) else ", ".join(dict.fromkeys(units))

    return re.sub(r"\{(\w+)\}", words, unit)


def _attribute(scopes: tuple[_Scope, ...], name: str, default: Any) -> Any:
    return next((getattr(scope.value, name) for scope in scopes if hasattr(scope.value, name)), default)


def _attach(dataset: Any, axes: tuple[str, ...], scopes: tuple[_Scope, ...]) -> None:
    """Name the dimensions of a dataset; axes with values become dimension scales."""
    for i, name in enumerate(axes[: dataset.ndim]):
        h5ds.set_label(dataset.id, i, name.encode())
        scale = _scale(name, scopes)
        if scale is not None and scale.shape == (dataset.shape[i],):
            if not h5ds.is_scale(scale.id):
                h5ds.set_scale(scale.id, name.encode())
            h5ds.attach_scale(dataset.id, scale.id, i)


def _scale(name: str, scopes: tuple[_Scope, ...]) -> Any:
    """Find the dataset of an axis in this group or above; an axis from a property is written at its first use."""
    for scope in scopes:
        if name not in scope.axes and isinstance(getattr(type(scope.value), name, None), property):
            values = getattr(scope.value, name)
            scope.axes[name] = _write_array(scope.group, name, values, Kind("array"), NO_LABEL, scopes)
        if name in scope.axes:
            return scope.axes[name]
    return None


def write_artefact(
    path: Path | str,
    kind: str,
    stamp: Stamp,
    parts: Mapping[str, tuple[Any, Any]],
    entries: Mapping[str, str] = MappingProxyType({}),
) -> None:
    """Write a file of one kind from named parts, each a value and its annotation; omit empty parts.

    entries: attribute that names each value of a part that is a tuple.
    """
    with create_artefact(path, kind, stamp) as file:
        for name, (value, annotation) in parts.items():
            write_value(file, name, value, annotation, Label(entry=entries.get(name, "")))


@dataclass(frozen=True)
class Writer:
    """The function (path, value, stamp, *others) that writes files of a kind, in workers too.

    parts: annotation of each by name, None for the type of the value, and its value where none is given; the first is
    that of `value`.  entries: as of `write_artefact`.
    """

    kind: str
    entries: Mapping[str, str]
    parts: Mapping[str, tuple[Any, Any]]

    def __call__(self, path: Path | str, value: Any, stamp: Stamp = NO_STAMP, *others: Any, **named: Any) -> None:
        """Write a file at a path, in place of one that is there."""
        values = dict(zip(self.parts, (value, *others), strict=False)) | named
        content = {name: (values.get(name, default), annotation) for name, (annotation, default) in self.parts.items()}
        content = {n: (tuple(part) if isinstance(part, list) else part, type_) for n, (part, type_) in content.items()}
        write_artefact(path, self.kind, stamp, content, self.entries)


def writer(kind: str, entries: Mapping[str, str] = MappingProxyType({}), **parts: tuple[Any, Any]) -> Writer:
    """Return the writer of files of a kind with these parts."""
    return Writer(kind, dict(entries), parts)
