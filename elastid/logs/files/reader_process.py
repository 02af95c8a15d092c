"""The guarded process that reads files of foreign formats: MATLAB up to version 7, ROS, TDMS and Parquet.

Their libraries trust the lengths in a file: a damaged file can request any amount of memory, or crash the process. They
therefore run in a separate process with a memory limit, which starts with the first file and ends with the program.
"""

import atexit
import logging
import os
import pickle
import signal
import subprocess
import sys
import warnings
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, ExitStack, contextmanager, suppress
from dataclasses import dataclass
from functools import partial
from importlib import import_module
from pathlib import Path
from threading import RLock
from traceback import format_exc
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from elastid.base.errors import ElastidError, ProgramError, is_program_fault
from elastid.experiment.specs.logs import TextFormatSpec
from elastid.logs.files.log import ArrayLog, StoredArray

# The reader of each process (workers begin as copies of another) and path of imports.
_readers: dict[tuple[int, str], subprocess.Popen[bytes]] = {}
_request_lock = RLock()
_log = logging.getLogger(__name__)


# Opens a file as a log.
Opener: TypeAlias = Callable[[Path, TextFormatSpec], AbstractContextManager[ArrayLog]]


@dataclass(frozen=True)
class _File:
    """A file by its path from a folder, the function that opens it, by module and name, and its version."""

    module: str
    name: str
    folder: str
    path: Path
    version: tuple[tuple[str, int, int, int], ...]

    def open_arrays(self) -> AbstractContextManager[ArrayLog]:
        """Return the log, in the process that reads."""
        os.chdir(self.folder)
        opener: Opener = getattr(import_module(self.module), self.name)
        return opener(self.path, TextFormatSpec())


def guard_reads(reader: Opener) -> Opener:
    """Return the function that opens a file, carried out in the guarded process."""

    @contextmanager
    def opened(path: Path, text: TextFormatSpec) -> Iterator[ArrayLog]:
        members = sorted(path.iterdir()) if path.is_dir() else [path]
        stats = [(member.name, member.stat()) for member in members]
        version = tuple((name, s.st_ino, s.st_size, s.st_mtime_ns) for name, s in stats)
        file, arrays = _File(reader.__module__, reader.__name__, os.getcwd(), path, version), {}
        for name, (shape, dtype, units, rate_hz, has_rows, time) in _request(file).items():
            values = partial(_request, file, name)
            arrays[name] = StoredArray(shape, dtype, values, units, rate_hz, values if has_rows else None, time)
        yield ArrayLog(path, arrays)

    return opened


def _request(file: _File, name: str = "", span: slice | None = None) -> Any:
    """Ask for the signals of a file, or for values of one; raise the reader's error, ValueError if it died."""
    search_path = os.pathsep.join(folder or os.getcwd() for folder in sys.path)
    with _request_lock:
        try:
            reply = _exchange(_reader(search_path), (file, name, span))
        except BaseException as error:  # after Ctrl-C, say, the lost reply would be taken for that to the next request
            code = _stop(_readers.pop((os.getpid(), search_path)))
            if isinstance(error, EOFError):
                raise ValueError(f"the reading process ended with exit code {code}") from None
            raise
    if isinstance(reply, Exception):
        raise reply
    return reply


def _exchange(reader: subprocess.Popen[bytes], request: tuple[_File, str, slice | None]) -> Any:
    """Return the reply; EOFError of a reader that died."""
    assert reader.stdin is not None
    assert reader.stdout is not None
    with suppress(BrokenPipeError):
        pickle.dump(request, reader.stdin)
        reader.stdin.flush()
    try:
        return pickle.load(reader.stdout)
    except pickle.UnpicklingError as error:  # amid a reply
        raise EOFError from error


def _reader(search_path: str) -> subprocess.Popen[bytes]:
    key = os.getpid(), search_path
    if key not in _readers:
        # -P: nothing is imported from the folder that the user happens to be in.
        command = [sys.executable, "-P", "-c", f"from {__name__} import serve; serve()"]
        pipe, env = subprocess.PIPE, os.environ | {"PYTHONPATH": search_path}
        if not _readers and not limits_memory():
            _log.warning("this system does not limit the memory of a process: read only files that you trust")
        # Words of the libraries go nowhere.
        _readers[key] = subprocess.Popen(command, stdin=pipe, stdout=pipe, stderr=subprocess.DEVNULL, env=env)
        atexit.register(_stop, _readers[key])
    return _readers[key]


def _stop(reader: subprocess.Popen[bytes]) -> int:
    assert reader.stdin is not None
    assert reader.stdout is not None
    with suppress(OSError):
        reader.stdin.close()
    reader.stdout.close()
    try:  # one that died has its own exit code
        reader.wait(timeout=1.0)
    except subprocess.TimeoutExpired:
        reader.kill()
    return reader.wait()


def serve() -> None:
    """Serve requests in the process that reads, until the program ends."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is the program's, which ends this process
    limit = limit_memory()
    warnings.simplefilter("ignore")
    # Words that libraries print are not to fall between the replies.
    replies = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)
    last, signals, opened = None, dict[str, StoredArray](), ExitStack()
    reply: Any
    while True:
        try:
            file, name, span = pickle.load(sys.stdin.buffer)
        except EOFError:
            return
        try:
            if file != last:
                opened.close()
                last, signals = None, dict(opened.enter_context(file.open_arrays()).arrays)
                last = file
            rows = ((n, (x.shape, x.dtype, x.units, x.rate_hz, x.rows is not None, x.time)) for n, x in signals.items())
            reply = _values(signals[name], span) if name else dict(rows)
        except MemoryError:
            amount = f"more than {limit / 1e9:.3g} GB of" if limit else "more"
            reply = ValueError(f"its reader needs {amount} memory")
        except ElastidError as error:
            reply = error
        except Exception as error:
            is_fault = is_program_fault(error)
            reply = ProgramError(format_exc()) if is_fault else ValueError(f"{type(error).__name__}: {error}")
        pickle.dump(reply, replies)
        replies.flush()


def limits_memory() -> bool:
    """Return True if the system limits the memory of a process: not Windows, nor macOS, which ignores the limit."""
    return hasattr(os, "sysconf") and sys.platform != "darwin"


def limit_memory() -> int:
    """Limit the memory of this process; return the limit in bytes, 0 if the system does not support it."""
    if not limits_memory() or not hasattr(os, "sysconf"):
        return 0
    import resource

    try:
        memory = os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")
        limit = max(int(0.5 * memory), 2 << 30)  # half of the machine's memory, and not less than 2 GiB
        soft, hard = resource.getrlimit(resource.RLIMIT_DATA)
        limit = min([limit, *(bound for bound in (soft, hard) if bound != resource.RLIM_INFINITY)])
        resource.setrlimit(resource.RLIMIT_DATA, (limit, hard))
    except (ValueError, OSError):
        return 0
    return limit


def _values(array: StoredArray, span: slice | None) -> NDArray[Any]:
    values = np.asarray(array.read() if span is None or array.rows is None else array.rows(span))
    if values.dtype.hasobject:
        raise ValueError(f"values of type {values.dtype} are not numbers")
    return values
