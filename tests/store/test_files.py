"""Files are whole or absent, a bit that flips in them is noticed or harmless, and two programs never write at once."""

import json
import os
import signal
import subprocess
import sys
from pathlib import Path

import h5py
import numpy as np
import pytest
from plants.artefacts import STAMP, some_fit
from plants.refusals import refused

from elastid.app.inspection import describe_file
from elastid.base.errors import ElastidError
from elastid.store.artefacts import read_stamp
from elastid.store.files import CHECKSUMS, USER_BLOCK, changed_texts, has_checksum, is_intact, save_checksums
from elastid.store.lock import LOCK, lock_folder
from elastid.store.results import read_fit, write_fit

FLIPS = 60


def test_a_flipped_bit_is_refused_or_changes_nothing(tmp_path: Path) -> None:
    """Behind the user block every bit counts; in it a bit spoils the checksum, or the mark that one is there."""
    path, spoilt = tmp_path / "fit.h5", tmp_path / "spoilt.h5"
    write_fit(path, some_fit(), STAMP)
    content, values = path.read_bytes(), read_fit(path).values
    random = np.random.default_rng(1)
    places = np.concatenate([random.integers(USER_BLOCK, len(content), FLIPS), random.integers(0, USER_BLOCK, 40)])
    for number, place in enumerate(places):
        flipped = bytearray(content)
        flipped[place] ^= 1 << int(random.integers(8))
        spoilt = tmp_path / f"spoilt{number}.h5"
        spoilt.write_bytes(flipped)
        if place >= USER_BLOCK:
            with refused("files/damaged", holds=".h5"):
                describe_file(spoilt)
            assert read_stamp(spoilt) is None
            with refused("files/damaged", holds=".h5"):
                read_fit(spoilt)
        elif is_intact(spoilt):
            assert not has_checksum(spoilt)
            assert read_fit(spoilt).values == values


def test_other_programs_read_the_file_behind_its_checksum(tmp_path: Path) -> None:
    """The user block is HDF5's own place for a text of the owner; a file without one is read, too."""
    path = tmp_path / "fit.h5"
    write_fit(path, some_fit(), STAMP)
    assert path.read_bytes().startswith(b"elastid, SHA-256 of what follows these 512 bytes: ")
    with h5py.File(path) as file:
        assert file.userblock_size == USER_BLOCK
    (tmp_path / "bare.h5").write_bytes(path.read_bytes()[USER_BLOCK:])
    assert read_fit(tmp_path / "bare.h5").values == read_fit(path).values


def test_a_file_that_was_written_again_is_looked_at_again(tmp_path: Path) -> None:
    """What was found of a file holds for that version alone."""
    path = tmp_path / "fit.h5"
    write_fit(path, some_fit(), STAMP)
    assert is_intact(path)
    content = bytearray(path.read_bytes())
    content[-1] ^= 1
    path.write_bytes(content)
    assert not is_intact(path)
    write_fit(path, some_fit(), STAMP)
    assert is_intact(path)


NAMES = ("summary.json", "figures", "references/*.csv")


@pytest.fixture
def folder(tmp_path) -> Path:
    """A run folder with a text, a figure and a reference."""
    for name in ("summary.json", "figures/a.png", "references/a.csv"):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_text(json.dumps({"stiffness": 12345.678}))
    save_checksums(tmp_path, NAMES)
    return tmp_path


