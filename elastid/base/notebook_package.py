"""Packages of the extra `notebook`, imported when they are used."""

from __future__ import annotations

from importlib import import_module
from typing import Any

from elastid.base.errors import ElastidError


def notebook_package(name: str) -> Any:
    """The package; ElastidError that says how it is installed where it is missing."""
    try:
        return import_module(name)
    except ImportError:
        raise ElastidError(
            f"{name} is not installed; install it with `uv sync --extra notebook` "
            "(or `pip install 'elastid[notebook]'`)"
        ) from None
