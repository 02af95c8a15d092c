"""The formats of log files, and channels of a log by name."""

import gzip
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from importlib.metadata import EntryPoint
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
from plants.lab_logs import CHANNELS, RATE, RATIO, N, P, Signals, measured, save_csv, study_of, with_names, write_csv
from plants.notes import said
from plants.refusals import refused
from plants.ros_bag import LogArrays, write_bag
from scipy.io import savemat

from elastid.base import entry_points
from elastid.experiment.specs.channels import ChannelSpec, Structure
from elastid.experiment.specs.experiment import ExperimentSpec
from elastid.experiment.specs.logs import FileSpec, RecordedSpec, TextFormatSpec
from elastid.logs.channels import gather_channels
from elastid.logs.files import binary_formats, reader_process, ros_bag
from elastid.logs.files.formats import Format, contents, open_log, read_channels
from elastid.logs.files.log import ArrayLog, StoredArray


def write_matlab(base: Path, log: Signals) -> ExperimentSpec:
    struct = {"cur": np.stack([log["i1"], log["i2"]]), "phi": log["phi"], "note": "run 7"}
    runs = np.array([(log["w2"],), (2 * log["w2"],)], dtype=[("w", object)])
    cells = np.array([np.ones(50), "text"], dtype=object)
    savemat(base / "log.mat", {"rec": struct, "run": runs, "fs": 100.0, "cells": cells})
    channels = with_names({"i1": "rec.cur", "i2": "rec.cur", "phi": "rec.phi", "w2": "run(1).w"})
    return study_of("log.mat", (replace(channels[0], column=2), replace(channels[1], column=1), *channels[2:]))


def write_matlab_73(base: Path, log: Signals) -> ExperimentSpec:
    with h5py.File(base / "new.mat", "w", userblock_size=512) as file:
        file["rec/cur"] = np.stack([log["i1"], log["i2"]])  # a 800 x 2 matrix, as MATLAB writes it
        file["rec/phi"] = log["phi"][None]
        file["w2"] = log["w2"][None]
        file["#refs#/junk"] = np.zeros(3)
    with (base / "new.mat").open("r+b") as raw:
        raw.write(b"MATLAB 7.3 MAT-file".ljust(512))
    channels = with_names({"i1": "rec.cur", "i2": "rec.cur", "phi": "rec.phi", "w2": "w2"})
    return study_of("new.mat", (replace(channels[0], column=2), replace(channels[1], column=1), *channels[2:]))


def test_contents_lists_every_signal_of_a_file(tmp_path: Path, log: Signals) -> None:
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
    (tmp_path / "cut.csv.gz").write_bytes(gzip.compress(b"a,b\n1,2\n" * 9)[:30])
    (tmp_path / "words.csv").write_text("no,numbers\nin,here\n")
    (tmp_path / "empty.csv").write_text("\n")
    for name, text, code, place in (
        ("bad.mat", TextFormatSpec(), "files/damaged", ""),
        ("bytes.h5", TextFormatSpec(), "files/damaged", "bytes.h5"),
        ("cut.csv.gz", TextFormatSpec(), "files/damaged", "cut.csv.gz"),
        ("words.csv", TextFormatSpec(), "records/text", "words.csv"),
        ("empty.csv", TextFormatSpec(), "records/text", "empty.csv"),
        ("words.csv", TextFormatSpec(",", ","), "study/recorded", "text"),
        ("words.csv", TextFormatSpec(",,"), "study/recorded", "text"),
    ):
        with refused(code, place=place):
            measured(tmp_path, study_of(name, text=text))


TEXT = TextFormatSpec()


def write_hdf5(base: Path, log: Signals) -> ExperimentSpec:
    table = np.zeros(len(log["i1"]), dtype=[("i1", "f8"), ("i2", "f8")])
    table["i1"], table["i2"] = log["i1"], log["i2"]
    with h5py.File(base / "log.h5", "w") as file:
        file["drive/currents"], file["drive/phi"], file["w2"] = table, log["phi"], log["w2"]
    return study_of(
        "log.h5", with_names({"i1": "drive/currents.i1", "i2": "drive/currents.i2", "phi": "/drive/phi", "w2": "w2"})
    )


def _write_csv_with_a_delimiter_at_every_end(base: Path, log: Signals) -> ExperimentSpec:
    save_csv(base / "log.csv", log)
    lines = (base / "log.csv").read_text().splitlines()
    (base / "log.csv").write_text("\r\n".join([lines[0], "", *(f"{line}," for line in lines[1:])]))
    return study_of("log.csv")


def _write_german_csv(base: Path, log: Signals) -> ExperimentSpec:
    save_csv(base / "log.txt", log, ";", comma=True, head="Messung 7\n3 Achsen\n")
    return study_of("log.txt", text=TextFormatSpec(";", ",", header_lines=3))


