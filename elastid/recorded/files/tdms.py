"""Logs of LabVIEW and DIAdem (TDMS), by npTDMS: channels are named `group/channel`."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from elastid.experiment.specs.recorded import TextFormatSpec
from elastid.recorded.files.log import ArrayLog, StoredArray, imported, seconds


def recognises(path: Path, head: bytes) -> bool:
    """True by the mark of the first segment."""
    return head.startswith(b"TDSm")


@contextmanager
def opened(path: Path, text: TextFormatSpec) -> Iterator[ArrayLog]:
    """All channels with data, read when they are used; time stamps in s from the first."""
    nptdms = imported("nptdms", path, "a TDMS file", "tdms")
    with nptdms.TdmsFile.open(path) as file:
        channels = [channel for group in file.groups() for channel in group.channels()]
        yield ArrayLog(path, {f"{c.group_name}/{c.name}": _stored(c) for c in channels if len(c) > 0})


def _stored(channel: Any) -> StoredArray:
    step = channel.properties.get("wf_increment", 0.0)
    is_time = channel.dtype.kind == "M"
    dtype = np.dtype(np.float64) if is_time else channel.dtype
    units = "s" if is_time else str(channel.properties.get("unit_string", ""))
    read = partial(_read, channel)
    return StoredArray((len(channel),), dtype, read, units, 1 / step if step > 0 else None, rows=read)


def _read(channel: Any, part: slice = slice(None)) -> NDArray[Any]:
    values = np.asarray(channel[part])
    return seconds(values, channel[0]) if values.dtype.kind == "M" else values
