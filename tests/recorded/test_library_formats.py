"""Formats that a library of their own reads: ROS bags, TDMS, Parquet, and readers of other packages.

Every file is written by the format's own library.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from importlib.metadata import EntryPoint
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from plants.lab_logs import RATE, measured, study_of, with_names, write_csv

from elastid.app.provenance import file_hash
from elastid.base.errors import DataError, StudyError
from elastid.experiment.specs.channels import ChannelSpec
from elastid.experiment.specs.experiment import ExperimentSpec
from elastid.experiment.specs.recorded import TextFormatSpec
from elastid.recorded.files import formats
from elastid.recorded.files.formats import Format, contents, read_channels
from elastid.recorded.files.log import ArrayLog, StoredArray

TEXT = TextFormatSpec()
LogArrays = dict[str, np.ndarray]
# The joint of each of the log's signals, in the messages of JointState: effort in Nm, position in rad.
JOINTS = ("shoulder", "elbow")


def _read(path: Path, *names: str, column: int | None = None) -> np.ndarray:
    return read_channels(path, [ChannelSpec("u", "motor 1", name, column) for name in names], TEXT)


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


def write_bag(path: Path, log: LogArrays, storage: str = "SQLITE3", publishers: int = 1) -> Path:
    """Currents as efforts and both motions as positions of two joints; an even message lists the joints the other way
    round.  publishers: nodes that publish, each its own joints, under the one topic.
    """
    from rosbags.rosbag2 import StoragePlugin, Writer
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS2_HUMBLE)
    types = store.types
    Stamp, Header = types["builtin_interfaces/msg/Time"], types["std_msgs/msg/Header"]
    State, Numbers = types["sensor_msgs/msg/JointState"], types["std_msgs/msg/Float64MultiArray"]
    Layout, Word = types["std_msgs/msg/MultiArrayLayout"], types["std_msgs/msg/String"]
    Wrench, Force, Vector = (types[f"geometry_msgs/msg/{n}"] for n in ("WrenchStamped", "Wrench", "Vector3"))
    with Writer(path, version=9, storage_plugin=StoragePlugin[storage]) as writer:

        def topic(name: str, kind: type[Any]) -> Callable[[int, Any], None]:
            connection = writer.add_connection(name, kind.__msgtype__, typestore=store)
            return lambda at, message: writer.write(
                connection,
                at,
                store.serialize_cdr(message, kind.__msgtype__),  # type: ignore[arg-type]
            )

        states, commands, words = topic("/joint_states", State), topic("/arm/commands", Numbers), topic("/note", Word)
        forces = topic("/wrench", Wrench)
        for k in range(len(log["i1"])):
            ns = 1_700_000_000_000_000_000 + round(k * 1e9 / RATE)
            header = Header(Stamp(ns // 10**9, ns % 10**9), "")
            positions = {"shoulder": log["phi"][k], "elbow": log["w2"][k]}
            efforts = {"shoulder": log["i1"][k], "elbow": log["i2"][k]}
            joints = JOINTS if k % 2 else JOINTS[::-1]
            for names in [joints] if publishers == 1 else [(joint,) for joint in JOINTS]:
                arrays = (np.array([each[joint] for joint in names]) for each in (positions, efforts))
                position, effort = arrays
                # The bag receives each message late and unevenly.
                late = ns + 10**6 * (1 + k % 3)
                states(late, State(header, list(names), position, np.zeros(0), effort))
            commands(ns, Numbers(Layout([], 0), np.array([log["i1"][k], log["i2"][k]])))
            words(ns, Word("going on"))
            forces(ns, Wrench(header, Force(Vector(k, 0.0, -k), Vector(0.0, 0.5, 0.0))))
    return path


BAG_NAMES = {
    "i1": "joint_states.effort.shoulder",
    "i2": "joint_states.effort.elbow",
    "phi": "joint_states.position.shoulder",
    "w2": "joint_states.position.elbow",
}


def write_bag_folder(base: Path, log: LogArrays) -> ExperimentSpec:
    write_bag(base / "bag", log)
    return study_of("bag", with_names(BAG_NAMES), time="joint_states.time")


def write_mcap_folder(base: Path, log: LogArrays) -> ExperimentSpec:
    write_bag(base / "bag", log, "MCAP")
    return study_of("bag", with_names(BAG_NAMES), time="joint_states.time")


def write_mcap_file(base: Path, log: LogArrays) -> ExperimentSpec:
    (file,) = write_bag(base / "bag", log, "MCAP").glob("*.mcap")
    return study_of(str(file.relative_to(base)), with_names(BAG_NAMES), time="joint_states.time")


@pytest.mark.parametrize("write", [write_tdms, write_parquet, write_bag_folder, write_mcap_folder, write_mcap_file])
def test_a_log_is_the_same_record_in_every_format(
    write: Callable[[Path, LogArrays], ExperimentSpec], tmp_path: Path, log: LogArrays
) -> None:
    """As from the CSV file: the numbers are read, not interpreted."""
    expected, found = (measured(tmp_path, each(tmp_path, log)) for each in (write_csv, write))
    # Time stamps in ns put samples at 1e-7 of their distance.
    tolerance = {"rtol": 1e-6, "atol": 1e-6}
    np.testing.assert_allclose(found.u, expected.u, **tolerance)
    np.testing.assert_allclose(found.y, expected.y, **tolerance)


def test_a_bag_lists_joints_fields_and_sequences_by_topic(tmp_path: Path, log: LogArrays) -> None:
    """Joints by name, numbers by the path of their field, sequences as columns; texts are left out."""
    bag, n = write_bag(tmp_path / "bag", log), len(log["i1"])
    expected = {f"joint_states.{field}.{joint}": (n,) for field in ("position", "effort") for joint in JOINTS}
    expected |= {"joint_states.time": (n,), "arm/commands.time": (n,), "arm/commands.data": (n, 2)}
    expected |= {"arm/commands.layout.data_offset": (n,), "wrench.time": (n,)}
    expected |= {f"wrench.wrench.{part}.{axis}": (n,) for part in ("force", "torque") for axis in "xyz"}
    assert contents(bag, TEXT) == expected
    np.testing.assert_array_equal(_read(bag, "/arm/commands.data", column=2)[:, 0], log["i2"])
    np.testing.assert_array_equal(_read(bag, "wrench.wrench.force.z")[:, 0], -np.arange(n))


def test_the_time_of_a_topic_is_the_stamp_of_its_messages(tmp_path: Path, log: LogArrays) -> None:
    """Exact to the ns although the stamps count from 1970, and not when the bag received them; else that."""
    bag = write_bag(tmp_path / "bag", log)
    at = np.arange(len(log["i1"])) / RATE
    np.testing.assert_allclose(_read(bag, "joint_states.time")[:, 0], at, atol=2e-9)
    np.testing.assert_allclose(_read(bag, "arm/commands.time")[:, 0], at, atol=2e-9)


def test_joints_that_several_nodes_publish_under_one_topic_have_their_own_time(tmp_path: Path, log: LogArrays) -> None:
    """Each message holds one joint only."""
    bag = write_bag(tmp_path / "bag", log, publishers=2)
    found = contents(bag, TEXT)
    assert "joint_states.time" not in found
    assert found["joint_states.time.elbow"] == found["joint_states.effort.elbow"] == (len(log["i2"]),)
    np.testing.assert_array_equal(_read(bag, "joint_states.effort.elbow")[:, 0], log["i2"])


def test_a_folder_that_is_no_bag_and_a_damaged_bag_are_refused(tmp_path: Path, log: LogArrays) -> None:
    """With what is missing."""
    (tmp_path / "logs").mkdir()
    with pytest.raises(StudyError, match=r"logs is a folder but no ROS 2 bag \(it has no metadata.yaml\)"):
        contents(tmp_path / "logs", TEXT)
    bag = write_bag(tmp_path / "bag", log)
    next(bag.glob("*.db3")).unlink()
    with pytest.raises(DataError, match=r"no ROS bag file .*missing.*; copy it again with all files of its folder"):
        contents(bag, TEXT)


def test_a_bag_of_other_content_is_another_input(tmp_path: Path, log: LogArrays) -> None:
    """The hash of a folder is that of its files."""
    bag = write_bag(tmp_path / "bag", log)
    before = file_hash(bag)
    assert before == file_hash(bag)
    with (bag / "metadata.yaml").open("a") as file:
        file.write("\n")
    assert file_hash(bag) != before


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


def test_a_negative_increment_of_tdms_is_no_rate(tmp_path: Path) -> None:
    """`inspect` showed a signal at -1 Hz."""
    from nptdms import ChannelObject, TdmsWriter

    with TdmsWriter(tmp_path / "log.tdms") as file:
        file.write_segment([ChannelObject("g", "torque", np.arange(9.0), {"wf_increment": -1.0})])
    with formats.opened_log(tmp_path / "log.tdms", TEXT) as log:
        assert isinstance(log, ArrayLog)
        assert log.arrays["g/torque"].rate_hz is None


def test_times_of_tdms_are_seconds(tmp_path: Path) -> None:
    """From the first."""
    from nptdms import ChannelObject, TdmsWriter

    at = np.datetime64("2026-05-01T10:00:00", "us") + np.arange(3) * np.timedelta64(4000, "us")
    with TdmsWriter(tmp_path / "log.tdms") as writer:
        writer.write_segment([ChannelObject("a", "t", at), ChannelObject("a", "x", np.array([1, 2, 3]))])
    np.testing.assert_allclose(_read(tmp_path / "log.tdms", "a/t", "a/x"), [[0, 1], [0.004, 2], [0.008, 3]])


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
    with pytest.raises(StudyError, match=rf"is not installed; install it with `uv sync --extra {extra}`"):
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
    monkeypatch.setattr(formats, "entry_points", lambda group: (point,) if group == point.group else ())


def test_another_package_adds_a_format_by_an_entry_point(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Its file is read; files of other formats are read as before."""
    _register(monkeypatch, "DOUBLES")
    (tmp_path / "log.raw").write_bytes(b"RAW!" + np.arange(5.0).tobytes())
    assert contents(tmp_path / "log.raw", TEXT) == {"x": (5,)}
    (tmp_path / "log.csv").write_text("a,b\n1,2\n3,4\n")
    assert contents(tmp_path / "log.csv", TEXT) == {"a": (2,), "b": (2,)}


@pytest.mark.parametrize(
    ("name", "message"),
    [("ABSENT", "cannot be loaded .*; update that package, or uninstall it"), ("NO_FORMAT", "is int and not an")],
)
def test_an_entry_point_that_holds_no_format_is_named(
    name: str, message: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """What cannot be imported, and what is something else."""
    _register(monkeypatch, name)
    (tmp_path / "log.csv").write_text("a,b\n1,2\n3,4\n")
    with pytest.raises(StudyError, match=f"the reader doubles .*{message}"):
        contents(tmp_path / "log.csv", TEXT)
