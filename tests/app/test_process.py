"""Words of other libraries: none of them on the terminal of a command."""

import logging
import warnings

import pytest

from elastid.app.cli import run_command
from elastid.base.execution import ordered


def chatter(item: object) -> str:
    """A library that warns in both of Python's ways."""
    warnings.warn("overflow encountered in exp", RuntimeWarning, stacklevel=1)
    logging.getLogger("library").warning("findfont: no such font")
    return str(item)


def test_a_library_does_not_write_on_the_terminal_of_a_command(
    monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    """Of a command that keeps no log; afterwards Python is as it was."""
    monkeypatch.setattr("elastid.app.inspection.described", chatter)
    with warnings.catch_warnings():
        warnings.simplefilter("always")
        before = warnings.showwarning, list(logging.getLogger().handlers)
        assert run_command(["inspect", "log.csv"]) == 0
        assert (warnings.showwarning, list(logging.getLogger().handlers)) == before
    assert capfd.readouterr() == ("log.csv\n", "")


def test_nor_on_that_of_its_workers(capfd: pytest.CaptureFixture[str]) -> None:
    assert ordered(chatter, [1, 2, 3], 2) == ["1", "2", "3"]
    assert capfd.readouterr() == ("", "")
