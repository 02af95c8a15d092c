"""Reader of all HDF5 artefacts: values from groups, by the annotations of frozen dataclasses (see `store.writing`).

The types are always the reader's, never the file's, and lengths are those of the data. Any content of a file gives a
value of the type or an exception, from which `open_artefact` makes a message.
"""

import json
from collections.abc import Callable
from pathlib import Path
from pkgutil import resolve_name
from typing import Any, TypeVar

import h5py
import numpy as np

from elastid.base.arrays import NO_LABEL, Label
from elastid.base.escape import group_name
from elastid.base.large_arrays import map_dataset
from elastid.store.artefacts import open_artefact, plain
from elastid.store.files import once_per_version
from elastid.store.kinds import Kind, fields_of, from_json, from_text, kind_of_annotation, needs_groups
from elastid.store.writing import NAMES

T = TypeVar("T")
_NUMBERS = {bool: "b", int: "iu", float: "f"}


def read_value(group: Any, name: str, annotation: Any, label: Label = NO_LABEL) -> Any:
    """Read a value by its annotation below a group; KeyError, TypeError or ValueError for another type."""
    kind = kind_of_annotation(annotation)
    if kind.form == "optional":
        return read_value(group, name, kind.parts[0], label) if name in group or name in group.attrs else None
    if kind.form == "scalar":
        return _scalar(group.attrs[name] if name in group.attrs else group[name].asstr()[()], kind)
    return _READERS[kind.form](group[name], kind, label)


def read_dataclass(group: Any, kind: type[T]) -> T:
    """Read a dataclass from a group of its fields."""
    names = {*group, *group.attrs}
    slots = [field for field in fields_of(kind) if field.name in names or not field.may_be_empty]
    return kind(**{field.name: read_value(group, field.name, field.annotation, field.label) for field in slots})


def entry_names(group: Any) -> tuple[str, ...]:
    """Return the names of the entries of a group, in the order of writing."""
    if NAMES in group:
        return tuple(group_name(name) for name in group[NAMES].asstr()[:].tolist())
    return tuple(str(i) for i in range(len(group)))


def _scalar(value: Any, kind: Kind) -> Any:
    value = plain(value)
    if type(value) is not kind.type or (kind.choices and value not in kind.choices):
        expectation = f"one of {', '.join(map(str, kind.choices))}" if kind.choices else kind.type.__name__
        raise ValueError(f"{value!r} where {expectation} is expected")
    return value


def _read_array(dataset: Any, *_: Any) -> Any:
    """Read an array, read-only, so that it is not copied; a large array stays in the file."""
    mapped_values = map_dataset(Path(dataset.file.filename), dataset)
    if mapped_values is not None:
        return mapped_values
    values = np.asarray(dataset)
    values.flags.writeable = False
    return values


def _read_sequence(item: Any, kind: Kind, label: Label) -> tuple[Any, ...]:
    (annotation,) = kind.parts
    if needs_groups(annotation, label):
        return tuple(read_value(item, name, annotation) for name in entry_names(item))
    return tuple(_read_column(item, annotation, label))


def _read_record(item: Any, kind: Kind, _: Label) -> tuple[Any, ...]:
    if isinstance(item, h5py.Dataset):
        return tuple(_numbers(item, kind.parts[0], (len(kind.parts),)))
    return tuple(read_value(item, str(i), annotation) for i, annotation in enumerate(kind.parts))


def _read_mapping(item: Any, kind: Kind, label: Label) -> dict[str, Any]:
    values = read_value(item, "values", tuple[kind.parts[0], ...], label)  # type: ignore[name-defined]
    return dict(zip(item["names"].asstr()[:].tolist(), values, strict=True))


def _read_union(item: Any, kind: Kind, _: Label) -> Any:
    return read_dataclass(item, {type_.__name__: type_ for type_ in kind.parts}[item.attrs["type"]])


_READERS: dict[str, Callable[..., Any]] = {
    "array": _read_array, "union": _read_union, "fields": lambda item, kind, _: read_dataclass(item, kind.type),
    "sequence": _read_sequence, "record": _read_record, "mapping": _read_mapping,
    "text": lambda item, kind, _: from_text(item.asstr()[()], kind.type),
}  # fmt: skip


def _read_column(item: Any, annotation: Any, label: Label = NO_LABEL) -> list[Any]:
    kind = kind_of_annotation(annotation)
    match kind.form:
        case "scalar":
            return _scalars(item, kind)
        case "array" if h5py.check_string_dtype(item.dtype) is None:
            return list(item[()])
        case "fields":
            return _read_rows(item, kind)
        case "record" if h5py.check_string_dtype(item.dtype) is None:
            return list(map(tuple, _numbers(item, kind.parts[0], (len(item), len(kind.parts)))))
        case _:
            return [from_json(json.loads(text), annotation) for text in item.asstr()[:].tolist()]


def _read_rows(group: Any, kind: Kind) -> list[Any]:
    n, slots = _scalar(group.attrs["length"], Kind("scalar", int)), fields_of(kind.type)
    columns = {slot.name: _read_column(group[slot.name], slot.annotation, slot.label) for slot in slots} if n else {}
    if any(len(column) != n for column in columns.values()):
        raise ValueError(f"a table of {n} rows with columns of {[len(column) for column in columns.values()]}")
    return [kind.type(**dict(zip(columns, row, strict=True))) for row in zip(*columns.values(), strict=True)]


def _scalars(dataset: Any, kind: Kind) -> list[Any]:
    if kind.type is not str:
        return _numbers(dataset, kind.type)
    values: list[Any] = dataset.asstr()[:].tolist()
    if kind.choices and not set(values) <= set(kind.choices):
        raise ValueError(f"{sorted(set(values) - set(kind.choices))} where {kind.choices} are expected")
    return values


def _numbers(dataset: Any, number: type, shape: tuple[int, ...] | None = None) -> list[Any]:
    if dataset.dtype.kind not in _NUMBERS[number] or (dataset.ndim != 1 if shape is None else dataset.shape != shape):
        raise ValueError(f"{dataset.shape} {dataset.dtype} where numbers ({number.__name__}) are expected")
    values: list[Any] = dataset[()].tolist()
    return values


@once_per_version
def read_part(path: Path | str, kind: str, name: str, annotation: type[T]) -> T:
    """Read one part of an artefact, once in a process; DataError without it, unless its annotation allows None."""
    with open_artefact(path, kind) as file:
        value: T = read_value(file, name, annotation)
        return value


def reader(kind: str, name: str, annotation: type[T] | str, is_optional: bool = False) -> Callable[[Path | str], T]:
    """Return the reader of a part of artefacts of a kind; annotation: "module:name" if the import is slow."""

    def read(path: Path | str) -> T:
        annotation_type: Any = resolve_name(annotation) if isinstance(annotation, str) else annotation
        value: T = read_part(path, kind, name, annotation_type | None if is_optional else annotation_type)
        return value

    return read
