"""Codes of errors and notes: one table, all of it used, and nothing beside it; names that changed are answered."""

import ast
from pathlib import Path

import pytest
from plants.refusals import refused

import elastid
from elastid.app import cli
from elastid.base import errors
from elastid.base.codes import codes, renamed_names
from elastid.study.loading import load
from elastid.study.reference import explain

PACKAGE = Path(elastid.__file__).parent
CODED = {"ElastidError", "StudyError", "DataError", "FitError", "MisfitError", "Note"}


def test_codes_of_errors_and_notes_are_complete_used_explained() -> None:
    constants = set()
    for file in sorted(PACKAGE.rglob("*.py")):
        for node in ast.walk(ast.parse(file.read_text())):
            if isinstance(node, ast.Call) and getattr(node.func, "id", getattr(node.func, "attr", "")) in CODED:
                code = node.args[0] if node.args else None
                assert not isinstance(code, ast.Constant) or code.value in codes(), f"{file}:{node.lineno}"
            if isinstance(node, ast.Constant) and file.name != "codes.py":
                constants.add(node.value)
    assert set(codes()) <= constants
    assert len(codes()) <= 150
    for code, (meaning, remedy) in codes().items():
        assert all((meaning, remedy))
        assert explain(code).splitlines()[1:] == [f"  {meaning}", f"  {remedy}"]


def test_every_code_has_one_exit_code() -> None:
    """A program that reads the code knows how the command ended."""
    exit_codes = {}
    for file in PACKAGE.rglob("*.py"):
        for node in ast.walk(ast.parse(file.read_text())):
            kind = getattr(errors, getattr(getattr(node, "func", None), "id", ""), None)
            if isinstance(kind, type) and issubclass(kind, errors.ElastidError) and isinstance(node, ast.Call):
                code = node.args[0] if node.args else None
                if isinstance(code, ast.Constant):
                    exit_codes.setdefault(str(code.value), set()).add(kind.exit_code)
    assert {code for code, each in exit_codes.items() if len(each) > 1} == set()


def test_an_unknown_code_is_refused_with_the_nearest() -> None:
    with refused("study/unknown-key", holds="records/clock"):
        explain("records/clok")


@pytest.mark.parametrize(("old", "new"), renamed_names().items())
def test_explain_answers_an_old_name_with_one_that_exists(old: str, new: str) -> None:
    if not {".", "/"} & set(old):
        return
    with refused("study/unknown-key", holds=new):
        explain(old)
    assert explain(new if "/" in new else f"{old.partition('.')[0]}.{new}")


@pytest.mark.parametrize("override", ["fit.weights.floor=0.1", "friction.passes=detect", "tool={motors: held}"])
def test_study_with_old_name_gets_new_name(override: str, tmp_path: Path) -> None:
    assert cli.run_command(["new", str(tmp_path / "arm")]) == 0
    with refused("study/invalid", holds="renamed to "):
        load(tmp_path / "arm" / "study.yml", (override,))


@pytest.mark.parametrize("words", ["run x levels", "loops x --draws 2"])
def test_command_line_with_old_word_gets_new_word(words: str, capsys) -> None:
    assert cli.run_command(words.split()) == 2
    assert "renamed to" in capsys.readouterr().err
