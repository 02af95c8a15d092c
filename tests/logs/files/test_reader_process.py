"""Whatever is in a stranger's file, a sentence with its name comes out, and this process goes on."""

import sys
from pathlib import Path

import numpy as np
import pytest
from plants.refusals import refused
from scipy.io import savemat

from elastid.base.errors import ProgramError
from elastid.experiment.specs.channels import ChannelSpec
from elastid.experiment.specs.logs import TextFormatSpec
from elastid.logs.files.formats import contents, read_channels


def test_a_reader_of_matlab_files_that_dies_takes_nothing_along(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """SciPy's compiled reader is replaced by one that ends its process as a bad address does."""
    (tmp_path / "scipy").mkdir()
    (tmp_path / "scipy" / "__init__.py").touch()
    (tmp_path / "scipy" / "io.py").write_text("import ctypes\n\ndef loadmat(path):\n    ctypes.string_at(0)\n")
    savemat(tmp_path / "log.mat", {"a": np.arange(5.0)})
    monkeypatch.setattr(sys, "path", [str(tmp_path), *sys.path])
    with refused("files/damaged", holds="log.mat"):
        contents(tmp_path / "log.mat", TextFormatSpec())


def test_a_fault_of_the_program_is_no_damaged_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """Its traceback comes back from the process that reads; an error of a library is the file's."""
    (tmp_path / "scipy").mkdir()
    (tmp_path / "scipy" / "__init__.py").touch()
    savemat(tmp_path / "log.mat", {"a": np.arange(5.0)})
    monkeypatch.setattr(sys, "path", [str(tmp_path), *sys.path])
    (tmp_path / "scipy" / "io.py").write_text("def loadmat(path):\n    return None\n")
    with pytest.raises(ProgramError) as fault:
        contents(tmp_path / "log.mat", TextFormatSpec())
    assert "open_matlab" in str(fault.value)
    (tmp_path / "scipy" / "io.py").write_text("def loadmat(path):\n    raise TypeError\n")
    monkeypatch.setattr(sys, "path", [str(tmp_path), *sys.path, "another reader"])
    with refused("files/damaged", holds="log.mat"):
        contents(tmp_path / "log.mat", TextFormatSpec())


def test_no_module_of_the_users_folder_is_loaded_to_read_a_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """A folder of logs may hold a module of anybody, under the name of NumPy."""
    (tmp_path / "numpy.py").write_text("open('loaded', 'w')\n")
    savemat(tmp_path / "log.mat", {"a": np.arange(5.0)})
    monkeypatch.chdir(tmp_path)
    assert contents(Path("log.mat"), TextFormatSpec()) == {"a": (1, 5)}
    assert not Path("loaded").exists()


def test_a_length_that_no_file_has_is_damage_and_no_lack_of_memory(tmp_path: Path):
    """The first record of an MCAP file says that it is 2^62 bytes long: `the study asks for more memory`."""
    for length in (2**62, 2**36):
        record = b"\x01" + length.to_bytes(8, "little")
        (tmp_path / "log.mcap").write_bytes(b"\x89MCAP0\r\n" + record + bytes(64) + b"\x89MCAP0\r\n")
        with refused("files/damaged", holds="log.mcap"):
            contents(tmp_path / "log.mcap", TextFormatSpec())


@pytest.mark.skipif(sys.platform != "linux", reason="other systems have no limit on the data of a process")
def test_a_reader_has_a_limit_of_memory(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """A library that believes a length of 2^44 is stopped where it asks for the memory."""
    (tmp_path / "nptdms.py").write_text("held = bytearray(1 << 44)\n")
    (tmp_path / "log.tdms").write_bytes(b"TDSm")
    monkeypatch.setattr(sys, "path", [str(tmp_path), *sys.path])
    with refused("files/damaged", holds="log.tdms"):
        contents(tmp_path / "log.tdms", TextFormatSpec())


def test_words_of_a_library_do_not_reach_the_terminal(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
):
    """Nor do they fall between the replies of the process that reads."""
    (tmp_path / "nptdms.py").write_text(
        "import sys\n\nprint('out')\nprint('err', file=sys.stderr)\nraise ImportError\n"
    )
    (tmp_path / "log.tdms").write_bytes(b"TDSm")
    monkeypatch.setattr(sys, "path", [str(tmp_path), *sys.path])
    with refused("install/missing-package", place="log.tdms", holds="nptdms"):
        contents(tmp_path / "log.tdms", TextFormatSpec())
    assert capfd.readouterr() == ("", "")


def test_a_changed_file_is_read_again(tmp_path: Path):
    """The process keeps the last file open."""
    channel = ChannelSpec("y", "motor 1", "a", quantity="position")
    for last in (4.0, 7.0):
        savemat(tmp_path / "log.mat", {"a": np.append(np.arange(4.0), last)})
        assert read_channels(tmp_path / "log.mat", [channel], TextFormatSpec())[-1] == last
