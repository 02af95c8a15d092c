"""`@section`: a frozen dataclass that can be read from a study, unknown keys refused.

Each section of a study lives beside the code that uses it and knows no YAML; `study` only gathers them.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TypeVar, dataclass_transform

T = TypeVar("T")

# Read by pydantic when `study` validates the class, plain data otherwise. A name such as 1 needs no quotes.
_CONFIG = {"extra": "forbid", "coerce_numbers_to_str": True, "allow_inf_nan": False}


@dataclass_transform(frozen_default=True, field_specifiers=(field,))
def section(cls: type[T]) -> type[T]:
    """A frozen dataclass whose fields are the keys that a study may give."""
    cls.__pydantic_config__ = _CONFIG  # type: ignore[attr-defined]
    return dataclass(frozen=True)(cls)
