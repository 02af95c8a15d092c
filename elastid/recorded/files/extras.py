"""Libraries of single formats: each is an extra of elastid, imported when a file of its format is opened."""

from __future__ import annotations

from importlib import import_module
from pathlib import Path
from typing import Any

from elastid.base.errors import StudyError


def imported(module: str, path: Path, kind: str, extra: str) -> Any:
    """A module; StudyError with the command that installs it where it is not there."""
    try:
        return import_module(module)
    except ImportError:
        package = module.partition(".")[0]
        raise StudyError(
            f"{path}: {kind} is read by {package}, which is not installed; install it with `uv sync --extra {extra}` "
            f"(or `pip install 'elastid[{extra}]'`)"
        ) from None
