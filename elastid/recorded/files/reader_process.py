"""The guarded process that reads files of foreign formats: MATLAB up to version 7, ROS, TDMS and Parquet.

Their libraries trust the lengths in a file: a damaged one asks for any amount of memory, or ends the process. So they
work in a process of their own with a limit on its memory, started for the first file and ended with the program. A
request is a line of JSON, and so is each reply; behind that of a signal are the bytes of its values.
"""

from __future__ import annotations

import atexit
import json
import os
import signal
import subprocess
import sys
import warnings
from collections.abc import Callable, Iterator, Mapping
from contextlib import AbstractContextManager, ExitStack, contextmanager, suppress
from importlib import import_module
from io import BufferedReader
from pathlib import Path
from threading import RLock
from typing import Any

import numpy as np
from numpy.typing import NDArray

from elastid.base.errors import DataError, ElastidError, StudyError
from elastid.experiment.specs.recorded import TextFormatSpec
from elastid.recorded.files.log import ArrayLog, StoredArray

# Errors that keep their kind on the way from the reader; their texts name the file.
_KINDS: Mapping[str, type[Exception]] = {kind.__name__: kind for kind in (StudyError, DataError, ElastidError)}

# The reader of each process (workers begin as copies of another) and path of imports.
_readers: dict[tuple[int, str], subprocess.Popen[bytes]] = {}
_one_request = RLock()


def guarded(
    reader: Callable[[Path, TextFormatSpec], AbstractContextManager[ArrayLog]],
) -> Callable[[Path, TextFormatSpec], AbstractContextManager[ArrayLog]]:
    """The function that opens a file, carried out in the guarded process."""

    @contextmanager
    def opened(path: Path, text: TextFormatSpec) -> Iterator[ArrayLog]:
        names = {"module": reader.__module__, "name": reader.__name__}
        file = {**names, "folder": os.getcwd(), "path": str(path), "version": _version(path)}
        signals = _ask({"file": file})["signals"]
        yield ArrayLog(path, {entry["name"]: _stored(file, index, entry) for index, entry in enumerate(signals)})

    return opened


def _stored(file: Mapping[str, Any], index: int, signal_of: Mapping[str, Any]) -> StoredArray:
    """A signal as the reader describes it, its values asked for when they are used."""

    def values(part: slice | None = None) -> NDArray[Any]:
        rows = None if part is None else (part.start, part.stop, part.step)
        read: NDArray[Any] = _ask({"file": file, "signal": index, "rows": rows})
        return read

    shape, dtype, rows = tuple(signal_of["shape"]), np.dtype(signal_of["dtype"]), signal_of["in_pieces"]
    return StoredArray(shape, dtype, values, signal_of["units"], signal_of["rate_hz"], values if rows else None)


def _version(path: Path) -> list[list[Any]]:
    files = sorted(path.iterdir()) if path.is_dir() else [path]
    return [[file.name, stat.st_ino, stat.st_size, stat.st_mtime_ns] for file in files for stat in [file.stat()]]


def _ask(request: Mapping[str, Any]) -> Any:
    """The signals of a file or the values of one; the error of the reader, ValueError where it died."""
    where = os.pathsep.join(place or os.getcwd() for place in sys.path)
    with _one_request:
        reader = _reader(where)
        try:
            reply, values = _exchange(reader, request)
        except BaseException:  # Ctrl-C, say: the reply that is lost would be taken for that to the next request
            _end(_readers.pop((os.getpid(), where)))
            raise
        if reply is None:
            code = _end(_readers.pop((os.getpid(), where)))
            raise ValueError(f"the process that read it died, exit code {code}")
    if "error" in reply:
        raise _KINDS.get(reply["error"], ValueError)(*reply["arguments"])
    return reply if values is None else values


def _exchange(reader: subprocess.Popen[bytes], request: Mapping[str, Any]) -> tuple[Any, NDArray[Any] | None]:
    """The reply, and the values behind it; None of a reader that died."""
    assert reader.stdin is not None
    assert isinstance(reader.stdout, BufferedReader)
    with suppress(BrokenPipeError):
        reader.stdin.write(json.dumps(request).encode() + b"\n")
        reader.stdin.flush()
    reply = json.loads(reader.stdout.readline() or "null")
    if reply is None or "dtype" not in reply:
        return reply, None
    values = np.empty(reply["shape"], reply["dtype"])
    n_bytes = reader.stdout.readinto(values.reshape(-1).view(np.uint8).data)
    return (reply if n_bytes == values.nbytes else None), values


def _reader(where: str) -> subprocess.Popen[bytes]:
    key = os.getpid(), where
    if key not in _readers:
        # -P: nothing is imported from the folder that the user happens to be in.
        command = [sys.executable, "-P", "-c", f"from {__name__} import serve; serve()"]
        pipe, env = subprocess.PIPE, os.environ | {"PYTHONPATH": where}
        # Words of the libraries go nowhere.
        _readers[key] = subprocess.Popen(command, stdin=pipe, stdout=pipe, stderr=subprocess.DEVNULL, env=env)
        atexit.register(_end, _readers[key])
    return _readers[key]


def _end(reader: subprocess.Popen[bytes]) -> int:
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
    """The process that reads answers requests until the program ends."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is the program's, which ends this process
    limit = limit_memory()
    warnings.simplefilter("ignore")
    # Words that libraries print are not to fall between the replies.
    replies = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)
    last, signals, opened = None, list[tuple[str, StoredArray]](), ExitStack()
    for line in sys.stdin.buffer:
        request = json.loads(line)
        values = None
        try:
            if request["file"] != last:
                opened.close()
                last, signals = None, []
                signals = list(opened.enter_context(_opened(**request["file"])).arrays.items())
                last = request["file"]
            if "signal" in request:
                values = _values(signals[request["signal"]][1], request["rows"])
                reply = {"dtype": values.dtype.str, "shape": values.shape}
            else:
                reply = {"signals": [_described(name, array) for name, array in signals]}
        except MemoryError:
            amount = f"more than {limit / 1e9:.3g} GB of" if limit else "more"
            reply = {"error": "MemoryError", "arguments": [f"its reader asks for {amount} memory"]}
        except Exception as error:
            kind = type(error).__name__
            reply = {"error": kind, "arguments": error.args if kind in _KINDS else [f"{kind}: {error}"]}
        replies.write(json.dumps(reply).encode() + b"\n")
        if values is not None:
            replies.write(values.reshape(-1).view(np.uint8).data)
        replies.flush()


def limit_memory() -> int:
    """Limit the memory of this process; the limit in bytes, 0 where the system has none."""
    if not hasattr(os, "sysconf"):
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


def _opened(module: str, name: str, folder: str, path: str, version: object) -> AbstractContextManager[ArrayLog]:
    os.chdir(folder)
    opened: AbstractContextManager[ArrayLog] = getattr(import_module(module), name)(Path(path), TextFormatSpec())
    return opened


def _described(name: str, array: StoredArray) -> dict[str, Any]:
    return {
        "name": name,
        "shape": [int(n) for n in array.shape],
        "dtype": array.dtype.str,
        "units": array.units,
        "rate_hz": None if array.rate_hz is None else float(array.rate_hz),
        "in_pieces": array.rows is not None,
    }


def _values(array: StoredArray, rows: list[int | None] | None) -> NDArray[Any]:
    """The values of a signal, or a part of its rows, in the order of their indices."""
    values = array.read() if rows is None or array.rows is None else array.rows(slice(*rows))
    values = np.asarray(values, order="C")
    if values.dtype.hasobject:
        raise TypeError(f"values of type {values.dtype} are no numbers")
    return values
