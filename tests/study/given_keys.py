"""Keys that studies, templates, scripts and tests give, each with the section that it belongs to.

A word alone shows nothing: `level=` may be the argument of any function. A key is given by plain data (YAML or a Python
literal) below its section, by a dotted path such as fit.starts=3, or by an argument of its section's class, of
`replace` or of a helper of a test that hands its keywords on to one of these.
"""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import fields
from functools import cache
from pathlib import Path
from typing import Any

from ruamel.yaml import YAML
from ruamel.yaml.error import YAMLError

from elastid.study.reference import (
    ROBOT_FORMS,
    StudyKey,
    keys_below,
    list_keys,
    list_sections,
    names_in,
    sections_in,
    type_at,
)
from elastid.study.sections import FleetSpec, MemberSpec, Study

SECTIONS = {**list_sections(), "FleetSpec": FleetSpec, "MemberSpec": MemberSpec}
PLACES = [*list_keys(), *keys_below(FleetSpec, "fleet.")]
_DOTTED = re.compile(r"([a-z_]+(?:[.\[][\w@*\]]+)+)\s*=(.*)")

Given = tuple[str, str]


def _section_names(annotation: Any) -> list[str]:
    return [section.__name__ for section in sections_in(annotation)]


@cache
def _sections_under(key: str) -> tuple[str, ...]:
    """The sections that stand under a key of this name."""
    names = (name for place in PLACES if place.name == key for name in _section_names(place.annotation))
    return tuple(dict.fromkeys(names))


def in_data(data: Any, kinds: Sequence[Any]) -> Iterator[Given]:
    """Keys in plain data of one of some types; in a mapping of unknown type, those below the keys that it names."""
    if isinstance(data, list):
        for i, entry in enumerate(data):
            yield from in_data(entry, [type_at(kind, (i,)) for kind in kinds])
    elif isinstance(data, dict):
        for name, value in data.items():
            yield from ((section, name) for kind in kinds for section in _section_names(kind) if name in names_in(kind))
            below = [kind for kind in (type_at(kind, (name,)) for kind in kinds) if kind is not Any]
            yield from in_data(value, below or [SECTIONS[section] for section in _sections_under(str(name))])


def in_document(data: Any) -> Iterator[Given]:
    """Keys in the data of a whole file, or of a fragment of one."""
    forms = (Study, *ROBOT_FORMS, FleetSpec) if isinstance(data, dict) else ()
    yield from in_data(data, [form for form in forms if set(data) <= {*names_in(form)}])


def in_yaml(text: str, kinds: Sequence[Any] = ()) -> Iterator[Given]:
    """Keys in a YAML text, of some types or of a whole file; none where it is not YAML."""
    try:
        data = YAML(typ="safe").load(text)
    except (YAMLError, ValueError):
        return
    yield from in_data(data, kinds) if kinds else in_document(data)


@cache
def _at_path(path: str) -> tuple[StudyKey, ...]:
    """The keys whose path ends with this one of two steps and more."""
    wanted = [step for step in re.split(r"[.\[\]]+", path) if step and not step.isdigit()]
    return tuple(
        place for place in PLACES if len(wanted) > 1 and _ends(place.path.replace("[]", "").split("."), wanted)
    )


def _ends(steps: Sequence[str], wanted: Sequence[str]) -> bool:
    last = steps[-len(wanted) :]
    return len(last) == len(wanted) and all(a in ("<name>", b) for a, b in zip(last, wanted, strict=True))


