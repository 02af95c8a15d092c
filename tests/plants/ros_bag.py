"""ROS 2 bags: a log of two joints, and topics of one joint."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from plants.lab_logs import RATE, Signals

LogArrays = Signals


# The joint of each of the log's signals, in the messages of JointState: effort in Nm, position in rad.
JOINTS = ("shoulder", "elbow")


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
            return lambda at, message: writer.write(connection, at, store.serialize_cdr(message, kind.__msgtype__))

        states, commands, words = topic("/joint_states", State), topic("/arm/commands", Numbers), topic("/note", Word)
        forces, _ = topic("/wrench", Wrench), topic("/unused", Numbers)  # the last topic has no messages
        for k in range(len(log["i1"])):
            ns = 1_700_000_000_000_000_000 + round(k * 1e9 / RATE)
            header = Header(Stamp(ns // 10**9, ns % 10**9), "")
            positions = {"shoulder": log["phi"][k], "elbow": log["w2"][k]}
            efforts = {"shoulder": log["i1"][k], "elbow": log["i2"][k]}
            joints = JOINTS if k % 2 else JOINTS[::-1]
            for names in [joints] if publishers == 1 else [(joint,) for joint in JOINTS]:
                position, effort = (np.array([each[joint] for joint in names]) for each in (positions, efforts))
                # The bag receives each message late and unevenly.
                states(ns + 10**6 * (1 + k % 3), State(header, list(names), position, np.zeros(0), effort))
            commands(ns, Numbers(Layout([], 0), np.array([log["i1"][k], log["i2"][k]])))
            words(ns, Word("going on"))
            forces(ns, Wrench(header, Force(Vector(k, 0.0, -k), Vector(0.0, 0.5, 0.0))))
    return path


def write_topics(path: Path, topics: dict[str, tuple[np.ndarray, Signals]]) -> Path:
    """Topics with stamps in s and fields (position, effort) of the joint `axis`."""
    from rosbags.rosbag2 import Writer
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS2_HUMBLE)
    kinds = ("builtin_interfaces/msg/Time", "std_msgs/msg/Header", "sensor_msgs/msg/JointState")
    Stamp, Header, State = (store.types[kind] for kind in kinds)
    with Writer(path, version=9) as writer:
        for name, (t, fields) in topics.items():
            connection = writer.add_connection(name, State.__msgtype__, typestore=store)
            for k, ns in enumerate((1_700_000_000_000_000_000 + np.round(t * 1e9).astype(np.int64)).tolist()):
                position, effort = (fields.get(key, np.zeros(0))[k : k + 1] for key in ("position", "effort"))
                message = State(Header(Stamp(ns // 10**9, ns % 10**9), ""), ["axis"], position, np.zeros(0), effort)
                # Received in the order of the rows, independent of the stamps.
                writer.write(connection, k, store.serialize_cdr(message, State.__msgtype__))
    return path
