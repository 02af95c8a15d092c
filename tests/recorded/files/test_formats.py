"""The formats of log files, and channels of a log by name."""

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from importlib.metadata import EntryPoint
from pathlib import Path

import numpy as np
import pytest
from plants.lab_logs import (
    RATE,
    measured,
    study_of,
    with_names,
    write_csv,
    write_matlab,
    write_matlab_73,
)
from plants.refusals import refused
from plants.ros_bag import LogArrays, write_bag

from elastid.experiment.specs.channels import ChannelSpec
from elastid.experiment.specs.experiment import ExperimentSpec
from elastid.experiment.specs.recorded import TextFormatSpec
from elastid.recorded.files import formats
from elastid.recorded.files.formats import Format, contents, read_channels
from elastid.recorded.files.log import ArrayLog, StoredArray


def test_contents_lists_every_signal_of_a_file(tmp_path: Path, log: dict[str, np.ndarray]) -> None:
    """Names and shapes as a channel would be written in a study; no texts, scalars or references."""
    text = TextFormatSpec()
    write_matlab(tmp_path, log)
    assert contents(tmp_path / "log.mat", text) == {
        "rec.cur": (2, 800),
        "rec.phi": (1, 800),
        "run(1).w": (1, 800),
        "run(2).w": (1, 800),
        "cells{1}": (1, 50),
    }
    write_matlab_73(tmp_path, log)
    assert contents(tmp_path / "new.mat", text) == {"rec.cur": (800, 2), "rec.phi": (800, 1), "w2": (800, 1)}
    write_csv(tmp_path, log)
    assert contents(tmp_path / "log.csv", text) == dict.fromkeys(("t", "i1", "i2", "phi", "w2"), (800,))


def test_files_that_are_no_logs_are_refused(tmp_path: Path) -> None:
    """A damaged MATLAB file, bytes of no format, a text without numbers, formats that no text can have."""
    (tmp_path / "bad.mat").write_bytes(b"MATLAB 5.0 MAT-file, but not really".ljust(200, b"x"))
    (tmp_path / "bytes.h5").write_bytes(bytes(range(256)) * 8)
    (tmp_path / "words.csv").write_text("no,numbers\nin,here\n")
    (tmp_path / "empty.csv").write_text("\n")
    for name, text, code, place in (
        ("bad.mat", TextFormatSpec(), "files/damaged", ""),
        ("bytes.h5", TextFormatSpec(), "files/damaged", "bytes.h5"),
        ("words.csv", TextFormatSpec(), "records/text", "words.csv"),
        ("empty.csv", TextFormatSpec(), "records/text", "empty.csv"),
        ("words.csv", TextFormatSpec(",", ","), "records/text", "text"),
        ("words.csv", TextFormatSpec(",,"), "records/text", "text"),
    ):
        with refused(code, place=place):
            measured(tmp_path, study_of(name, text=text))


TEXT = TextFormatSpec()


def write_tdms(base: Path, log: LogArrays) -> ExperimentSpec:
    from nptdms import ChannelObject, TdmsWriter

    properties = {"wf_increment": 1 / RATE, "unit_string": "mA"}
    with TdmsWriter(base / "log.tdms") as writer:
        # Two segments, as a logger writes them.
        for half in (slice(0, 400), slice(400, None)):
            writer.write_segment(
                [ChannelObject("drive", name, values[half], properties) for name, values in log.items()]
            )
    return study_of("log.tdms", with_names({name: f"drive/{name}" for name in log}))


def write_parquet(base: Path, log: LogArrays) -> ExperimentSpec:
    import pyarrow as pa
    import pyarrow.parquet as pq

    drive = pa.StructArray.from_arrays([pa.array(log["i1"]), pa.array(log["i2"])], ["i1", "i2"])
    table = pa.table({"drive": drive, "phi": log["phi"], "w2": log["w2"]})
    pq.write_table(table, base / "log.parquet", row_group_size=300)
    return study_of("log.parquet", with_names({"i1": "drive.i1", "i2": "drive.i2", "phi": "phi", "w2": "w2"}))


BAG_NAMES = {
    "i1": "joint_states.effort.shoulder",
    "i2": "joint_states.effort.elbow",
    "phi": "joint_states.position.shoulder",
    "w2": "joint_states.position.elbow",
}


def write_bag_folder(base: Path, log: LogArrays) -> ExperimentSpec:
    write_bag(base / "bag", log)
    return study_of("bag", with_names(BAG_NAMES), time="joint_states.time")


def write_mcap_file(base: Path, log: LogArrays) -> ExperimentSpec:
    (file,) = write_bag(base / "bag", log, "MCAP").glob("*.mcap")
    return study_of(str(file.relative_to(base)), with_names(BAG_NAMES), time="joint_states.time")


@pytest.mark.parametrize("write", [write_tdms, write_parquet, write_bag_folder, write_mcap_file])
def test_a_log_is_the_same_record_in_every_format(
    write: Callable[[Path, LogArrays], ExperimentSpec], tmp_path: Path, log: LogArrays
) -> None:
    """As from the CSV file: the numbers are read, not interpreted."""
    expected, found = (measured(tmp_path, each(tmp_path, log)) for each in (write_csv, write))
    # Time stamps in ns put samples at 1e-7 of their distance.
    tolerance = {"rtol": 1e-6, "atol": 1e-6}
    np.testing.assert_allclose(found.u, expected.u, **tolerance)
    np.testing.assert_allclose(found.y, expected.y, **tolerance)


