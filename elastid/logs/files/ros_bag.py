"""ROS bags by rosbags: a ROS 2 folder with metadata.yaml, an MCAP or db3 file, or a ROS 1 .bag file.

Signals are named by topic and field, `imu.angular_velocity.x`. In a `sensor_msgs/JointState` the joint is part of the
name, `joint_states.position.elbow`; messages may list the joints in any order.  Sequences of numbers are matrices, and
a channel states the column.  Each topic has its own time, `joint_states.time`, in s from the first message of the bag:
the stamp of its messages, or the time at which the bag received messages without a stamp.
"""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import fields, is_dataclass
from functools import cached_property, partial
from itertools import islice
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from elastid.base.errors import require_package
from elastid.experiment.specs.logs import TextFormatSpec
from elastid.logs.files.log import ArrayLog, StoredArray

# Per column: indices of its messages, and values.
_Columns: TypeAlias = dict[str, tuple[list[int], list[NDArray[Any]]]]
_JOINT_FIELDS = {"position": "rad", "velocity": "rad/s", "effort": "N*m"}


@contextmanager
def open_ros_bag(path: Path, text: TextFormatSpec) -> Iterator[ArrayLog]:
    """Open all numeric topics; the messages of a topic are read once, when its first signal is used."""
    reader = require_package("rosbags.highlevel", "ros", path)
    types = require_package("rosbags.typesys", "ros", path)
    # Bags of older releases do not hold the definitions of their messages.
    typestore = types.get_typestore(types.Stores.ROS2_HUMBLE)
    with reader.AnyReader([path], default_typestore=typestore) as bag:
        topics = [_Topic(bag, name, each.connections, each.msgtype or "") for name, each in bag.topics.items()]
        begin_ns = min((topic.begin_ns for topic in topics if topic.first), default=0)
        yield ArrayLog(path, dict(signal for topic in topics for signal in topic.arrays(begin_ns)))


class _Topic:
    def __init__(self, bag: Any, name: str, connections: list[Any], kind: str) -> None:
        self.bag, self.name, self.connections = bag, name.strip("/"), connections
        self.is_joint_state = kind == "sensor_msgs/msg/JointState"
        self.is_known = kind in bag.typestore.fielddefs

    @cached_property
    def first(self) -> list[tuple[int, Any]]:
        """Stamps in ns and first three messages; empty if the topic has no messages or an unknown type."""
        return [*islice(self._messages(), 3)] if self.is_known else []

    @property
    def begin_ns(self) -> int:
        """First stamp, of those that are no more than a second off the median one."""
        stamps = sorted(stamp for stamp, _ in self.first)
        return next(stamp for stamp in stamps if stamp > stamps[len(stamps) // 2] - 10**9)

    def arrays(self, begin_ns: int) -> Iterator[tuple[str, StoredArray]]:
        """Yield name and array of each signal; times are from begin_ns on."""
        if self.is_joint_state:
            yield from self._joint_arrays(begin_ns)
        if self.is_joint_state or not self.first:
            return
        columns, time = _numbers(self.first[0][1]), f"{self.name}.time"
        n = sum(connection.msgcount for connection in self.connections)
        if columns:
            yield time, _stored_array((n,), partial(self._times, begin_ns), "s")
        for field, values in columns.items():
            yield f"{self.name}.{field}", _stored_array((n, *values.shape), partial(self._column, field), "", time)

    def _joint_arrays(self, begin_ns: int) -> Iterator[tuple[str, StoredArray]]:
        times, columns = self._times(begin_ns), self._columns[1]
        is_common, time = all(len(numbers) == len(times) for numbers, _ in columns.values()), f"{self.name}.time"
        if is_common:
            yield time, _stored_array((len(times),), lambda: times, "s")
        for column, (numbers, values) in columns.items():
            field, _, joint = column.partition(".")
            if not is_common:
                time = f"{self.name}.time.{joint}"
                yield time, _stored_array((len(numbers),), partial(times.__getitem__, numbers), "s")
            unit = _JOINT_FIELDS[field]
            yield f"{self.name}.{column}", _stored_array((len(values),), partial(np.array, values), unit, time)

    @cached_property
    def _columns(self) -> tuple[list[int], _Columns]:
        """Stamps (n,) in ns, and for each column the messages that hold it, and its values."""
        stamps = []
        columns: _Columns = {}
        for number, (stamp, message) in enumerate(self._messages()):
            stamps.append(stamp)
            for column, value in (_of_joints if self.is_joint_state else _numbers)(message).items():
                numbers, values = columns.setdefault(column, ([], []))
                numbers.append(number)
                values.append(value)
        return stamps, columns

    def _times(self, begin_ns: int) -> NDArray[np.float64]:
        # Differences come first, since ns since 1970 exceed float64.
        return np.array([stamp - begin_ns for stamp in self._columns[0]]) * 1e-9

    def _column(self, field: str) -> NDArray[Any]:
        """Return values (n,) or (n, columns); ValueError if a sequence changes its length."""
        stamps, columns = self._columns
        values = columns[field][1]
        if len(values) < len(stamps) or len({value.shape for value in values}) > 1:
            raise ValueError(f"{self.name}.{field} varies in length between messages")
        return np.stack(values)

    def _messages(self) -> Iterator[tuple[int, Any]]:
        for connection, time_ns, raw in self.bag.messages(self.connections):
            message = self.bag.deserialize(raw, connection.msgtype)
            stamp = getattr(getattr(message, "header", None), "stamp", None)
            yield (0 if stamp is None else stamp.sec * 10**9 + stamp.nanosec) or time_ns, message


def _of_joints(message: Any) -> dict[str, NDArray[Any]]:
    """Return numbers of a JointState, in which fields without a sensor are empty."""
    pairs = (
        (field, *pair) for field in _JOINT_FIELDS for pair in zip(message.name, getattr(message, field), strict=False)
    )
    return {f"{field}.{joint}": np.asarray(value, np.float64) for field, joint, value in pairs}


def _numbers(message: Any, prefix: str = "") -> dict[str, NDArray[Any]]:
    """Find numbers and sequences of up to 64 (longer: images and maps) by the path of their field; no stamps."""
    columns: dict[str, NDArray[Any]] = {}
    for field in fields(message):
        value, name = getattr(message, field.name), f"{prefix}{field.name}"
        if field.name.startswith("__") or field.name == "header":
            continue
        if is_dataclass(value):
            columns |= _numbers(value, f"{name}.")
        elif isinstance(value, bool | int | float):
            columns[name] = np.asarray(value, np.float64)
        elif isinstance(value, np.ndarray) and value.dtype.kind in "fiub" and 0 < value.size <= 64:
            columns[name] = np.array(value, np.float64)
    return columns


def _stored_array(
    shape: tuple[int, ...], read: Callable[[], NDArray[Any]], units: str = "", time: str = ""
) -> StoredArray:
    return StoredArray(shape, np.dtype(np.float64), read, units, time=time)
