"""Output of a run."""

import pytest

from elastid.app.console import Console


def test_a_warning_is_printed_once(capsys: pytest.CaptureFixture[str]) -> None:
    console = Console(-1)
    for text in ("first", "second", "first"):
        console.warn(text)
    assert capsys.readouterr().err.splitlines() == ["warning: first", "warning: second"]
