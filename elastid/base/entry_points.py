"""Entry points by which installed packages extend a list of elastid: log formats, export targets, causes."""

from functools import cache
from importlib.metadata import EntryPoint, entry_points
from typing import TypeVar

from elastid.base.errors import StudyError

Row = TypeVar("Row")


@cache
def group_entries(group: str) -> tuple[EntryPoint, ...]:
    """Return the entry points of a group. The look-up reads a file of every installed package."""
    return tuple(entry_points(group=group))


def registry(group: str, kind: type[Row]) -> tuple[Row, ...]:
    """Load the rows of a group; raises StudyError as `load_row`."""
    return tuple(load_row(point, kind) for point in group_entries(group))


def load_row(point: EntryPoint, kind: type[Row]) -> Row:
    """Load the row of an entry point; StudyError if it cannot be loaded or is not of type `kind`."""
    try:
        row = point.load()
        problem = f"has type {type(row).__name__}; expected: {kind.__module__}.{kind.__qualname__}"
    except Exception as error:
        row, problem = None, f"cannot be loaded ({error})"
    if isinstance(row, kind):
        return row
    raise StudyError(
        "install/entry-point",
        f"entry point {point.name} ({point.value}) of group {point.group} {problem}. Update its package, or "
        "uninstall it",
    )
