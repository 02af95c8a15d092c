"""The elements of a URDF file, each with the line on which it begins."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from xml.parsers import expat

from elastid.base.errors import StudyError
from elastid.base.names import SEPARATOR, NameRule

_RULE = NameRule(without=SEPARATOR)


@dataclass(frozen=True)
class UrdfElement:
    """An element of the file and where it begins."""

    tag: str
    attributes: Mapping[str, str]
    path: Path
    line: int
    children: list[UrdfElement] = field(default_factory=list)

    def all(self, tag: str) -> Iterator[UrdfElement]:
        """Those of a tag right below."""
        return (child for child in self.children if child.tag == tag)

    def first(self, tag: str) -> UrdfElement | None:
        """The first of a tag right below, if there is one."""
        return next(self.all(tag), None)

    def wrong(self, message: str) -> StudyError:
        """An error with the place of the element."""
        return StudyError(f"{self.path}:{self.line}: {message}")

    def text(self, key: str) -> str:
        """An attribute; StudyError where it is missing."""
        if key not in self.attributes:
            raise self.wrong(f"<{self.tag}> needs {key}")
        return self.attributes[key]

    @property
    def name(self) -> str:
        """The attribute `name`; StudyError where it is missing, or no name."""
        name = self.text("name")
        try:
            return _RULE.check(name)
        except ValueError as error:
            raise self.wrong(str(error)) from None

    def numbers(self, key: str, count: int, default: str | None = None) -> tuple[float, ...]:
        """So many finite numbers of an attribute; StudyError for anything else."""
        text = self.text(key) if default is None else self.attributes.get(key, default)
        try:
            values = tuple(float(word) for word in text.split())
        except ValueError:
            values = ()
        if len(values) != count or not all(map(math.isfinite, values)):
            raise self.wrong(f"{key} of <{self.tag}> must be {count} finite numbers (got '{text}')")
        return values

    def number(self, key: str, default: str | None = None) -> float:
        """One finite number of an attribute; StudyError for anything else."""
        return self.numbers(key, 1, default)[0]


def read_elements(path: Path) -> UrdfElement:
    """The root of a file; StudyError with `file:line` for no XML, and for a DOCTYPE, which could define entities."""
    stack = [UrdfElement("", {}, path, 1)]
    parser = expat.ParserCreate()

    def start(tag: str, attributes: dict[str, str]) -> None:
        element = UrdfElement(tag, attributes, path, parser.CurrentLineNumber)
        stack[-1].children.append(element)
        stack.append(element)

    def doctype(*_: object) -> None:
        raise StudyError(f"{path}:{parser.CurrentLineNumber}: a URDF has no DOCTYPE; remove it (expand a xacro first)")

    parser.StartElementHandler = start
    parser.EndElementHandler = lambda _: stack.pop()
    parser.StartDoctypeDeclHandler = doctype
    try:
        parser.Parse(path.read_bytes(), True)
    except expat.ExpatError as error:
        raise StudyError(f"{path}:{error.lineno}: not XML: {expat.ErrorString(error.code)}") from None
    return stack[0].children[0]
