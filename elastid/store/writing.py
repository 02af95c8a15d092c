"""Writer of all HDF5 artefacts: values as groups, by the fields, annotations and labels of frozen dataclasses.

A dataclass is a group, numbers and texts in it are attributes, arrays datasets with unit, meaning and dimension scales.
None is absent, and so is an empty tuple or mapping that is the default. A tuple of numbers or texts is a dataset. A
tuple of dataclasses is a table with a column for each field, or, if these contain arrays, a group with an entry for
each. A mapping is a group of `names` and `values`. A column of other values is JSON, a text for each row.
"""

import json
import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from operator import attrgetter
from pathlib import Path
from typing import Any

import numpy as np
from h5py import h5ds

from elastid.base.arrays import NO_LABEL, Label, unit_of_name
from elastid.base.escape import group_name
from elastid.base.large_arrays import PIECE_VALUES, LargeArray, release
from elastid.store.artefacts import NO_STAMP, TEXT, Stamp, create_artefact
from elastid.store.kinds import Kind, fields_of, json_value, kind_of_annotation, needs_groups, text_of

NAMES = "%names"  # dataset with the names of the entries of a group; escaped names never begin with %n
_UNIT_OF_SAMPLES = {"s": "samples", "Hz": "sampling rate"}  # units without a known sampling rate


@dataclass
class _Scope:
    """Group that is being written, the value of its fields, and its datasets that may be axes of others."""

    group: Any
    value: Any
    axes: dict[str, Any] = field(default_factory=dict)


def write_value(
    group: Any, name: str, value: Any, annotation: Any = None, label: Label = NO_LABEL, parents: tuple[_Scope, ...] = ()
) -> Any:
    """Write a value below a group, by its type or an annotation; TypeError for a type that cannot be stored.

    Entries that need groups may come from any iterable; each is written before the next one is requested.
    Returns the dataset that may be an axis of others, or None.
    """
    if value is None:
        return None
    kind = kind_of_annotation(type(value) if annotation is None else annotation)
    if kind.form == "optional":
        return write_value(group, name, value, kind.parts[0], label, parents)
    return _WRITERS[kind.form](group, name, value, kind, label, parents)


def _write_scalar(group: Any, name: str, value: Any, kind: Kind, *_: Any) -> None:
    if kind.type is str and len(value) >= 4096:  # the size of an attribute is limited to 64 KB
        group.create_dataset(name, data=value, dtype=TEXT)
    else:
        group.attrs[name] = kind.type(value)


def _write_fields(group: Any, name: str, value: Any, kind: Kind, label: Label, parents: tuple[_Scope, ...]) -> None:
    """Write a dataclass to a group; fields that are dataclasses come last, since their axes may be in this group."""
    group = group.create_group(name)
    scopes = (_Scope(group, value), *parents)
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
            # The time axis of a large record would be as large as a signal.
            if slot.label.axes and not isinstance(content, LargeArray):
                with_label.append((dataset, slot.label.axes))
    for dataset, axes in with_label:
        _attach(dataset, axes, scopes)
    for slot in inner:
        write_value(group, slot.name, getattr(value, slot.name), slot.annotation, slot.label, scopes)


def _write_union(group: Any, name: str, value: Any, kind: Kind, label: Label, parents: tuple[_Scope, ...]) -> None:
    _write_fields(group, name, value, kind, label, parents)
    group[name].attrs["type"] = type(value).__name__


