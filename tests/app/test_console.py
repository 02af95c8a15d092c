"""What a command says is said once."""

import logging

import pytest

from elastid.app.console import Console


def test_a_warning_outside_a_run_is_printed_once(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """And not by Python's own handler of last resort beside it."""
    monkeypatch.setattr(logging.getLogger("elastid.app.run"), "handlers", [])
    Console().warn("mind the gap")
    assert capsys.readouterr().err == "warning: mind the gap\n"
