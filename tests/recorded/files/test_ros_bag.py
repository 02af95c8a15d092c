"""ROS bags."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from plants.lab_logs import RATE

from elastid.app.work import file_hash
from elastid.base.errors import DataError, StudyError
from elastid.experiment.specs.channels import ChannelSpec
from elastid.experiment.specs.recorded import TextFormatSpec
from elastid.recorded.files.formats import contents, read_channels

TEXT = TextFormatSpec()


LogArrays = dict[str, np.ndarray]


# The joint of each of the log's signals, in the messages of JointState: effort in Nm, position in rad.
JOINTS = ("shoulder", "elbow")


def _read(path: Path, *names: str, column: int | None = None) -> np.ndarray:
    return read_channels(path, [ChannelSpec("u", "motor 1", name, column) for name in names], TEXT)


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