def _write_array(group: Any, name: str, value: Any, kind: Kind, label: Label, parents: tuple[_Scope, ...]) -> Any:
    if not isinstance(value, np.memmap | LargeArray):
        dataset = group.create_dataset(name, data=value)
    else:
        dataset = group.create_dataset(name, value.shape, value.dtype)
        rows = max(1, PIECE_VALUES * len(value) // value.size)
        for first in range(0, len(value), rows):
            last = min(len(value), first + rows)
            dataset[first:last] = value.rows(first, last) if isinstance(value, LargeArray) else value[first:last]
            release(value)
    return _describe(dataset, name, label, parents)


def _write_sequence(group: Any, name: str, value: Iterable[Any], kind: Kind, label: Label, parents: Any) -> Any:
    """Write a tuple as a column or, if its values need groups, as a group with an entry for each."""
    (annotation,) = kind.parts
    if not needs_groups(annotation, label):
        return _write_column(group, name, tuple(value), annotation, label, parents)
    entries, names, name_of = group.create_group(name), [], attrgetter(label.entry) if label.entry else None
    if name_of is not None and isinstance(value, tuple) and len(set(map(name_of, value))) < len(value):
        name_of = None
    for i, entry in enumerate(value):
        names.append(str(i) if name_of is None else str(name_of(entry)))
        write_value(entries, group_name(names[-1]), entry, annotation, parents=parents)
    if name_of is not None:
        entries.create_dataset(NAMES, data=names, dtype=TEXT)
    return None


def _write_record(group: Any, name: str, value: tuple[Any, ...], kind: Kind, label: Label, parents: Any) -> Any:
    if _are_numbers(kind.parts):
        return _describe(group.create_dataset(name, data=np.array(value, kind.parts[0])), name, label, parents)
    inner = group.create_group(name)
    for i, (entry, annotation) in enumerate(zip(value, kind.parts, strict=True)):
        write_value(inner, str(i), entry, annotation)
    return None


def _write_mapping(group: Any, name: str, value: Any, kind: Kind, label: Label, parents: tuple[_Scope, ...]) -> Any:
    inner = group.create_group(name)
    names = inner.create_dataset("names", data=list(value), dtype=TEXT)
    write_value(inner, "values", tuple(value.values()), tuple[kind.parts[0], ...], label, parents)  # type: ignore[name-defined]
    return names


_WRITERS: dict[str, Callable[..., Any]] = {
    "scalar": _write_scalar, "array": _write_array, "union": _write_union, "fields": _write_fields,
    "sequence": _write_sequence, "record": _write_record, "mapping": _write_mapping,
    "text": lambda group, name, value, *_: group.create_dataset(name, data=text_of(value), dtype=TEXT),
}  # fmt: skip


def _write_column(group: Any, name: str, values: Sequence[Any], annotation: Any, label: Label, parents: Any) -> Any:
    """Write values of one type as a column; return the dataset that may be an axis."""
    kind = kind_of_annotation(annotation)
    if kind.form == "scalar" and kind.type is str:
        return _describe(group.create_dataset(name, data=list(values), dtype=TEXT), name, label, parents)
    if kind.form == "scalar" or (kind.form == "record" and _are_numbers(kind.parts)):
        number, shape = (kind.type, (-1,)) if kind.form == "scalar" else (kind.parts[0], (-1, len(kind.parts)))
        data = np.array(values, number).reshape(shape if values else (0, *shape[1:]))
        return _describe(group.create_dataset(name, data=data), name, label, parents)
    if kind.form == "array" and len({array.shape for array in values}) < 2:
        data = np.stack(values) if values else np.zeros(0, kind.type)
        return _describe(group.create_dataset(name, data=data), name, label, parents)
    if kind.form == "fields":
        inner = group.create_group(name)
        inner.attrs["length"] = len(values)
        columns = [(part, [getattr(value, part.name) for value in values]) for part in fields_of(kind.type) if values]
        axes = [_write_column(inner, part.name, c, part.annotation, part.label, parents) for part, c in columns]
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
    """Find the dataset of an axis in this group or a parent; an axis from a property is written at its first use."""
    for scope in scopes:
        if name not in scope.axes and isinstance(getattr(type(scope.value), name, None), property):
            values = getattr(scope.value, name)
            scope.axes[name] = _write_array(scope.group, name, values, Kind("array"), NO_LABEL, scopes)
        if name in scope.axes:
            return scope.axes[name]
    return None


def write_artefact(
    path: Path | str, kind: str, stamp: Stamp, parts: Mapping[str, tuple[Any, Any]], entries: Mapping[str, str] = {},
) -> None:  # fmt: skip
    """Write a file from named parts (value, annotation); entries: attribute that names each value of a tuple."""
    with create_artefact(path, kind, stamp) as file:
        for name, (value, annotation) in parts.items():
            write_value(file, name, value, annotation, Label(entry=entries.get(name, "")))


def writer(kind: str, entries: Mapping[str, str] = {}, **parts: tuple[Any, Any]) -> Callable[..., None]:
    """Return the function (path, value, stamp, *others) that writes a file of a kind; an existing file is replaced.

    parts: annotation (None: type of the value) and default value of each part by name, the first part for `value`.
    entries: see `write_artefact`.
    """

    def write(path: Path | str, value: Any, stamp: Stamp = NO_STAMP, *others: Any, **named: Any) -> None:
        values = dict(zip(parts, (value, *others), strict=False)) | named
        content = {
            name: (tuple(part) if isinstance(part := values.get(name, default), list) else part, annotation)
            for name, (annotation, default) in parts.items()
        }
        write_artefact(path, kind, stamp, content, entries)

    return write
