"""YAML text -> plain data and the place of every key. YAML is data here: tags construct nothing, they are refused."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeAlias

from ruamel.yaml import YAML
from ruamel.yaml.error import MarkedYAMLError
from ruamel.yaml.nodes import MappingNode, Node, ScalarNode, SequenceNode
from ruamel.yaml.reader import ReaderError

from elastid.base.errors import StudyError
from elastid.base.escape import one_line

KeyPath: TypeAlias = tuple[str | int, ...]

_TAG = "tag:yaml.org,2002:"


@dataclass(frozen=True, order=True)
class Place:
    """Place of something written: a file with line and column (from 1), or an option of the command line (line 0).

    rank orders the sources; skipped_keys: how many leading keys of a path the source does not show (a robot in its own
    file).
    """

    rank: int
    line: int
    column: int
    source: str
    skipped_keys: int = 0

    def __str__(self) -> str:
        return f"{self.source}:{self.line}:{self.column}" if self.line else self.source


@dataclass(frozen=True)
class YamlSource:
    """Plain data (dict, list, str, int, float, bool, None) of a YAML text, with the places of its keys and values."""

    data: Any
    places: dict[KeyPath, tuple[Place, Place]]
    text: str = ""

    def place(self, path: KeyPath, of_value: bool = False) -> Place:
        """Return place where a key path is written, or else the nearest key above it."""
        for length in range(len(path), -1, -1):
            if path[:length] in self.places:
                key, value = self.places[path[:length]]
                return value if of_value and length == len(path) else key
        raise KeyError(path)


def read_source(path: Path, name: str, rank: int = 0) -> YamlSource:
    """Read a YAML file, named `name` in messages; StudyError where it is missing or not YAML."""
    try:
        raw = path.read_bytes()
    except FileNotFoundError:
        raise StudyError("files/missing", "no such file", name) from None
    except OSError as error:
        raise StudyError("study/yaml", f"cannot be read ({error.strerror}); name a YAML file", name) from None
    try:
        text = raw.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        line, column = _line_column(raw[: error.start].decode("latin-1"))
        message = f"not a YAML text in UTF-8 (byte 0x{raw[error.start]:02x})"
        raise StudyError("study/yaml", message, f"{name}:{line}:{column}") from None
    return parse(text, name, rank)


def parse(text: str, name: str, rank: int = 0) -> YamlSource:
    """Parse YAML text of a source called `name`; StudyError lists broken YAML, duplicate keys and tags by place."""
    root = Place(rank, 1, 1, name)
    if _half_character(text):
        raise StudyError("study/yaml", "not a text in UTF-8", f"{name}:1:1")
    yaml = YAML(typ="safe", pure=True)
    try:
        node = yaml.compose(text)
    except MarkedYAMLError as error:
        mark = error.problem_mark or error.context_mark
        line, column = (mark.line + 1, mark.column + 1) if mark else (1, 1)
        problem = str(error.problem or error.context)
        problem = "a tab; use spaces" if repr("\t") in problem else problem
        raise StudyError("study/yaml", f"broken YAML: {problem}", f"{name}:{line}:{column}") from None
    except ReaderError as error:
        line, column = _line_column(text[: error.position])
        raise StudyError("study/yaml", f"not a YAML text ({error.reason})", f"{name}:{line}:{column}") from None
    except RecursionError:
        raise StudyError("study/yaml", "nested too deeply for a study", f"{name}:1:1") from None
    if node is None:
        return YamlSource(None, {(): (root, root)}, text)
    reader = _Reader(name, rank, yaml.constructor)
    data = reader.value(node, (), root)
    if reader.problems:
        raise StudyError("study/yaml", first_of(reader.problems))
    return YamlSource(data, reader.places, text)


def first_of(lines: Sequence[str]) -> str:
    """Return lines of errors, the first of many and a count of the others."""
    max_lines = 20  # correcting them corrects most others
    n_more = len(lines) - max_lines
    return "\n".join([*lines[:max_lines], *([f"... and {n_more} further errors"] if n_more > 0 else [])])


def _line_column(text: str) -> tuple[int, int]:
    return text.count("\n") + 1, len(text) - text.rfind("\n")


def _half_character(text: str) -> bool:
    """Return True for a text with a surrogate, which an escape or an option can bring in and no file can hold."""
    return any("\ud800" <= c <= "\udfff" for c in text)


class _Reader:
    """Walks the nodes of one text; collects places and problems on its way."""

    def __init__(self, name: str, rank: int, construct: Any) -> None:
        self.name, self.rank, self.construct = name, rank, construct
        self.places: dict[KeyPath, tuple[Place, Place]] = {}
        self.problems: list[str] = []
        self._open: set[int] = set()

    def place(self, node: Node) -> Place:
        return Place(self.rank, node.start_mark.line + 1, node.start_mark.column + 1, self.name)

    def problem(self, node: Node, message: str) -> None:
        self.problems.append(f"{self.place(node)}: {one_line(message)}")

    def value(self, node: Node, path: KeyPath, key_place: Place) -> Any:
        """Return the value of a YAML node and note the places of its keys; StudyError for endless aliases."""
        self.places[path] = (key_place, self.place(node))
        if id(node) in self._open or len(self.places) > 200_000:  # aliases may repeat nodes without end
            raise StudyError("study/yaml", "aliases are recursive, or make the file too large", f"{self.place(node)}")
        self._open.add(id(node))
        if isinstance(node, MappingNode) and node.tag == f"{_TAG}map":
            data: Any = {key: self.value(item, (*path, key), place) for key, item, place in self.entries(node)}
        elif isinstance(node, SequenceNode) and node.tag == f"{_TAG}seq":
            data = [self.value(item, (*path, i), self.place(item)) for i, item in enumerate(node.value)]
        else:
            data = self.scalar(node)
        self._open.discard(id(node))
        return data

    def entries(self, node: MappingNode) -> Iterator[tuple[str, Node, Place]]:
        """Yield key, value and place of each entry of a mapping; keys that are no names, or duplicates, fail."""
        first: dict[str, int] = {}
        for key_node, item in node.value:
            if not isinstance(key_node, ScalarNode):
                self.problem(key_node, "a key must be a name, not a list or a mapping")
                continue
            key = str(key_node.value)
            if key_node.tag == f"{_TAG}merge":
                self.problem(key_node, "merge keys (<<) are not supported. Write the merged keys instead")
                continue
            if _half_character(key):
                self.problem(key_node, "half of a character that UTF-8 cannot write (a surrogate) in a key")
                continue
            if key in first:
                self.problem(key_node, f"key '{key}' occurs twice (first in row {first[key]})")
                continue
            first[key] = key_node.start_mark.line + 1
            yield key, item, self.place(key_node)

    def scalar(self, node: Node) -> Any:
        """Return a leaf as plain data: null, a boolean, a number or a text; any other tag is a problem."""
        kind = str(node.tag).removeprefix(_TAG)
        text = node.value
        if _half_character(str(text)):
            self.problem(node, "half of a character that UTF-8 cannot write (a surrogate, \\ud800 to \\udfff)")
            return None
        try:
            if kind == "null":
                return None
            if kind in ("bool", "int", "float"):
                number = getattr(self.construct, f"construct_yaml_{kind}")(node)
                if abs(number) < 2**63 or kind == "float":
                    return number
                raise OverflowError
            if kind in ("str", "timestamp", "value", "merge"):  # a date is a text here
                return str(text)
        except (ValueError, OverflowError):
            self.problem(node, f"'{text[:40]}' is out of range")
            return None
        except (LookupError, TypeError, AttributeError):  # of a tag that the text does not suit
            self.problem(node, f"'{text[:40]}' is not {kind}, as its tag states")
            return None
        self.problem(node, f"the tag {node.tag} is refused: a study holds plain data only")
        return None
