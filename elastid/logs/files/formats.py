"""Formats of log files: one row for each reader, chosen by the first bytes; errors name the file.

To add a format, write a function that opens a file, and add one row. Another package provides a `Format` under
the entry point group `elastid.readers`.
"""

import os
from collections.abc import Callable, Iterator, Sequence
from contextlib import AbstractContextManager, ExitStack, contextmanager
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from elastid.base.arrays import FloatArray
from elastid.base.entry_points import registry
from elastid.base.errors import DataError, ElastidError, StudyError, is_program_fault
from elastid.experiment.specs.channels import ChannelSpec
from elastid.experiment.specs.logs import TextFormatSpec
from elastid.logs.files import binary_formats, ros_bag, text, universal
from elastid.logs.files.log import ArrayLog, Log
from elastid.logs.files.reader_process import guard_reads
from elastid.logs.files.text import TextLog


@dataclass(frozen=True)
class Format:
    """A format of log files.

    recognises: true if a file (its path and first bytes) has the format.  opened: the file as a log; it may raise any
    exception.  advice: next step where it does.
    """

    name: str
    recognises: Callable[[Path, bytes], bool]
    opened: Callable[[Path, TextFormatSpec], AbstractContextManager[Log]]
    advice: str


def starts_with(mark: bytes) -> Callable[[Path, bytes], bool]:
    """Return a test for files that begin with a mark."""
    return lambda path, head: head.startswith(mark)


def is_ros_bag(path: Path, head: bytes) -> bool:
    """Recognise a folder by its metadata, an MCAP file, a ROS 1 bag, and the database of a ROS 2 bag."""
    signatures = (b"\x89MCAP0\r\n", b"#ROSBAG V", b"SQLite format 3\x00")
    return os.path.isfile(path / "metadata.yaml") or head.startswith(signatures)


def is_hdf5(path: Path, head: bytes) -> bool:
    """Recognise the signature, at the start or behind a user block, the size of which is a power of two."""
    return any(head.startswith(b"\x89HDF\r\n\x1a\n", offset) for offset in (0, 512, 1024, 2048, 4096))


def is_matlab(path: Path, head: bytes) -> bool:
    """Recognise the header, or the suffix of files of version 4, which have no header."""
    # Version and byte order stand behind the free text of a header, little or big endian.
    signatures = (b"\x00\x01IM", b"\x01\x00MI")
    return head.startswith(b"MATLAB") or head[124:128] in signatures or path.suffix.lower() == ".mat"


def is_numpy(path: Path, head: bytes) -> bool:
    """Recognise the signature of an array, and of an archive the suffix, too."""
    return head.startswith(b"\x93NUMPY") or (head.startswith(b"PK") and path.suffix.lower() == ".npz")


# The first format that recognises a file reads it. MATLAB 7.3 is HDF5 with a header; text is any other file.
FORMATS = (
    Format("ROS bag", is_ros_bag, guard_reads(ros_bag.open_ros_bag), "copy it again with all files of its folder"),
    Format("NumPy", is_numpy, guard_reads(binary_formats.open_numpy), "copy it or save it again"),
    Format("TDMS", starts_with(b"TDSm"), guard_reads(binary_formats.open_tdms), "copy it or export it again"),
    Format("Parquet", starts_with(b"PAR1"), guard_reads(binary_formats.open_parquet), "copy it or export it again"),
    Format(
        "MATLAB 7.3",
        lambda path, head: head.startswith(b"MATLAB") and is_hdf5(path, head),
        partial(binary_formats.open_hdf5, is_matlab=True),
        "copy it or save it again",
    ),
    Format("HDF5", is_hdf5, binary_formats.open_hdf5, "copy it or export it again"),
    Format("MATLAB", is_matlab, guard_reads(binary_formats.open_matlab), "copy it or save it again with -v7"),
    Format("universal", universal.is_universal_file, guard_reads(universal.open_uff), "copy it or export it again"),
    Format("text", lambda path, head: True, text.open_text, "copy it or export it again"),
)


