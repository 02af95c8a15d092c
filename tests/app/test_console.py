"""What a command says is said once."""

import errno
import os
from pathlib import Path

import pytest

from elastid.app import console as console_module
from elastid.app.console import Console


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
