"""The sentences of notes, as a user reads them."""

from collections.abc import Iterable

from elastid.base.errors import Note


def said(notes: Iterable[Note]) -> tuple[str, ...]:
    """Each note in words."""
    return tuple(map(str, notes))