def is_log(path: Path) -> bool:
    """Return True if a path is a log: a file, or a folder that a format recognises, such as a ROS bag."""
    *formats, _ = all_formats()  # text, the last, takes everything
    return os.path.isfile(path) or (os.path.isdir(path) and any(row.recognises(path, b"") for row in formats))


def is_text(path: Path) -> bool:
    """Return True if a log is read as a text."""
    return _format_of(path) == FORMATS[-1]


def all_formats() -> tuple[Format, ...]:
    """Return formats, specialised packages first; raise StudyError for a format that cannot be imported."""
    return (*registry("elastid.readers", Format), *FORMATS)


def contents(path: Path, text: TextFormatSpec) -> dict[str, tuple[int, ...]]:
    """Return numeric signals of a log file, name to shape; numbers of columns for a text without headings."""
    with open_log(path, text) as log:
        return log.shapes()


def size_in_pieces(
    path: Path, channels: Sequence[ChannelSpec], text: TextFormatSpec
) -> tuple[int, np.dtype[np.floating[Any]]]:
    """Return the number of samples of channels in a file, 0 if it has no pieces, and their precision."""
    with open_log(path, text) as log:
        if isinstance(log, TextLog) and log.is_large:
            return len(log.number_lines) - log.first, np.dtype(np.float64)
        arrays = [log.array_of(channel)[1] for channel in channels] if isinstance(log, ArrayLog) else []
    n = min((array.shape[0] if array.has_pieces else 0 for array in arrays), default=0)
    return n, np.dtype(np.float32 if all(np.can_cast(array.dtype, np.float32) for array in arrays) else np.float64)


def read_channels(
    path: Path, channels: Sequence[ChannelSpec], text: TextFormatSpec, span: slice = slice(None)
) -> FloatArray:
    """Read raw values (n_samples, len(channels)) of the requested channels.

    span: of the samples; no more than that is read where the format allows it.
    Raises StudyError for a file that is not there, DataError for a damaged file or a channel that cannot be read.
    """
    with open_log(path, text) as log:
        return log.values(channels, span)


def time_channels(path: Path, channels: Sequence[ChannelSpec], text: TextFormatSpec) -> list[str]:
    """Return the name of the time channel of each channel, empty if a format states none."""
    with open_log(path, text) as log:
        return [log.time_of(channel) for channel in channels]


@contextmanager
def open_log(path: Path, text: TextFormatSpec) -> Iterator[Log]:
    """Open a log file, whatever its format; arrays are read while it is open."""
    if not is_log(path):
        problem = "is a folder but not a ROS 2 bag (it has no metadata.yaml)" if os.path.isdir(path) else "is not there"
        advice = "Check path under files (relative to the study's folder)"
        raise StudyError("files/missing", f"log file {path} {problem}. {advice}")
    log_format = _format_of(path)
    damage = f"damaged, truncated or not a {log_format.name} file"
    guard = partial(_refuse_errors, lambda error: f"{path}: {damage} ({error}); {log_format.advice}")
    with ExitStack() as stack:
        with guard():
            log = stack.enter_context(log_format.opened(path, text))
        log = log.by_times() if isinstance(log, TextLog) else log
        yield log.with_times().guarded(guard) if isinstance(log, ArrayLog) else log


def _format_of(path: Path) -> Format:
    head = b""
    if os.path.isfile(path):
        with path.open("rb") as file:
            head = file.read(4104)  # HDF5 after a user block of 4096 bytes is recognised
    return next(row for row in all_formats() if row.recognises(path, head))


@contextmanager
def _refuse_errors(message: Callable[[Exception], str]) -> Iterator[None]:
    """Convert exceptions of libraries and of the data, such as from damaged files, to DataError."""
    try:
        yield
    except (ElastidError, MemoryError):
        raise
    except Exception as error:
        if is_program_fault(error):
            raise
        raise DataError("files/damaged", message(error)) from error


def naming_file(path: Path, advice: str) -> AbstractContextManager[None]:
    """Raise DataError with the file and the next step instead of any exception that is no message for the user yet."""
    return _refuse_errors(lambda e: f"{path}: {advice} ({type(e).__name__}{f': {e}' if str(e) else ''})")
