"""Codes of errors and notes, with meaning and remedy (codes.toml), and public names that changed (renamed.toml)."""

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
    """Return old public names -> new: `section.key`, `key=value`, words of the command line, codes."""
    return _table("renamed.toml")


def new_code(old: str) -> str:
    """Answer an old name by `renamed to NEW`, any other by an empty text.

    >>> new_code("friction.passes"), new_code("friction.law")
    ('renamed to constant_velocity', '')
    """
    return f"renamed to {renamed_names()[old]}" if old in renamed_names() else ""


def renamed_key(path: Sequence[str | int]) -> str:
    """Answer the old name of a key at a path of names and indices, any other by an empty text.

    >>> renamed_key(("experiment", "recorded", "files", 0, "level"))
    'renamed to amplitude'
    """
    return new_code(".".join([str(step) for step in path if not isinstance(step, int)][-2:]))
