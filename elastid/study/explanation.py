"""What one key of a study means: its text, type and unit, default, when to change it, and the keys below it."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import MISSING, is_dataclass
from textwrap import fill
from typing import Any

from elastid.base.errors import StudyError, did_you_mean
from elastid.study.reference import Key, describe, list_keys, names_in

_WIDTH = 100


def explain(asked: str) -> str:
    """The explanation of a key by its path, or of all keys that end so; StudyError for one that does not exist.

    Names that a study chooses and numbers of entries may be given or left out: fit.parameters.k_1.start,
    experiment.recorded.files[0].samples.
    """
    found = list(_matching(asked))
    if not found:
        known = dict.fromkeys(key.path.rpartition(".")[2].removesuffix("[]") for key in list_keys())
        last = asked.rpartition(".")[2]
        raise StudyError(f"a study has no key {asked}; {did_you_mean(last, ['name'], known)}")
    return "\n\n".join(_explanation(key) for key in found)


def _matching(asked: str) -> Iterator[Key]:
    """The keys of that path, or else those whose path ends so, each path once."""
    keys = {key.path: key for key in list_keys()}.values()
    wanted = _steps(asked)
    exact = [key for key in keys if _agree(_steps(key.path), wanted)]
    yield from exact or (key for key in keys if _agree(_steps(key.path)[-len(wanted) :], wanted))


def _steps(path: str) -> list[str]:
    return re.sub(r"\[\d*\]", "", path).split(".")


def _agree(steps: list[str], wanted: list[str]) -> bool:
    return len(steps) == len(wanted) and all(a in ("<name>", b) for a, b in zip(steps, wanted, strict=True))


def _explanation(key: Key) -> str:
    below = names_in(key.annotation)
    lines = [key.path, _paragraph(key.text), _paragraph(f"Value: {describe(key.annotation)}.")]
    lines.append(_paragraph(f"Default: {_default(key.default)}."))
    lines += [_paragraph(f"{key.advice_heading}: {key.advice}")] if key.advice else []
    lines += [_paragraph(f"Keys below it: {', '.join(below)}.")] if below else []
    return "\n".join(lines)


def _paragraph(text: str) -> str:
    return fill(text, _WIDTH, initial_indent="  ", subsequent_indent="  ", break_on_hyphens=False)


def _default(value: Any) -> str:
    """A default as a study would write it.

    >>> _default((1.0, 2.0)), _default(None), _default(MISSING), _default(True)
    ('[1, 2]', 'none', 'none, it must be given', 'true')
    """
    if value is MISSING:
        return "none, it must be given"
    if value is None or value == "":
        return "none"
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, float):
        return f"{value:g}"
    if isinstance(value, tuple):
        return f"[{', '.join(_default(each) for each in value)}]"
    if is_dataclass(value) or value == {}:
        return "{}"
    return str(value)
