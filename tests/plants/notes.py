"""The sentences of notes, as a user reads them."""

import re
from collections.abc import Iterable

from elastid.base.errors import Note


def said(notes: Iterable[Note]) -> tuple[str, ...]:
    return tuple(map(str, notes))


def noted(note: Note) -> tuple[str, str, list[float]]:
    """Code, place and numbers of a note."""
    return note.code, note.place, [*map(float, re.findall(r"\d+\.?\d*", note.text))]