def in_python(source: str) -> Iterator[Given]:
    """Keys that calls, literals and texts of a module give."""
    nodes = [*ast.walk(ast.parse(source))]
    definitions = [node for node in nodes if isinstance(node, ast.Assign | ast.arg | ast.FunctionDef)]
    values: dict[str, Sequence[str]] = {}
    helpers: dict[str, Sequence[str]] = {}
    for _ in range(3):  # a helper of a helper of a variable
        values |= dict(_values(definitions, values))
        helpers |= dict(_helpers(definitions, values, helpers))
    for node in nodes:
        if isinstance(node, ast.Call):
            sections = _sections_filled(node, values, helpers)
            places = [f.name for section in sections if section == _called(node) for f in fields(SECTIONS[section])]
            names = places[: len(node.args)]
            for keyword in node.keywords:
                names += [keyword.arg] if keyword.arg else [str(key) for key in _literal(keyword.value) or ()]
            yield from ((section, name) for section in sections for name in names)
        elif isinstance(node, ast.Dict):
            yield from in_document(_literal(node))
        text = node.value if isinstance(node, ast.Constant) and isinstance(node.value, str) else ""
        if isinstance(node, ast.JoinedStr):
            text = "".join(str(part.value) if isinstance(part, ast.Constant) else "0" for part in node.values)
        for path, value in _DOTTED.findall(text):
            for place in _at_path(path):
                yield place.section.__name__, place.name
                yield from in_yaml(value, [place.annotation])
        if ":" in text and not re.fullmatch(r"[^\n{]*[^,{\n] [^\n{]*", text):
            yield from in_yaml(text)


def _values(definitions: Sequence[ast.AST], values: Mapping[str, Sequence[str]]) -> Iterator[tuple[str, Sequence[str]]]:
    """Names of variables that hold a section, of arguments of its type and of functions that return one."""
    for node in definitions:
        if isinstance(node, ast.Assign) and isinstance(node.targets[0], ast.Name) and isinstance(node.value, ast.Call):
            if sections := _sections_held(node.value, values):
                yield node.targets[0].id, sections
        elif isinstance(node, ast.arg | ast.FunctionDef):
            hint = node.annotation if isinstance(node, ast.arg) else node.returns
            if isinstance(hint, ast.Name) and hint.id in SECTIONS:
                yield node.arg if isinstance(node, ast.arg) else node.name, [hint.id]


def _helpers(
    definitions: Sequence[ast.AST], values: Mapping[str, Sequence[str]], helpers: Mapping[str, Sequence[str]]
) -> Iterator[tuple[str, Sequence[str]]]:
    """Functions that hand their keywords on to a section, to `replace` or to another of them."""
    for node in definitions:
        if isinstance(node, ast.FunctionDef) and node.args.kwarg:
            handed, inner = node.args.kwarg.arg, (each for each in ast.walk(node) if isinstance(each, ast.Call))
            calls = [c for c in inner if any(not k.arg and getattr(k.value, "id", "") == handed for k in c.keywords)]
            if sections := [name for call in calls for name in _sections_filled(call, values, helpers)]:
                yield node.name, sections


def _called(call: ast.Call) -> str:
    return call.func.id if isinstance(call.func, ast.Name) else getattr(call.func, "attr", "")


def _sections_filled(
    call: ast.Call, values: Mapping[str, Sequence[str]], helpers: Mapping[str, Sequence[str]]
) -> Sequence[str]:
    """The sections whose keys the keywords of a call are."""
    name = _called(call)
    if name == "replace" and call.args:
        return _sections_held(call.args[0], values)
    return [name] if name in SECTIONS else helpers.get(name, ())


def _sections_held(node: ast.expr, values: Mapping[str, Sequence[str]]) -> Sequence[str]:
    """The sections that an expression may be: by its class, by the value it replaces, by its name or last attribute."""
    if isinstance(node, ast.Call):
        name = _called(node)
        if name == "replace" and node.args:
            return _sections_held(node.args[0], values)
        return [name] if name in SECTIONS else values.get(name, ())
    name = node.id if isinstance(node, ast.Name) else getattr(node, "attr", "")
    return values.get(name) or _sections_under(name)


def _literal(node: ast.expr) -> Any:
    """Lists and mappings as they are written; None for any other value."""
    if isinstance(node, ast.Dict):
        entries = zip(node.keys, node.values, strict=True)
        return {key.value: _literal(value) for key, value in entries if isinstance(key, ast.Constant)}
    if isinstance(node, ast.List | ast.Tuple):
        return [_literal(entry) for entry in node.elts]
    return None


@cache
def given_in(root: Path, *patterns: str) -> set[Given]:
    """Section and name of every key that files of these patterns give."""
    given: set[Given] = set()
    for file in (file for pattern in patterns for file in root.glob(pattern)):
        text = file.read_text(encoding="utf-8")
        given.update(in_python(text) if file.suffix == ".py" else in_yaml(text))
    return given