def _write_commented_table(base: Path, log: Signals) -> ExperimentSpec:
    np.savetxt(base / "log.dat", np.stack(list(log.values()), axis=1), fmt="%.17g", header="a b c d")
    columns = {"i1": 1, "i2": 2, "phi": 3, "w2": 4}
    channels = tuple(replace(c, channel="", column=columns[c.channel]) for c in CHANNELS)
    return study_of("log.dat", channels, text=TextFormatSpec("whitespace"))


def _write_tab_table_with_units(base: Path, log: Signals) -> ExperimentSpec:
    stamped = ["\t".join(["12:30:01", *(f"{v:.17g}" for v in row), "ok"]) for row in zip(*log.values(), strict=True)]
    (base / "log.tsv").write_text("\n".join(["time\ti1\ti2\tphi\tw2\tstate", "\tmA\tmA\tdeg\trad/s\t", *stamped]))
    return study_of("log.tsv", text=TextFormatSpec("tab"))


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
    instants = np.datetime64("2026-05-01T10:00:00", "ns") + np.arange(len(log["i1"])) * np.timedelta64(10_000_000, "ns")
    table = pa.table({"drive": drive, "phi": log["phi"], "w2": log["w2"], "at": instants})
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


def write_npz(base: Path, log: LogArrays) -> ExperimentSpec:
    currents = np.array([*zip(log["i1"], log["i2"], strict=True)], dtype=[("i1", "f8"), ("i2", "f8")])
    np.savez(base / "log.npz", rec=currents, phi=log["phi"], w2=log["w2"], who=np.array(["a", None], dtype=object))
    return study_of("log.npz", with_names({"i1": "rec.i1", "i2": "rec.i2", "phi": "phi", "w2": "w2"}))


def _write_gzip(base: Path, log: LogArrays) -> ExperimentSpec:
    save_csv(base / "log.csv", log)
    (base / "log.csv.gz").write_bytes(gzip.compress((base / "log.csv").read_bytes()))
    return study_of("log.csv.gz")


WRITERS = [
    write_npz,
    _write_gzip,
    write_matlab,
    write_matlab_73,
    write_hdf5,
    write_csv,
    _write_csv_with_a_delimiter_at_every_end,
    _write_german_csv,
    _write_commented_table,
    _write_tab_table_with_units,
    write_tdms,
    write_parquet,
]
BAGS = [write_bag_folder, write_mcap_file]


@pytest.mark.parametrize("write", [*WRITERS, *BAGS])
def test_formats_give_same_record_in_si_link_side(
    write: Callable[[Path, Signals], ExperimentSpec], tmp_path: Path, log: Signals
) -> None:
    """Current * constant * ratio, motor angle / ratio (which is negative), signs, scales, units, order of channels."""
    record = measured(tmp_path, write(tmp_path, log))
    assert record.inputs == ("motor 2", "motor 1")
    assert record.outputs == ("motor 1", "joint 2")
    assert record.quantities == ("position", "velocity")
    expected_u = np.stack([-log["i2"] * 1e-3 * 0.5, log["i1"] * 1e-3 * 0.5 * RATIO], axis=1)
    expected_y = np.stack([np.radians(log["phi"]) / RATIO, 0.1 * log["w2"]], axis=1)
    # Time stamps of bags in ns put samples at 1e-7 of their distance.
    tolerance = {"rtol": 1e-6, "atol": 1e-6} if write in BAGS else {"rtol": 1e-12, "atol": 1e-15}
    np.testing.assert_allclose(record.u, expected_u, **tolerance)
    np.testing.assert_allclose(record.y, expected_y, **tolerance)
    assert (record.rate_hz, record.period_samples, record.n_periods) == (RATE, N, P)
    assert record.has_rate
    assert said(record.notes) == ()


@pytest.mark.parametrize(
    ("write", "opened"),
    [
        (write_matlab, binary_formats.open_matlab),
        (write_npz, binary_formats.open_numpy),
        (write_tdms, binary_formats.open_tdms),
        (write_parquet, binary_formats.open_parquet),
        (write_bag_folder, ros_bag.open_ros_bag),
    ],
)
def test_file_reads_equal_here_and_in_reader_process(
    write: Callable[[Path, LogArrays], ExperimentSpec], opened: Any, tmp_path: Path, log: LogArrays
) -> None:
    """Names, shapes, units, rates and values, whole and in pieces."""
    path = tmp_path / write(tmp_path, log).as_recorded().files[0].path
    with opened(path, TEXT) as here, open_log(path, TEXT) as there:
        assert here.shapes() == there.shapes()
        for name, ours in here.arrays.items():
            theirs = there.arrays[name]
            assert (ours.dtype, ours.units, ours.rate_hz) == (theirs.dtype, theirs.units, theirs.rate_hz)
            np.testing.assert_array_equal(ours, theirs)
            np.testing.assert_array_equal(np.concatenate(list(ours.blocks())), theirs)
            if theirs.rows is not None:
                np.testing.assert_array_equal(theirs.rows(slice(300, 500)), np.asarray(ours)[300:500])


