"""Codes of errors and notes: one table, all of it used, and nothing beside it."""

import ast
from collections.abc import Iterator
from pathlib import Path

import pytest

import elastid
from elastid.base.errors import CODES, StudyError
from elastid.study.reference import explain

PACKAGE = Path(elastid.__file__).parent
CODED = {"ElastidError", "StudyError", "DataError", "FitError", "MisfitError", "Note"}


def calls() -> Iterator[tuple[str, ast.Call]]:
    for file in sorted(PACKAGE.rglob("*.py")):
        for node in ast.walk(ast.parse(file.read_text())):
            if isinstance(node, ast.Call) and getattr(node.func, "id", getattr(node.func, "attr", "")) in CODED:
                yield f"{file.relative_to(PACKAGE)}:{node.lineno}", node


def test_every_error_and_note_has_a_code_of_the_table() -> None:
    for place, call in calls():
        code = call.args[0] if call.args else None
        if isinstance(code, ast.Constant):
            assert code.value in CODES, place


def test_every_code_is_used_and_explained() -> None:
    constants = {
        node.value
        for file in PACKAGE.rglob("*.py")
        if file.name != "codes.py"
        for node in ast.walk(ast.parse(file.read_text()))
        if isinstance(node, ast.Constant) and isinstance(node.value, str)
    }
    assert set(CODES) <= constants
    assert len(CODES) <= 150
    assert all(CODES[code] in explain(code) for code in CODES)


def test_an_unknown_code_is_refused_with_the_nearest() -> None:
    with pytest.raises(StudyError) as refused:
        explain("records/clok")
    assert refused.value.code == "study/unknown-key"
    assert "records/clock" in refused.value.text
