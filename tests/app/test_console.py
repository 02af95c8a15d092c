"""What a command says is said once."""

import errno
import logging
import os
from pathlib import Path

import pytest

from elastid.app import console as console_module
from elastid.app.console import Console, parameter_table
from elastid.report.content import ParameterRow


def test_a_warning_outside_a_run_is_printed_once(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """And not by Python's own handler of last resort beside it."""
    monkeypatch.setattr(logging.getLogger("elastid.app.run"), "handlers", [])
    Console().warn("mind the gap")
    assert capsys.readouterr().err == "warning: mind the gap\n"


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="the system has no disk that is always full")
def test_a_full_disk_is_named_by_the_result_and_not_by_the_log(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The log's own lines are lost without a word, also those that are left when it is closed."""
    monkeypatch.setattr(console_module, "unlinked", lambda path, flags: os.open("/dev/full", os.O_WRONLY))

    def measure() -> None:
        console = Console(-1)
        with console.logging_to(tmp_path):
            console.say("measured")
            raise OSError(errno.ENOSPC, "No space left on device", "records.h5")

    with pytest.raises(OSError, match=r"records\.h5"):
        measure()


def test_the_truth_has_the_digits_of_the_estimate() -> None:
    """Rounded to fewer, it would lie outside an interval that holds it."""
    interval, bounds = (33334670.0, 33335630.0), (4e5, 4e9)
    row = ParameterRow("k_1", "N*m/rad", 33335150.0, 245.0, interval, 4e7, bounds, False, truth=33335240.0)
    (_, line) = parameter_table([row])
    assert line[2:4] == ["33335240", "33335150"]