@pytest.mark.parametrize("name", ["summary.json", "figures/a.png", "references/a.csv"])
def test_every_flipped_bit_of_a_text_is_noticed(folder: Path, name: str) -> None:
    """In a figure and in a reference, too, and `inspect` refuses it."""
    content = (folder / name).read_bytes()
    assert changed_texts(folder, NAMES) == ()
    for bit in range(8 * len(content)):
        spoilt = bytearray(content)
        spoilt[bit // 8] ^= 1 << bit % 8
        (folder / name).write_bytes(spoilt)
        assert changed_texts(folder, NAMES) == (name,)
    with refused("files/damaged"):
        describe_file(folder / name)


def test_a_damaged_list_never_vouches_for_a_damaged_text(folder: Path) -> None:
    """It says at worst that an intact file has changed, and is written again."""
    path = folder / CHECKSUMS
    content = path.read_bytes()
    for place in range(len(content)):
        spoilt = bytearray(content)
        spoilt[place] ^= 1 << place % 8
        path.write_bytes(spoilt)
        assert len(changed_texts(folder, NAMES)) <= 1
    save_checksums(folder, NAMES)
    assert changed_texts(folder, NAMES) == ()


HOLDS = """
import sys, time
from pathlib import Path
from elastid.store.lock import lock_folder
with lock_folder(Path(sys.argv[1])):
    print("mine", flush=True)
    time.sleep(60)
"""


def holding(folder: Path) -> subprocess.Popen[str]:
    """Another program that writes there."""
    other = subprocess.Popen([sys.executable, "-c", HOLDS, str(folder)], stdout=subprocess.PIPE, text=True)
    assert other.stdout.readline() == "mine\n"
    return other


def test_the_second_writer_is_told_who_the_first_is(tmp_path: Path) -> None:
    """By its process and host, and since when; the first goes on undisturbed."""
    other = holding(tmp_path / "run")
    try:
        said = rf"process {other.pid} on .* since .* UTC; wait until .* --run"
        with pytest.raises(ElastidError, match=said), lock_folder(tmp_path / "run"):
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
    with lock_folder(tmp_path):
        pass
    assert not (tmp_path / LOCK).exists()


def test_many_that_come_at_once_take_turns(tmp_path: Path) -> None:
    """Of programs that try until they may, never two are inside at the same time."""
    script = """
import sys, time
from pathlib import Path
from elastid.base.errors import ElastidError
from elastid.store.lock import lock_folder
folder, turns = Path(sys.argv[1]), 0
while turns < 15:
    try:
        with lock_folder(folder):
            (folder / "inside").touch(exist_ok=False)
            time.sleep(0.001)
            (folder / "inside").unlink()
            turns += 1
    except ElastidError:
        time.sleep(0.001)
"""
    others = [subprocess.Popen([sys.executable, "-c", script, str(tmp_path)]) for _ in range(3)]
    assert [other.wait(60) for other in others] == [0, 0, 0]


def test_a_file_is_no_folder_of_results(tmp_path: Path) -> None:
    (tmp_path / "run").write_text("kept")
    with refused("files/folder"), lock_folder(tmp_path / "run"):
        pass
    assert (tmp_path / "run").read_text() == "kept"


# In a process of its own: HDF5 that crashes does so when the process ends.
PROGRAM = """
import resource, sys
from pathlib import Path
import numpy as np
from elastid.store.artefacts import NO_STAMP, create_artefact
from elastid.store.files import text_file

def write(path):
    with create_artefact(path, "test", NO_STAMP) as file:
        for name in "abc":
            group = file.create_group(name)
            group.create_dataset("t", data=np.arange(200.0))
            group.create_dataset("v", data=np.arange(200.0))

def write_text(path):
    with text_file(path) as file:
        file.write("x" * 20_000)

folder = Path(sys.argv[1])
for name, work in (("a.h5", write), ("a.csv", write_text)):
    work(folder / name)
    whole = (folder / name).read_bytes()
    (folder / name).unlink()
    refused = 0
    for limit in [*range(0, len(whole), 3000), len(whole)]:
        resource.setrlimit(resource.RLIMIT_FSIZE, (limit, resource.RLIM_INFINITY))
        try:
            work(folder / name)
        except OSError as error:
            assert error.filename == str(folder / name), error
            assert not list(folder.iterdir()), list(folder.iterdir())
            refused += 1
    resource.setrlimit(resource.RLIMIT_FSIZE, (resource.RLIM_INFINITY,) * 2)
    assert (folder / name).read_bytes() == whole
    (folder / name).unlink()
    print(refused)
"""


@pytest.mark.skipif(sys.platform == "win32", reason="the limit of a file's size is one of POSIX")
def test_a_file_that_does_not_fit_is_named_and_absent(tmp_path: Path) -> None:
    """At every size of the disk; at the size of the file it is written, the same bytes."""
    done = subprocess.run([sys.executable, "-c", PROGRAM, str(tmp_path)], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert all(int(count) >= 6 for count in done.stdout.split())
