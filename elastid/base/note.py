"""Note: one thing that a user should hear about data, plan or result; the same from many places is one line."""

from __future__ import annotations

import re
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Literal, TypeAlias

Severity: TypeAlias = Literal["information", "warning"]


@dataclass(frozen=True)
class Note:
    """code: what kind of thing, for programs ("clipped-channel").  text: one sentence with its numbers filled in.

    place: the file, record, configuration, channel or parameter that it is about; printed in front of the text.
    """

    code: str
    text: str
    place: str = ""
    severity: Severity = "warning"

    def __str__(self) -> str:
        return f"{self.place}: {self.text}" if self.place else self.text


@dataclass(frozen=True)
class NoteGroup:
    """The same note from `places`: one code, and texts that differ at most in their numbers."""

    first: Note
    places: tuple[str, ...]

    def __str__(self) -> str:
        if len(self.places) == 1:
            return str(self.first)
        if len(self.places) <= 3:
            return f"{', '.join(self.places)}: {self.first.text}"
        return f"{self.places[0]} and {len(self.places) - 1} more: {self.first.text}"


def grouped(notes: Iterable[Note]) -> tuple[NoteGroup, ...]:
    """The notes without repetition, in the order of their first appearance, each kind of each text once.

    >>> for group in grouped(Note("late-log", f"{t} samples late", f"log {i}") for i, t in enumerate((3, 4, 3, 5))):
    ...     print(group)
    log 0 and 3 more: 3 samples late
    """
    groups: dict[tuple[str, str, bool], dict[Note, None]] = {}
    for note in notes:
        # A note without a place is about one thing only: another number there is another thing.
        key = (note.code, re.sub(r"\d+(\.\d+)?", "#", note.text) if note.place else note.text, bool(note.place))
        groups.setdefault(key, {})[note] = None
    return tuple(
        NoteGroup(next(iter(members)), tuple(dict.fromkeys(note.place for note in members)))
        for members in groups.values()
    )
