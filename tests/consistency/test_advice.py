"""Every advice in every message works when it is pasted: found in the source, provoked, followed, and gone."""

from __future__ import annotations

import ast
import inspect
import re
import textwrap
from pathlib import Path

import pytest
from plants import advice_of_changes, advice_of_fits, advice_of_logs, advice_of_sessions, advice_of_studies
from plants.advice import CASES, GAP, Case, Desk, advices, keys

# Each registers its cases.
assert advice_of_changes, advice_of_fits
assert advice_of_logs, advice_of_sessions
assert advice_of_studies


@pytest.mark.slow
def test_no_advice_is_forgotten() -> None:
    """Whatever a message tells a user to paste or to change has a case, and no case is left over."""
    assert {(advice.module, advice.text) for advice in advices()} == {*CASES}


@pytest.mark.slow
def test_a_setting_names_a_key_that_exists() -> None:
    """With the sections that it names, whatever stands for names that the study chooses."""
    for advice in (each for each in advices() if each.is_setting):
        path = advice.text.partition(":")[0].replace(f".{GAP}", "").replace("[]", "")
        paths = [re.sub(r"\[\]|\.?<name>", "", key.path) for key in keys()[path.rpartition(".")[2]]]
        assert any(each.endswith(path) for each in paths), (advice, paths)


@pytest.mark.slow
def test_a_change_names_a_key_that_exists() -> None:
    """With the sections that it names."""
    changes = [advice for advice in advices() if advice.is_change]
    assert changes
    for advice in changes:
        path = advice.text.partition(" ")[2]
        paths = [re.sub(r"\[\]|\.?<name>", "", key.path) for key in keys()[path.rpartition(".")[2]]]
        assert any(each.endswith(path) for each in paths), (advice, paths)


@pytest.mark.parametrize(
    "follow",
    [
        pytest.param(function, id=function.__name__, marks=[pytest.mark.slow] * slow)
        for function, slow in dict(CASES.values()).items()
    ],
)
def test_an_advice_works_when_it_is_pasted(follow: Case, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """The message is there, and gone once its advice is followed: the case asserts it, step by step."""
    assert any(isinstance(node, ast.Assert) for node in ast.walk(ast.parse(textwrap.dedent(inspect.getsource(follow)))))
    follow(Desk(tmp_path, capsys))
