"""The channels of a log that is too large for memory, some samples at a time: as in the file, and in SI."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from elastid.base.arrays import FloatArray
from elastid.experiment.specs.channels import ChannelSpec, Places
from elastid.experiment.specs.recorded import TextFormatSpec
from elastid.recorded.files.formats import opened_log
from elastid.recorded.files.log import ArrayLog, Log
from elastid.recorded.link_side import converted, largest_jump, to_joints


@dataclass(frozen=True)
class LargeLog:
    """Channels of a log in a format that can be read in pieces; start: sample of the file that counts as the first."""

    path: Path
    text: TextFormatSpec
    channels: tuple[ChannelSpec, ...]
    robot: Places
    start: int

    def opened(self) -> AbstractContextManager[Log]:
        """The file, for `columns`."""
        return opened_log(self.path, self.text)

    def columns(self, log: Log, first: int, last: int) -> list[FloatArray]:
        """The samples (last - first,) of each channel as they stand in the file."""
        assert isinstance(log, ArrayLog)  # the only one with rows
        columns = log.columns(self.channels, slice(self.start + first, self.start + last))
        return [np.ascontiguousarray(x) for x in columns]

    def rows(self, wanted: Sequence[int], dtype: np.dtype[Any], first: int, last: int) -> NDArray[Any]:
        """Samples (last - first, len(wanted)) of some channels in SI, angles and torques of joints where gears mix."""
        T = to_joints(self.channels, self.robot)[list(wanted)]
        used = np.flatnonzero(np.any(T != 0, axis=0)).tolist()
        channels = [self.channels[i] for i in used]
        with self.opened() as log:
            assert isinstance(log, ArrayLog)
            columns = log.columns(channels, slice(self.start + first, self.start + last))
        signals = [converted(channel, x, self.robot) for channel, x in zip(channels, columns, strict=True)]
        result = np.empty((last - first, len(wanted)), dtype)
        for row, column in zip(T[:, used], result.T, strict=True):
            terms = [factor * x if factor != 1 else x for factor, x in zip(row, signals, strict=True) if factor != 0]
            column[:] = sum(terms[1:], start=terms[0])
        return result

    def jumps(self) -> list[float]:
        """The largest change of each channel from one sample to the next, as in the file, that is no turn."""
        return [largest_jump(channel, self.robot) for channel in self.channels]

    def dtypes(self, roles: Sequence[Sequence[int]]) -> list[np.dtype[Any]]:
        """Single precision for channels that are no finer in the file, by role; else double."""
        T = to_joints(self.channels, self.robot)
        with self.opened() as log:
            assert isinstance(log, ArrayLog)
            # A sum is rounded by the larger of its parts.
            is_single = [
                np.can_cast(log.stored(channel).dtype, np.float32)
                and channel.offset == 0
                and np.count_nonzero(row) == 1
                for channel, row in zip(self.channels, T, strict=True)
            ]
        return [np.dtype(np.float32 if all(is_single[i] for i in role) else np.float64) for role in roles]
