"""Codes of errors and notes with meaning and remedy (codes.toml), and renamed public names (renamed.toml)."""

import tomllib
from collections.abc import Mapping, Sequence
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple


class Code(NamedTuple):
    """Meaning of an error or a note, and its remedy in the imperative."""

    meaning: str
    remedy: str


def _table(name: str) -> dict[str, Any]:
    return tomllib.loads((Path(__file__).with_name(name)).read_text("utf-8"))


@cache
def codes() -> Mapping[str, Code]:
    """Return every code of an error or a note."""
    return {code: Code(*texts) for code, texts in _table("codes.toml").items()}


@cache
def renamed_names() -> Mapping[str, str]:
    """Return the new name by old public name: `section.key`, `key=value`, words of the command line, codes."""
    return _table("renamed.toml")


def new_code(old: str) -> str:
    """Return `renamed to NEW` for an old name, an empty text for any other.

    >>> new_code("friction.passes"), new_code("friction.law")
    ('renamed to constant_velocity', '')
    """
    return f"renamed to {renamed_names()[old]}" if old in renamed_names() else ""


def renamed_key(path: Sequence[str | int]) -> str:
    """Return `renamed to NEW` for an old key at a path of names and indices, an empty text for any other.

    >>> renamed_key(("experiment", "recorded", "files", 0, "level"))
    'renamed to amplitude'
    """
    return new_code(".".join([str(step) for step in path if not isinstance(step, int)][-2:]))