@pytest.mark.parametrize(
    ("start", "module", "extra"),
    [
        (b"TDSm", "nptdms", "tdms"),
        (b"PAR1", "pyarrow.parquet", "parquet"),
        (b"\x89MCAP0\r\n", "rosbags.highlevel", "ros"),
    ],
)
def test_missing_library_is_named_with_install_command(
    start: bytes, module: str, extra: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
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
    monkeypatch.setattr(entry_points, "group_entries", lambda group: (point,))


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
    with refused("install/entry-point", holds=("doubles", name)):
        contents(tmp_path / "log.csv", TEXT)


def test_dates_are_seconds_and_missing_values_are_missing(tmp_path: Path) -> None:
    """Time stamps of Parquet, its null, whole numbers and floats of 32 bits as they are, and lists of one length."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    at = np.datetime64("2026-05-01T10:00:00", "ns") + np.arange(4) * np.timedelta64(2_500_000, "ns")
    f, lists = np.arange(4, dtype=np.float32), pa.FixedSizeListArray.from_arrays(pa.array(np.arange(8.0)), 2)
    table = pa.table({"t": at, "x": pa.array([1, None, 3, 4]), "f": f, "who": ["a", "b", "c", "d"], "obs.q": lists})
    pq.write_table(table, tmp_path / "log.dat")
    assert contents(tmp_path / "log.dat", TEXT) == {"t": (4,), "x": (4,), "f": (4,), "obs.q": (4, 2)}
    column = read_channels(tmp_path / "log.dat", [ChannelSpec("u", "motor 1", "obs.q", 2)], TEXT)
    np.testing.assert_array_equal(column[:, 0], [1, 3, 5, 7])
    read = read_channels(tmp_path / "log.dat", [ChannelSpec("u", "motor 1", name) for name in ("t", "x", "f")], TEXT)
    np.testing.assert_array_equal(read, [[0, 1, 0], [0.0025, np.nan, 1], [0.005, 3, 2], [0.0075, 4, 3]])


@pytest.mark.parametrize(
    ("name", "column", "message"),
    [
        ("rec.psi", None, ("rec.psi", "rec.phi", "rec.cur (2 x 800)")),
        ("rec.cur", None, ("2 signals", "column: 1 to 2")),
        ("rec.cur", 3, "not 3"),
        ("rec.note", None, ("rec.note", "<U5")),
        ("fs", None, "fs"),
        ("cells{1}", None, ("800", "50 samples")),
        ("", None, ()),
    ],
)
def test_missing_matlab_channel_is_named_with_existing_ones(
    name: str, column: int | None, message: str, tmp_path: Path, log: Signals
) -> None:
    """Missing, a matrix without a column, a wrong column, a text, a scalar, another length, no name at all."""
    write_matlab(tmp_path, log)
    u = ChannelSpec("u", "motor 1", "run(1).w")
    y = ChannelSpec("y", "motor 1", name, column or (None if name else 1), "position")
    with refused("records/channels", holds=message):
        measured(tmp_path, study_of("log.mat", (u, y)))


def gathered(path: Path, names: tuple[str, str]) -> np.ndarray:
    """Torque and position of a file, each of its own clock, at 500 Hz."""
    u = ChannelSpec("u", "motor 1", names[0])
    y = ChannelSpec("y", "motor 1", names[1], quantity="position", unit="rad")
    recorded = RecordedSpec(500.0, (u, y), (FileSpec(path.name),))
    return gather_channels(recorded, recorded.files[0], path.parent, Structure.from_channels((u, y))).signals


@pytest.mark.parametrize("names", ["a/time a/u b/time b/y", "t_u u t_y y"])
def test_signals_of_several_lengths_have_the_time_beside_them(names: str, tmp_path: Path) -> None:
    """In the group of the signal, or of its length in the file; the position starts 20 samples later."""
    x, (t_u, u, t_y, y) = np.arange(220.0), names.split()
    with h5py.File(tmp_path / "log.h5", "w") as file:
        file[t_u], file[u] = x[:200] / 500, x[:200]
        file[t_y], file[y] = x[20:] / 500 if "/" in names else x[20:210] / 500, x[20 : 220 if "/" in names else 210]
    signals = gathered(tmp_path / "log.h5", (u, y))
    np.testing.assert_array_equal(signals, np.stack([x[20:200]] * 2, axis=1))


def test_a_system_without_memory_limits_is_stated_once(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    """At the first file that a guarded process reads."""
    monkeypatch.setattr(reader_process, "limits_memory", lambda: False)
    monkeypatch.setattr(reader_process, "_readers", {})
    for name in ("one.mat", "two.mat"):
        savemat(tmp_path / name, {"q": np.arange(10.0)})
        with open_log(tmp_path / name, TextFormatSpec()) as log:
            assert len(log.arrays) == 1
    assert [record.name for record in caplog.records] == [reader_process.__name__]
