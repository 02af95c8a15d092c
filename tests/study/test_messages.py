"""Each problem is one line with file, line, column, key, sentence and the value that was given."""

from dataclasses import dataclass
from typing import Literal

import pytest

from elastid.study.messages import Problem, make_error, validate, value_at
from elastid.study.source import parse


@dataclass(frozen=True)
class Inner:
    """A section in a section."""

    kind: Literal["a", "b"]
    number: float = 0.0


@dataclass(frozen=True)
class Outer:
    """A section."""

    inner: Inner
    name: str = ""


@pytest.mark.parametrize(
    ("text", "line"),
    [
        ("inner: {kind: c}\n", "s.yml:1:15: inner.kind: expected one of a, b (got 'c')"),
        ("inner: {kind: a, number: true}\n", "s.yml:1:26: inner.number: expected a number (got True)"),
        ("inner: {number: 1}\n", "s.yml:1:1: inner.kind: this key is required"),
    ],
)
def test_a_problem_names_its_place_and_value(text: str, line: str) -> None:
    """Of pydantic's errors the sentence alone; a truth value is no number."""
    source = parse(text, "s.yml")
    _, problems = validate(source.data, Outer)
    assert str(make_error(source, problems)) == line


def test_lines_are_in_the_order_of_the_file_each_once() -> None:
    """However the problems were found."""
    source = parse("name: x\ninner: {kind: a}\n", "s.yml")
    problems = [Problem(("inner",), "second", at_key=True), Problem(("name",), "first"), Problem(("name",), "first")]
    assert str(make_error(source, problems)) == "s.yml:1:7: name: first (got 'x')\ns.yml:2:1: inner: second"
    assert value_at(source.data, ("inner", "kind")) == "a"
    assert value_at(source.data, ("inner", "absent", 1)) is None
