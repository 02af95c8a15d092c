"""Values as JSON holds them and back, by the fields of frozen dataclasses, like those of HDF5 files."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from elastid.store.kinds import fields_of, kind_of_annotation

# Version of the form of summary.json and validation.json.
SCHEMA = 1


def or_null(number: float) -> float | None:
    """A finite number, and null in place of others, which JSON lacks."""
    return number if math.isfinite(number) else None


def or_text(number: float) -> float | str | None:
    """A finite number, null in place of NaN, and an infinite one as text."""
    return None if math.isnan(number) else number if math.isfinite(number) else str(number)


def json_value(value: Any, number: Callable[[float], Any] = or_null) -> Any:
    """Lists of tuples and arrays, objects of mappings and dataclasses; number: of every floating-point number."""
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
        case "array":
            return np.array([math.nan if each is None else each for each in content], kind.type)
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
