"""Values as JSON holds them: numbers that may be infinite, and notes."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from typing import Any

from elastid.base.note import Note, grouped


def finite(value: float) -> float | None:
    """JSON knows no infinity: null."""
    return float(value) if math.isfinite(value) else None


def all_finite(values: Sequence[float]) -> list[float | None]:
    """The same of each."""
    return [finite(value) for value in values]


def note_entries(notes: Iterable[Note]) -> list[dict[str, Any]]:
    """The same note of many places once, with its places."""
    return [
        {
            "code": group.first.code,
            "severity": group.first.severity,
            "places": [place for place in group.places if place],
            "text": group.first.text,
        }
        for group in grouped(notes)
    ]
