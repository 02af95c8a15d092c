"""Output of a run."""

import pytest

from elastid.app import console
from elastid.app.console import Console


def test_a_warning_is_printed_once(capsys: pytest.CaptureFixture[str]) -> None:
    quiet = Console(-1)
    for text in ("first", "second", "first"):
        quiet.warn(text)
    assert capsys.readouterr().err.splitlines() == ["warning: first", "warning: second"]


def test_no_time_is_estimated_before_three_units_are_done(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(console, "INTERVAL_S", -1.0)
    with Console().progress("fit") as progress:
        for done in range(6):
            progress(done, 6)
    lines = capsys.readouterr().err.splitlines()
    assert [f"{done} of 6" in line for done, line in enumerate(lines, start=1)] == [True] * 5
    assert [" s to go" in line for line in lines] == [False, False, True, True, True]
