"""Plain data -> a section, or one readable sentence for each error that pydantic finds.

pydantic reports every branch of a union that failed, under labels of its own. Its locations are walked along the data
here, which drops the labels; of the errors about one union the most specific is kept.
"""

import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, is_dataclass
from typing import Any, TypeAlias

from pydantic import ValidationError

from elastid.base.codes import new_code, renamed_key
from elastid.base.errors import StudyError, did_you_mean
from elastid.base.escape import one_line, printable
from elastid.base.section import validator
from elastid.study.annotations import describe, literal_choices, names_in, type_at
from elastid.study.source import KeyPath, Place, YamlSource, first_of

PydanticError: TypeAlias = Mapping[str, Any]

# The last step of pydantic's location of an error about the key of a mapping, behind the key.
_OF_KEY = "[key]"


NO_LOG = "no such file"


@dataclass(frozen=True)
class Problem:
    """One error: the key path, a sentence, and True if the key (not its value) is at fault.

    is_weak: a second log must confirm it.
    """

    path: KeyPath
    message: str
    at_key: bool = False
    is_weak: bool = False


def validate(data: Any, root: type) -> tuple[Any, list[Problem]]:
    """Make the section `root` of plain data, and no problems; or None and the problems, each once."""
    problems = []
    value = None
    try:
        value = validator(root).validate_python(data)
    except ValidationError as error:
        problems = _find_problems(error.errors(include_url=False), root, data)
    paths = {problem.path for problem in problems}
    problems += [problem for problem in _find_booleans(data, value, root) if problem.path not in paths]
    return value, problems


def _find_problems(errors: Iterable[PydanticError], root: type, data: Any) -> list[Problem]:
    problems = []
    unions: dict[KeyPath, list[tuple[KeyPath, PydanticError]]] = {}
    for error in errors:
        path, union = _walk(error, data)
        if union is None:
            problems.append(_problem(error, path, root, data))
        else:
            unions.setdefault(union, []).append((path, error))
    for union, members in unions.items():
        problems += _union_problems(union, members, root, data)
    return list(dict.fromkeys(problems))


def _find_booleans(data: Any, value: Any, root: type, path: KeyPath = ()) -> list[Problem]:
    """Find values true or false at keys of another type; pydantic takes them for the numbers 1 and 0."""
    if isinstance(data, dict | list):
        entries = data.items() if isinstance(data, dict) else enumerate(data)
        return [problem for key, entry in entries for problem in _find_booleans(entry, value, root, (*path, key))]
    kind = Any if not isinstance(data, bool) or isinstance(value_at(value, path), bool) else type_at(root, path)
    if kind is Any or "true or false" in describe(kind):
        return []
    return [Problem(path, f"expected {describe(kind)}")]


def _walk(error: PydanticError, data: Any) -> tuple[KeyPath, KeyPath | None]:
    """Return pydantic's location as a path through the data, and the path of the outermost union on its way."""
    path = []
    union = None
    for depth, step in enumerate(error["loc"], start=1):
        is_missing = error["type"] == "missing" and depth == len(error["loc"])
        if isinstance(data, dict) and (step in data or is_missing):
            path.append(step)
            data = data.get(step)
        elif isinstance(data, list) and isinstance(step, int):
            if step >= len(data):  # an entry is missing: the list is at fault
                break
            path.append(step)
            data = data[step]
        elif union is None and step != _OF_KEY:
            union = tuple(path)
    return tuple(path), union


def _problem(error: PydanticError, path: KeyPath, root: type, data: Any) -> Problem:
    kind, parent = error["type"], value_at(data, path[:-1])
    if kind == "missing" and isinstance(parent, dict) and path and path[-1] not in parent:
        return Problem(path, "this key is required", at_key=True)
    if kind == "unexpected_keyword_argument":
        names = names_in(type_at(root, path[:-1]))
        return Problem(path, renamed_key(path) or f"unknown key; {did_you_mean(str(path[-1]), names)}", at_key=True)
    if kind == "value_error":
        message = str(error["ctx"]["error"])
        if error["loc"][-1:] == (_OF_KEY,):
            return Problem(path, message, at_key=True)
        path = _named_key(message, path, value_at(data, path))
        return Problem(path, message.removeprefix(f"{path[-1]}: ") if path else message)
    if kind == "finite_number":
        return Problem(path, "expected a finite number")
    new = new_code(f"{path[-1]}={value_at(data, path)}") if path else ""
    return Problem(path, new or f"expected {describe(type_at(root, path))}")


def _union_problems(
    union: KeyPath, members: list[tuple[KeyPath, PydanticError]], root: type, data: Any
) -> list[Problem]:
    """Return the errors of the branches that got into the data; where none did, the types that the union takes."""
    is_mapping = isinstance(value_at(data, union), dict)
    deeper = [
        _problem(error, path, root, data)
        for path, error in members
        if len(path) > len(union) or (is_mapping and error["type"] == "value_error")
    ]
    if deeper:
        return deeper
    annotation = type_at(root, union)
    sentences = [str(error["ctx"]["error"]) for _, error in members if error["type"] == "value_error"]
    if sentences and isinstance(value_at(data, union), str):
        return [Problem(union, " or ".join([sentences[0], *literal_choices(annotation)]))]
    return [Problem(union, f"expected {describe(annotation)}")]


def _named_key(message: str, path: KeyPath, section: Any) -> KeyPath:
    """Return the key, or the named entry of a list, that a sentence about a section names first; else the section."""
    if not isinstance(section, dict):
        return path
    entries = {
        str(entry["name"]): (key, i)
        for key, value in section.items()
        for i, entry in enumerate(value if isinstance(value, list) else [])
        if isinstance(entry, dict) and entry.get("name")
    }
    matches = {name: re.search(rf"(?<![\w.-]){re.escape(name)}(?!\w|[.-]\w)", message) for name in (*section, *entries)}
    starts = {name: match.start() for name, match in matches.items() if match is not None}
    if not starts:
        return path
    first = min(starts, key=starts.__getitem__)
    if first in section:
        return (*path, first)
    key, i = entries[first]
    return _named_key(message, (*path, key, i), section[key][i])


def value_at(data: Any, path: KeyPath) -> Any:
    """Return the value at a key path of plain data or of a section; None if it is missing."""
    for step in path:
        if isinstance(step, int):
            data = data[step] if isinstance(data, list | tuple) else None
        else:
            data = (
                data.get(step) if isinstance(data, dict) else getattr(data, step, None) if is_dataclass(data) else None
            )
    return data


def make_error(source: YamlSource, problems: Iterable[Problem], robot_errors: str = "") -> StudyError:
    """Return one line for each problem, in the order of the sources; last the errors of the robot's file."""
    lines = [message for _, message in sorted({_line(source, problem) for problem in problems})]
    return StudyError("study/invalid", "\n".join(filter(None, [first_of(lines), robot_errors])))


def _line(source: YamlSource, problem: Problem) -> tuple[Place, str]:
    value = value_at(source.data, problem.path)
    place = source.place(problem.path, of_value=not problem.at_key and value is not None)
    has_value = problem.at_key or (isinstance(value, str) and value in problem.message)
    value_text = "" if has_value or isinstance(value, dict | list) or value is None else f" (got {value!r:.60})"
    steps = (f"[{step}]" if isinstance(step, int) else f".{step}" for step in problem.path[place.skipped_keys :])
    keys = one_line("".join(steps).lstrip("."))
    return place, printable(f"{place}: {keys}{': ' if keys else ''}{problem.message}{value_text}")
