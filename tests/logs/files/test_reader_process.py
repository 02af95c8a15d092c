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

TEXT = TextFormatSpec()
linux = pytest.mark.skipif(sys.platform != "linux", reason="other systems have no limit on the data of a process")


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Two logs, and modules beside them that are found before libraries of the same names."""
    (tmp_path / "scipy").mkdir()
    (tmp_path / "scipy" / "__init__.py").touch()
    savemat(tmp_path / "log.mat", {"a": np.arange(5.0)})
    (tmp_path / "log.tdms").write_bytes(b"TDSm")
    monkeypatch.setattr(sys, "path", [str(tmp_path), *sys.path])
    return tmp_path


@pytest.mark.parametrize(
    ("module", "code", "log"),
    [
        ("scipy/io.py", "import ctypes\n\ndef loadmat(path):\n    ctypes.string_at(0)\n", "log.mat"),
        pytest.param("nptdms.py", "held = bytearray(1 << 44)\n", "log.tdms", marks=linux),
    ],
)
def test_failing_reader_process_harms_nothing_else(folder: Path, module, code, log):
    """As a bad address ends a compiled reader, and where a library believes a length of 2^44."""
    (folder / module).write_text(code)
    with refused("files/damaged", holds=log):
        contents(folder / log, TEXT)


def test_a_fault_of_the_program_is_no_damaged_file(folder: Path, monkeypatch: pytest.MonkeyPatch):
    """Its traceback comes back from the process that reads; an error of a library is the file's."""
    (folder / "scipy" / "io.py").write_text("def loadmat(path):\n    return None\n")
    with pytest.raises(ProgramError) as fault:
        contents(folder / "log.mat", TEXT)
    assert "open_matlab" in str(fault.value)
    (folder / "scipy" / "io.py").write_text("def loadmat(path):\n    raise TypeError\n")
    monkeypatch.setattr(sys, "path", [str(folder), *sys.path, "another reader"])
    with refused("files/damaged", holds="log.mat"):
        contents(folder / "log.mat", TEXT)


def test_reader_loads_no_module_of_user_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """A folder of logs may hold a module of anybody, under the name of NumPy."""
    (tmp_path / "numpy.py").write_text("open('loaded', 'w')\n")
    savemat(tmp_path / "log.mat", {"a": np.arange(5.0)})
    monkeypatch.chdir(tmp_path)
    assert contents(Path("log.mat"), TEXT) == {"a": (1, 5)}
    assert not Path("loaded").exists()


def test_impossible_length_is_damage_not_memory(tmp_path: Path):
    """The first record of an MCAP file says that it is 2^62 bytes long: `the study asks for more memory`."""
    for length in (2**62, 2**36):
        record = b"\x01" + length.to_bytes(8, "little")
        (tmp_path / "log.mcap").write_bytes(b"\x89MCAP0\r\n" + record + bytes(64) + b"\x89MCAP0\r\n")
        with refused("files/damaged", holds="log.mcap"):
            contents(tmp_path / "log.mcap", TEXT)


def test_words_of_a_library_do_not_reach_the_terminal(folder: Path, capfd: pytest.CaptureFixture[str]):
    """Nor do they fall between the replies of the process that reads."""
    (folder / "nptdms.py").write_text("import sys\n\nprint('out')\nprint('err', file=sys.stderr)\nraise ImportError\n")
    with refused("install/missing-package", place="log.tdms", holds="nptdms"):
        contents(folder / "log.tdms", TEXT)
    assert capfd.readouterr() == ("", "")


def test_a_changed_file_is_read_again(tmp_path: Path):
    """The process keeps the last file open."""
    channel = ChannelSpec("y", "motor 1", "a", quantity="position")
    for last in (4.0, 7.0):
        savemat(tmp_path / "log.mat", {"a": np.append(np.arange(4.0), last)})
        assert read_channels(tmp_path / "log.mat", [channel], TEXT)[-1] == last
