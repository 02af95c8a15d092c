"""What HDF5 writes, by way of a Python file: a disk that fills up is an OSError, not the end of the process.

HDF5 cannot close a file that it cannot write: on a full disk it tries again when the process ends, and crashes it.  So
the first error of the disk is kept here, and HDF5 is told that all is well.
"""

from __future__ import annotations

import io
from pathlib import Path
from typing import Any


class DiskFile(io.RawIOBase):
    """A new binary file for HDF5 to write; nothing more is written after an error of the disk, which `close` raises."""

    def __init__(self, path: Path) -> None:
        self._file = path.open("w+b", buffering=0)
        self._error: OSError | None = None

    def write(self, data: Any) -> int:
        """All of it, or none after an error."""
        rest = memoryview(data).cast("B")
        total = len(rest)
        try:
            while self._error is None and len(rest):
                rest = rest[self._file.write(rest) :]
        except OSError as error:
            self._error = error
        return total

    def readinto(self, buffer: Any) -> int:
        """What was written there, zeros behind its end."""
        view = memoryview(buffer).cast("B")
        count = self._file.readinto(view) or 0
        view[count:] = bytes(len(view) - count)
        return len(view)

    def truncate(self, size: int | None = None) -> int:
        """Cut or extended."""
        try:
            return 0 if self._error is not None else self._file.truncate(size)
        except OSError as error:
            self._error = error
            return 0

    def seek(self, offset: int, whence: int = 0) -> int:
        """As that of a file."""
        return self._file.seek(offset, whence)

    def tell(self) -> int:
        """As that of a file."""
        return self._file.tell()

    def close(self) -> None:
        """Raises OSError where something could not be written."""
        error, self._error = self._error, None
        super().close()
        self._file.close()
        if error is not None:
            raise error
