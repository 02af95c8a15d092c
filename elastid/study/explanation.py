"""What one key of a study means: its text, type and unit, default, when to change it, and the keys below it."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import MISSING, is_dataclass
from difflib import get_close_matches
from textwrap import fill
from typing import Any

from elastid.base.errors import StudyError, did_you_mean
from elastid.study.fleet import FleetSpec
from elastid.study.reference import Key, describe, keys_below, list_keys, names_in, names_of_each, texts_of
from elastid.study.sections import Study

_WIDTH = 100


def explain(asked: str) -> str:
    """The explanation of a key by its path, or of all keys that end so; StudyError for one that does not exist.

    Names that a study chooses and numbers of entries may be given or left out: fit.parameters.k_1.start,
    experiment.recorded.files[0].samples.
    """
    found = list(_matching(asked))
    if not found:
        owner = "a fleet" if asked.startswith("fleet.") else "a study"
        raise StudyError(f"{owner} has no key {asked}; {_nearest(asked)}")
    return "\n\n".join(_explanation(key) for key in found)


def overview() -> str:
    """The sections of a study in its order, a line each, and how to go on."""
    texts = texts_of(Study)[1]
    width = max(map(len, texts))
    lines = [
        fill(text, _WIDTH, initial_indent=f"  {name:<{width}}  ", subsequent_indent=" " * (width + 4))
        for name, text in texts.items()
    ]
    return "\n".join(
        [
            "A study has these keys, in this order:",
            *lines,
            "`elastid explain fit` lists the keys below one of them, `elastid explain fit.criterion` explains one.",
            "Keys of a robot's file are below robot (robot.bodies), of a fleet's file below fleet (fleet.members).",
        ]
    )


def _nearest(asked: str) -> str:
    """The end of a message: the nearest key where the path stops to exist, or of a single word the nearest of all."""
    steps, paths = _steps(asked), [_steps(key.path) for key in _all_keys()]
    known = max(range(len(steps)), key=lambda n: (any(_begins(path, steps[:n]) for path in paths), n))
    beside = dict.fromkeys(path[known] for path in paths if _begins(path, steps[:known]))
    parent = "".join(f"{step}." for step in steps[:known])
    close = get_close_matches(steps[known], beside, n=1)
    if close or len(steps) > 1:
        return did_you_mean(parent + steps[known], [parent + name for name in ([*close] or beside)])
    ends = {path[-1]: ".".join(path) for path in reversed(paths)}
    close = get_close_matches(asked, ends, n=1)
    return f"did you mean '{ends[close[0]]}'?" if close else f"there are {', '.join(beside)}"


def _all_keys() -> Iterator[Key]:
    """Those of a study and of its robot, and those of a fleet's file below `fleet`."""
    yield from list_keys()
    yield Key("fleet", FleetSpec, "fleet", FleetSpec, texts_of(FleetSpec)[0], "", MISSING)
    yield from keys_below(FleetSpec, "fleet.")


def _begins(path: list[str], steps: list[str]) -> bool:
    """A longer path that begins with these steps."""
    return len(path) > len(steps) and _agree(path[: len(steps)], steps)


def _matching(asked: str) -> Iterator[Key]:
    """The keys of that path, or else those whose path ends so, each path once; of a name the mapping that holds it."""
    keys = {key.path: key for key in _all_keys()}.values()
    wanted = _steps(asked)
    if any(_begins(_steps(key.path), wanted) and _steps(key.path)[len(wanted) - 1] == "<name>" for key in keys):
        wanted = wanted[:-1]
    exact = [key for key in keys if _agree(_steps(key.path), wanted)]
    yield from exact or (key for key in keys if _agree(_steps(key.path)[-len(wanted) :], wanted))


def _steps(path: str) -> list[str]:
    return re.sub(r"\[\d*\]", "", path).split(".")


def _agree(steps: list[str], wanted: list[str]) -> bool:
    return len(steps) == len(wanted) and all(a in ("<name>", b) for a, b in zip(steps, wanted, strict=True))


def _explanation(key: Key) -> str:
    below, of_each = names_in(key.annotation), names_of_each(key.annotation)
    lines = [key.path, _paragraph(key.text), _paragraph(f"Value: {describe(key.annotation)}.")]
    lines.append(_paragraph(f"Default: {_default(key.default)}."))
    lines += [_paragraph(f"{key.advice_heading}: {key.advice}")] if key.advice else []
    lines += [_paragraph(f"Keys below it: {', '.join(below)}.")] if below else []
    lines += [_paragraph(f"Keys of each: {', '.join(of_each)}.")] if of_each else []
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
