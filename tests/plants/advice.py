"""Every advice in the messages of elastid, from its source; and the desk at which a case of one is tried out."""

from __future__ import annotations

import ast
import re
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any, TypeAlias

import pytest
from ruamel.yaml import YAML

from elastid.app import cli
from elastid.base.errors import ElastidError
from elastid.study.reference import StudyKey, list_keys, names_in, words_in

PACKAGE = Path(__file__).parents[2] / "elastid"
GAP = "‹›"  # stands for what a message fills in
# Files whose texts are no messages: studies that `elastid new` writes are run by tests of their own.
NO_MESSAGES = ("app/from_log.py", "app/templates")
COMMANDS = "new check explain inspect run design measure estimate fit validate compare predict report export levels"

_SETTING = re.compile(
    rf"(?<![\w.])((?:[a-z_]+(?:\[\])?\.)*([a-z_]+)(?:\.{GAP})?): ?"
    rf"(\{{.*\}}|\[[^\]]*\]|[\w{GAP}./*+-]*\w(?!\w|: )|{GAP}|-?[\d.]+)"
)
_COMMAND = re.compile(
    rf"\belastid (?:{'|'.join(COMMANDS.split())})\b[^`,;:)]*|(?<=`)elastid {GAP}[^`,;:)]*|"
    r"--set '[^']*'|(?<![\w-])--[a-z][a-z-]*[^`,;:)]*"
)
# A number to change, by an amount that the message leaves to the user.
_CHANGE = re.compile(
    r"(?:^|[;,:.] |\b(?:or|and) )((?:lower|raise|widen|shorten) (?:[a-z_]+\.)*([a-z_]+))\b(?! values?\b)", re.IGNORECASE
)
# Words behind which a setting whose value is filled in is advice, and not what was found.
_URGES = re.compile(r"\b(give|take|set|state|say|with|to be)( that| the| one| of| them| channels?| its| their)*$|^$")


@dataclass(frozen=True, order=True)
class Advice:
    """text: as it stands in the source, with gaps.  module: its file in the package.  message: all of it."""

    module: str
    text: str
    message: str = ""

    @property
    def is_setting(self) -> bool:
        """True for keys of a study or of a robot's file with a value, False for commands, options and changes."""
        return ":" in self.text and not self.text.startswith(("elastid ", "--"))

    @property
    def is_change(self) -> bool:
        """True for `lower KEY` and the like."""
        return self.text.split(" ")[0].lower() in ("lower", "raise", "widen", "shorten")


@cache
def keys() -> dict[str, tuple[StudyKey, ...]]:
    """Every key of a study by its last name."""
    named: dict[str, tuple[StudyKey, ...]] = {}
    for key in list_keys():
        named[key.name] = (*named.get(key.name, ()), key)
    return named


@cache
def advices() -> tuple[Advice, ...]:
    """All of them, each once a file and text."""
    found: dict[tuple[str, str], Advice] = {}
    for module, message in messages():
        for text in (*_settings(message), *_commands(message), *_changes(message)):
            found.setdefault((module, text), Advice(module, text, message))
    return tuple(sorted(found.values()))


def _settings(message: str) -> Iterator[str]:
    if re.match(r"[\w.]+=|--set ", message):  # an override that the code makes, or a part of a command
        return
    for match in _SETTING.finditer(message):
        path, name, value = match.groups()
        # At the head of a message stands the place that it is about, unless the setting is all of it.
        at_head, is_gap = not message[: match.start()].strip(), value in (GAP, f"[{GAP}]")
        if name not in keys() or (at_head and (match.end() < len(message) or (is_gap and "." in path))):
            continue
        words = {word for key in keys()[name] for word in words_in(key.annotation)} | {"true", "false"}
        if (value[0] in "{[" and not is_gap) or value in words or re.fullmatch(r"-?[\d.]+", value):
            yield match[0]
        elif value == GAP and not any(names_in(key.annotation) for key in keys()[name]):
            before = message[: match.start()].rstrip(" (")
            if _URGES.search(before):
                yield match[0]


def _commands(message: str) -> Iterator[str]:
    if " " in message:  # an option by itself is its declaration
        found = (m for m in _COMMAND.finditer(message) if m.start() > 0 or m[0].startswith(("elastid", "--set '")))
        yield from (match[0].strip() for match in found)


