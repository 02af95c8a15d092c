"""Keys of a study: where each may stand, its type in words, its default, and its text.

The text of a key stands in the docstring of its section as `key: text -- advice`, or `key, other: text -- advice` where
several share one: at the start of a line, or two spaces behind the sentence before it. It ends at the next key or at an
empty line; the rest of the docstring is the text of the section. The advice says when to change the key and what
happens then. JSON Schema takes its descriptions from here.
"""

from __future__ import annotations

import inspect
import re
from collections.abc import Iterator, Mapping
from dataclasses import MISSING, dataclass, fields, is_dataclass
from functools import cache
from types import NoneType, UnionType
from typing import Annotated, Any, Literal, Union, get_args, get_origin, get_type_hints

from elastid.base.units import InUnit
from elastid.robot import Robot
from elastid.robot.denavit_hartenberg import DenavitHartenberg
from elastid.robot.urdf import UrdfRobot
from elastid.study.sections import Study
from elastid.study.yaml_source import KeyPath

# The forms of a robot's file; a study names the file, or holds the robot itself.
ROBOT_FORMS = (Robot, DenavitHartenberg, UrdfRobot)

# Between the text of a key and the advice.
ADVICE = " -- "
# Above the advice; of a key that must be given where True.
HEADINGS = {True: "How to choose it", False: "When to change it"}

_SCALARS = {float: "a number", int: "a whole number", str: "a text", bool: "true or false"}


@dataclass(frozen=True)
class Key:
    """One key of a study at one of its places, such as experiment.recorded.files[].samples.

    `[]` stands for the number of an entry, `<name>` for a name that the study chooses.  section: the class that has the
    key.  advice: when to change it, and what happens then.  default: MISSING where the key is needed.
    """

    path: str
    section: type
    name: str
    annotation: Any
    text: str
    advice: str
    default: Any

    @property
    def advice_heading(self) -> str:
        """Above the advice: a key without a default is chosen, any other is changed."""
        return HEADINGS[self.default is MISSING]


def list_keys() -> Iterator[Key]:
    """Every key of a study and of a robot's file in each of its forms, in the order of the sections."""
    yield from keys_below(Study, "")
    for form in ROBOT_FORMS[1:]:
        yield from keys_below(form, "robot.")


def list_sections() -> Mapping[str, type]:
    """Every class that a study is made of, by its name."""
    return {section.__name__: section for section in (Study, *ROBOT_FORMS, *(key.section for key in list_keys()))}


def texts_of(section: type) -> tuple[str, Mapping[str, str]]:
    """The text of a section, and of each key that its docstring names, without the advice."""
    own, texts = _read(section)
    return own, {key: text for key, (text, _) in texts.items()}


def advice_of(section: type) -> Mapping[str, str]:
    """The advice on each key of a section whose docstring gives one: when to change it, and what happens then."""
    return {key: advice for key, (_, advice) in _read(section)[1].items() if advice}


@cache
def _read(section: type) -> tuple[str, Mapping[str, tuple[str, str]]]:
    """The text of a section, and the text and advice of each key."""
    doc = inspect.getdoc(section) or ""
    names = "|".join(f.name for f in fields(section))
    begins = re.compile(rf"(?:^|  )((?:{names})(?:, (?:{names}))*):\s", re.MULTILINE)
    own: list[str] = []
    texts: dict[str, tuple[str, str]] = {}
    for paragraph in doc.split("\n\n"):
        keys = [m for m in begins.finditer(paragraph) if paragraph[: m.start()].rstrip()[-1:] in ("", ".", ")")]
        ends = [*(match.start() for match in keys), len(paragraph)]
        own.append(paragraph[: ends[0]])
        for match, end in zip(keys, ends[1:], strict=True):
            text, _, advice = " ".join(paragraph[match.end() : end].split()).partition(ADVICE)
            texts |= dict.fromkeys(match[1].split(", "), (text, advice))
    return " ".join(" ".join(own).split()), texts


