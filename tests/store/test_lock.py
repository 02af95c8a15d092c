"""Two programs never write in one run folder, and a killed one leaves nothing that has to be cleared away."""

import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from elastid.base.errors import ElastidError
from elastid.store.lock import LOCK, one_writer

HOLDS = """
import sys, time
from pathlib import Path
from elastid.store.lock import one_writer
with one_writer(Path(sys.argv[1])):
    print("mine", flush=True)
    time.sleep(60)
"""


def holding(folder: Path) -> subprocess.Popen[str]:
    """Another program that writes there."""
    other = subprocess.Popen([sys.executable, "-c", HOLDS, str(folder)], stdout=subprocess.PIPE, text=True)
    assert other.stdout is not None
    assert other.stdout.readline() == "mine\n"
    return other


def test_the_second_writer_is_told_who_the_first_is(tmp_path: Path) -> None:
    """By its process and host, and since when; the first goes on undisturbed."""
    other = holding(tmp_path / "run")
    try:
        said = rf"process {other.pid} on .* since .* UTC; wait until .* --run"
        with pytest.raises(ElastidError, match=said), one_writer(tmp_path / "run"):
            pass
        assert other.poll() is None
    finally:
        other.kill()
        other.communicate()


@pytest.mark.skipif(os.name != "posix", reason="sends a signal")
def test_a_killed_writer_leaves_the_folder_free(tmp_path: Path) -> None:
    """Its file is still there, and no obstacle; the next one leaves none."""
    other = holding(tmp_path)
    other.send_signal(signal.SIGKILL)
    other.communicate()
    assert (tmp_path / LOCK).exists()
    with one_writer(tmp_path):
        pass
    assert not (tmp_path / LOCK).exists()


def test_many_that_come_at_once_take_turns(tmp_path: Path) -> None:
    """Of programs that try until they may, never two are inside at the same time."""
    script = """
import sys, time
from pathlib import Path
from elastid.base.errors import ElastidError
from elastid.store.lock import one_writer
folder, turns = Path(sys.argv[1]), 0
while turns < 15:
    try:
        with one_writer(folder):
            (folder / "inside").touch(exist_ok=False)
            time.sleep(0.001)
            (folder / "inside").unlink()
            turns += 1
    except ElastidError:
        time.sleep(0.001)
"""
    others = [subprocess.Popen([sys.executable, "-c", script, str(tmp_path)]) for _ in range(3)]
    assert [other.wait(60) for other in others] == [0, 0, 0]