@pytest.mark.parametrize(
    ("start", "module", "extra"),
    [
        (b"TDSm", "nptdms", "tdms"),
        (b"PAR1", "pyarrow.parquet", "parquet"),
        (b"\x89MCAP0\r\n", "rosbags.highlevel", "ros"),
    ],
)
def test_a_library_that_is_not_installed_is_named_with_the_command_that_installs_it(
    start: bytes, module: str, extra: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """In one sentence, for each extra."""
    (tmp_path / "log").write_bytes(start)
    package, _, rest = module.partition(".")
    (tmp_path / package).mkdir()
    (tmp_path / package / "__init__.py").write_text("" if rest else "raise ImportError")
    monkeypatch.setattr(sys, "path", [str(tmp_path), *sys.path])
    with refused("install/missing-package", place="log", holds=f"--extra {extra}"):
        contents(tmp_path / "log", TEXT)


@contextmanager
def _opened_doubles(path: Path, text: TextFormatSpec) -> Iterator[ArrayLog]:
    values = np.frombuffer(path.read_bytes()[4:])
    yield ArrayLog(path, {"x": StoredArray(values.shape, values.dtype, lambda: values)})


DOUBLES = Format("raw", lambda path, head: head.startswith(b"RAW!"), _opened_doubles, "export it again")
NO_FORMAT = 7


def _register(monkeypatch: pytest.MonkeyPatch, name: str) -> None:
    monkeypatch.setitem(sys.modules, "elastid_doubles", sys.modules[__name__])
    point = EntryPoint("doubles", f"elastid_doubles:{name}", "elastid.readers")
    monkeypatch.setattr(formats, "_points", lambda: (point,))


def test_another_package_adds_a_format_by_an_entry_point(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Its file is read; files of other formats are read as before."""
    _register(monkeypatch, "DOUBLES")
    (tmp_path / "log.raw").write_bytes(b"RAW!" + np.arange(5.0).tobytes())
    assert contents(tmp_path / "log.raw", TEXT) == {"x": (5,)}
    (tmp_path / "log.csv").write_text("a,b\n1,2\n3,4\n")
    assert contents(tmp_path / "log.csv", TEXT) == {"a": (2,), "b": (2,)}


@pytest.mark.parametrize("name", ["ABSENT", "NO_FORMAT"])
def test_an_entry_point_that_holds_no_format_is_named(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """What cannot be imported, and what is something else."""
    _register(monkeypatch, name)
    (tmp_path / "log.csv").write_text("a,b\n1,2\n3,4\n")
    with refused("install/missing-package", holds=("doubles", name)):
        contents(tmp_path / "log.csv", TEXT)


def _read(path: Path, *names: str, column: int | None = None) -> np.ndarray:
    return read_channels(path, [ChannelSpec("u", "motor 1", name, column) for name in names], TEXT)


def test_dates_are_seconds_and_missing_values_are_missing(tmp_path: Path) -> None:
    """Time stamps of Parquet, its null, and whole numbers and floats of 32 bits as they are."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    at = np.datetime64("2026-05-01T10:00:00", "ns") + np.arange(4) * np.timedelta64(2_500_000, "ns")
    table = pa.table(
        {"t": at, "x": pa.array([1, None, 3, 4]), "f": np.arange(4, dtype=np.float32), "who": ["a", "b", "c", "d"]}
    )
    pq.write_table(table, tmp_path / "log.dat")
    assert contents(tmp_path / "log.dat", TEXT) == dict.fromkeys(("t", "x", "f"), (4,))
    np.testing.assert_array_equal(
        _read(tmp_path / "log.dat", "t", "x", "f"), [[0, 1, 0], [0.0025, np.nan, 1], [0.005, 3, 2], [0.0075, 4, 3]]
    )


@pytest.mark.parametrize(
    ("name", "column", "message"),
    [
        ("rec.psi", None, ("rec.psi", "rec.phi", "rec.cur (2 x 800)")),
        ("rec.cur", None, ("2 signals", "column: 1 to 2")),
        ("rec.cur", 3, "column 3"),
        ("rec.note", None, ("rec.note", "<U5")),
        ("fs", None, "fs"),
        ("cells{1}", None, ("800", "50 samples")),
        ("", None, ()),
    ],
)
def test_a_channel_that_a_matlab_file_does_not_hold_is_named_with_those_it_has(
    name: str, column: int | None, message: str, tmp_path: Path, log: dict[str, np.ndarray]
) -> None:
    """Missing, a matrix without a column, a wrong column, a text, a scalar, another length, no name at all."""
    write_matlab(tmp_path, log)
    u = ChannelSpec("u", "motor 1", "run(1).w")
    y = ChannelSpec("y", "motor 1", name, column or (None if name else 1), "position")
    with refused("records/channels", holds=message):
        measured(tmp_path, study_of("log.mat", (u, y)))
