"""The lines of a text file that is too large for memory, read where they are asked for."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import overload

import numpy as np

from elastid.base.arrays import IntArray

LARGE_BYTES = 1 << 26  # size above which a text is read in parts
_STEP = 1 << 12  # lines between two stored byte positions
_CHUNK = 1 << 24  # bytes that are read at a time in the search for line ends


@dataclass(frozen=True)
class FileLines(Sequence[str]):
    """Lines of a file in one of the codes whose line feed is one byte; plain: applied to the text of some lines.

    starts: byte at which every _STEP-th line begins, and the end of the file.
    """

    path: Path
    encoding: str
    starts: IntArray
    n: int
    plain: Callable[[str], str]

    @classmethod
    def of(cls, path: Path, encoding: str, plain: Callable[[str], str]) -> "FileLines":
        """Return the lines of a file as it is now."""
        stat = path.stat()
        starts, n = _starts(path, stat.st_size, stat.st_mtime_ns)
        return cls(path, encoding, starts, n, plain)

    def __len__(self) -> int:
        return self.n

    @overload
    def __getitem__(self, index: int) -> str: ...
    @overload
    def __getitem__(self, place: slice) -> list[str]: ...
    def __getitem__(self, place: int | slice) -> str | list[str]:
        """Return a line, or neighbouring lines; IndexError beyond the last one, ValueError for every second line."""
        if not isinstance(place, slice):
            index = range(self.n)[place]
            return self[index : index + 1][0]
        first, end, step = place.indices(self.n)
        if step != 1:
            raise ValueError("lines of a file are read in their order, one by one")
        if first >= end:
            return []
        block = first // _STEP
        start, stop = self.starts[[block, min(-(-end // _STEP), len(self.starts) - 1)]].tolist()
        with self.path.open("rb") as file:
            file.seek(start)
            content = file.read(stop - start).decode(self.encoding, errors="replace")
        return self.plain(content).replace("\r\n", "\n").split("\n")[first - block * _STEP : end - block * _STEP]


@lru_cache(maxsize=8)
def _starts(path: Path, size: int, changed_ns: int) -> tuple[IntArray, int]:
    """Find starts of every _STEP-th line, the end, and the number of lines; size and time of change are the key."""
    starts, n, offset = [np.zeros(1, np.int64)], 0, 0
    last = b"\n"
    with path.open("rb") as file:
        while chunk := file.read(_CHUNK):
            ends = np.flatnonzero(np.frombuffer(chunk, np.uint8) == ord("\n"))
            starts.append(offset + 1 + ends[(-n - 1) % _STEP :: _STEP])
            n, offset, last = n + len(ends), offset + len(chunk), chunk[-1:]
    all_starts = np.concatenate(starts)
    return np.append(all_starts[all_starts < size], size), n + (last != b"\n")
