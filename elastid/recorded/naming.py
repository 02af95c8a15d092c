"""A file of somebody named in the place of whatever its content makes a reader raise."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from elastid.base.errors import DataError, ElastidError


@contextmanager
def naming(path: Path, advice: str) -> Iterator[None]:
    """DataError with the file and what to do, in the place of any exception that is no message for the user yet."""
    try:
        yield
    except (ElastidError, MemoryError):
        raise
    except Exception as error:
        why = f"{type(error).__name__}: {error}" if str(error) else type(error).__name__
        raise DataError(f"{path}: {advice} ({why})") from error
