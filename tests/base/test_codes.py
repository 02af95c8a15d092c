"""Codes of errors and notes: one table, all of it used, and nothing beside it."""

import ast
from pathlib import Path

import pytest

import elastid
from elastid.base.errors import CODES, StudyError
from elastid.study.reference import explain

PACKAGE = Path(elastid.__file__).parent
CODED = {"ElastidError", "StudyError", "DataError", "FitError", "MisfitError", "Note"}


def test_every_error_and_note_has_a_code_of_the_table_and_every_code_is_used_and_explained() -> None:
    constants = set[object]()
    for file in sorted(PACKAGE.rglob("*.py")):
        for node in ast.walk(ast.parse(file.read_text())):
            if isinstance(node, ast.Call) and getattr(node.func, "id", getattr(node.func, "attr", "")) in CODED:
                code = node.args[0] if node.args else None
                assert not isinstance(code, ast.Constant) or code.value in CODES, f"{file}:{node.lineno}"
            if isinstance(node, ast.Constant) and file.name != "codes.py":
                constants.add(node.value)
    assert set(CODES) <= constants
    assert len(CODES) <= 150
    assert all(CODES[code] in explain(code) for code in CODES)


def test_an_unknown_code_is_refused_with_the_nearest() -> None:
    with pytest.raises(StudyError) as refused:
        explain("records/clok")
    assert refused.value.code == "study/unknown-key"
    assert "records/clock" in refused.value.text