def _changes(message: str) -> Iterator[str]:
    return (match[1] for match in _CHANGE.finditer(message) if match[2] in keys())


def messages() -> Iterator[tuple[str, str]]:
    """File and text of each string of the package that is no docstring and no text of a key, with gaps for values."""
    for path in sorted(PACKAGE.rglob("*.py")):
        module = path.relative_to(PACKAGE).as_posix()
        if not module.startswith(NO_MESSAGES):
            texts = _texts(ast.parse(path.read_text("utf-8")))
            yield from ((module, text) for text in texts if not text.startswith("  "))  # a line of a file


def _texts(tree: ast.Module) -> Iterator[str]:
    parts: set[ast.AST] = set()
    for node in ast.walk(tree):
        if isinstance(node, ast.Expr):
            parts.add(node.value)
        elif isinstance(node, ast.JoinedStr):
            parts |= {
                below for each in ast.walk(node) for below in ast.iter_child_nodes(each) if _is_piece(each, below)
            }
        elif isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id in ("Key", "labelled"):
            parts |= {*ast.walk(node)}
    for node in ast.walk(tree):
        if node in parts:
            continue
        if isinstance(node, ast.JoinedStr):
            yield "".join(each.value if isinstance(each, ast.Constant) else GAP for each in node.values)
        elif isinstance(node, ast.Constant) and isinstance(node.value, str):
            yield node.value


def _is_piece(parent: ast.AST, child: ast.AST) -> bool:
    """True for the constants of an f-string and its format specifications, not for strings within its values."""
    return (isinstance(parent, ast.JoinedStr) and isinstance(child, ast.Constant)) or (
        isinstance(parent, ast.FormattedValue) and child is parent.format_spec
    )


@dataclass(frozen=True)
class Desk:
    """A user's folder, and a terminal."""

    folder: Path
    capture: pytest.CaptureFixture[str]

    def elastid(self, *arguments: str) -> str:
        """What a command says as it fails, warnings included; empty where it ends well."""
        code, said = self.said(*arguments)
        return said if code else ""

    def said(self, *arguments: str) -> tuple[int, str]:
        """The exit code of a command and all that it says, in one line."""
        self.capture.readouterr()
        code = cli.run_command(arguments)
        said = self.capture.readouterr()
        return code, " ".join(f"{said.out} {said.err}".split())

    def write(self, **files: str) -> str:
        """The path of study.yml, which stands in the folder with other files."""
        for name, text in files.items():
            (self.folder / f"{name}.yml").write_text(text, encoding="utf-8")
        return str(self.folder / "study.yml")


Case: TypeAlias = Callable[[Desk], None]
# Of each advice, by module and text, what provokes its message and follows it; True where that takes long.
CASES: dict[tuple[str, str], tuple[Case, bool]] = {}
# What a message leaves to the user.
_BLANKS = {"{torque: ..., velocity: ...}": "{torque: 100, velocity: 3}", "{torque: ...}": "{torque: 100}"}


def case(module: str, *texts: str, slow: bool = False) -> Callable[[Case], Case]:
    """Registers a function as the case of some advices of a file."""

    def registered(function: Case) -> Case:
        CASES.update({(module, text): (function, slow) for text in texts})
        return function

    return registered


def rendered(text: str, said: str) -> str:
    """An advice as a message has it, its gaps filled in; AssertionError where the message has it not."""
    pattern = ".*?".join(re.escape(part) for part in text.split(GAP))
    found = re.search(pattern + (r"(?=$|[\s,;:)`])" if text.endswith(GAP) else ""), said)
    assert found is not None, (text, said)
    return found[0]


def pasted(text: str, at: str = "") -> str:
    """A setting as an override; `at`: the section that it stands in."""
    for blank, value in _BLANKS.items():
        text = text.replace(blank, value)
    path, _, value = text.partition(": ")
    while value.count("}") > value.count("{"):  # a bracket that was opened before it
        value = value.removesuffix("}")
    return f"{at}{path}={value}"


def value_of(text: str) -> Any:
    """The value of a setting."""
    return YAML(typ="safe").load(text.partition(": ")[2])


def refusal(attempt: Callable[[], object]) -> str:
    """Why something is refused; empty where it is not."""
    try:
        attempt()
    except (ElastidError, ValueError) as error:
        return str(error)
    return ""