def keys_below(annotation: Any, path: str) -> Iterator[Key]:
    """Every key of the sections that an annotation allows, and of those below them; path: before their names."""
    for option in _options(annotation):
        arguments, origin = get_args(option), get_origin(option)
        if origin is tuple:
            yield from keys_below(arguments[0], f"{path[:-1]}[].")
        elif origin is dict:
            yield from keys_below(arguments[1], f"{path}<name>.")
        elif is_dataclass(option) and isinstance(option, type):
            hints, (_, texts) = get_type_hints(option, include_extras=True), _read(option)
            for f in fields(option):
                default = f.default if f.default_factory is MISSING else f.default_factory()
                yield Key(path + f.name, option, f.name, hints[f.name], *texts.get(f.name, ("", "")), default)
                yield from keys_below(hints[f.name], f"{path}{f.name}.")


def type_at(root: Any, path: KeyPath) -> Any:
    """The type of the value at a path below a section; Any where no section has such a key."""
    for step in path:
        root = _child(root, step)
    return root


def names_in(annotation: Any) -> list[str]:
    """The keys of the section that an annotation allows."""
    return [f.name for option in _options(annotation) if is_dataclass(option) for f in fields(option)]


def names_of_each(annotation: Any) -> list[str]:
    """The keys of each entry of the list, or of each name of the mapping, that an annotation allows."""
    listed = [get_args(option)[0] for option in _options(annotation) if get_origin(option) is tuple]
    named = [get_args(option)[1] for option in _options(annotation) if get_origin(option) is dict]
    return [name for each in (*listed, *named) for name in names_in(each)]


def words_in(annotation: Any) -> list[str]:
    """The fixed words that an annotation allows."""
    return [str(w) for option in _options(annotation) if get_origin(option) is Literal for w in get_args(option)]


def describe(annotation: Any) -> str:
    """A type in words.

    >>> describe(tuple[float, float] | None)
    'a list of 2, each a number'
    """
    return ", or ".join(dict.fromkeys(_describe(option) for option in _options(annotation)))


def _describe(option: Any, with_example: bool = True) -> str:
    arguments, origin = get_args(option), get_origin(option)
    if origin is Annotated:
        unit = next((" or ".join(mark.units) for mark in arguments if isinstance(mark, InUnit)), None)
        if unit is None:
            return describe(arguments[0])
        return f"a number in {unit}" + (f" or a text such as '1 {unit.split()[0]}'" if with_example else "")
    if origin is Literal:
        return f"one of {', '.join(str(word) for word in arguments)}"
    if origin is tuple and arguments[1:] == (...,):
        return f"a list, each {_each(arguments[0])}"
    if origin is tuple:
        return f"a list of {len(arguments)}, each {_each(arguments[0])}"
    if origin is dict:
        return "a mapping of names"
    if is_dataclass(option):
        needed = [f.name for f in fields(option) if f.default is MISSING and f.default_factory is MISSING]
        return f"a mapping with the keys {', '.join(needed)}" if needed else "a mapping ({} for the defaults)"
    return _SCALARS[option]


def _each(annotation: Any) -> str:
    """The type of the entries of a list in words."""
    return " or ".join(dict.fromkeys(_describe(option, with_example=False) for option in _options(annotation)))


def _options(annotation: Any) -> list[Any]:
    """The members of a union, None left out; one option where it is no union."""
    if get_origin(annotation) in (Union, UnionType):
        return [option for option in get_args(annotation) if option is not NoneType]
    return [annotation]


def _child(annotation: Any, step: str | int) -> Any:
    for option in _options(annotation):
        arguments, origin = get_args(option), get_origin(option)
        if is_dataclass(option) and isinstance(option, type):
            hints = get_type_hints(option, include_extras=True)
            if step in hints:
                return hints[str(step)]
        elif origin is dict:
            return arguments[1]
        elif origin is tuple and isinstance(step, int) and arguments:
            return arguments[0] if arguments[1:] == (...,) else arguments[min(step, len(arguments) - 1)]
    return Any
