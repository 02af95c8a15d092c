"""C as machine code: made once by the C compiler of the machine, kept in the cache folder of the user.

A library is only loaded from a file and a folder that belong to the user and that nobody else can write. Processes that
compile the same do not disturb each other. Whatever fails on the way, the caller has another way to the same numbers.
"""

from __future__ import annotations

import ctypes
import hashlib
import logging
import os
import platform
import shlex
import shutil
import stat
import subprocess
import tempfile
from collections.abc import Callable, Sequence
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

COMPILERS = ("cc", "gcc", "clang")
MAX_COMPILE_S = 20.0
# For the processor at hand; fused multiply-adds, but NaN, infinity and the order of sums stay what they are.  Nobody
# asks for errno, which would have roots taken one by one.
LOOP_FLAGS = ("-O3", "-march=native", "-ffp-contract=fast", "-fno-math-errno", "-shared", "-fPIC")
# Their sources begin with this.
REGISTERS = Path(__file__).with_name("registers.c")
PROCESSOR = Path(os.sep, "proc", "cpuinfo")  # of Linux

_log = logging.getLogger(__name__)


def compiler() -> tuple[str, ...]:
    """The command of the C compiler: $CC, cc, gcc or clang; empty where there is none, or no owners of files.

    A $CC with an unclosed quote names no command.
    """
    if not hasattr(os, "getuid"):
        return ()
    try:
        chosen = shlex.split(os.environ.get("CC", ""))
    except ValueError:
        _log.debug("CC=%s is no command: a quote is not closed", os.environ["CC"])
        chosen = []
    for words in (chosen, *([name] for name in COMPILERS)):
        if words and (found := shutil.which(words[0])):
            return (found, *words[1:])
    return ()


def cache_folder() -> Path:
    """The folder of the libraries, made where it is missing; OSError where another user could write to it."""
    base = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
    folder = base / "elastid"
    base.mkdir(parents=True, exist_ok=True)
    folder.mkdir(mode=0o700, exist_ok=True)
    _check_is_private(folder, stat.S_ISDIR)
    return folder


def library(name: str, source: str, command: tuple[str, ...], flags: Sequence[str], *known: str) -> Path:
    """The path of the library of a source, compiled where it is missing; known: what else it depends on.

    OSError, RuntimeError or subprocess.SubprocessError where that fails.
    """
    path = cache_folder() / f"{name}-{_key(source, command, flags, known)}.so"
    if not path.exists():
        _compile(source, [*command, *flags], path)
    _check_is_private(path, stat.S_ISREG)
    return path


@cache
def loops(paths: tuple[Path, ...], *flags: str) -> ctypes.CDLL | None:
    """The functions of C files, one behind the other after REGISTERS, for this processor; None where that fails."""
    command = compiler()
    if not command:
        return None
    try:
        source = "\n".join(path.read_text(encoding="utf-8") for path in (REGISTERS, *paths))
        return ctypes.CDLL(str(library(paths[-1].stem, source, command, (*LOOP_FLAGS, *flags), _processor())))
    except (OSError, RuntimeError, subprocess.SubprocessError) as error:
        _log.debug("%s is not compiled: %s", paths[-1].name, error)
        return None


def call(library: ctypes.CDLL | None, name: str, *arguments: int | npt.NDArray[Any] | None) -> None:
    """Call a function of `loops` with 64-bit integers and contiguous arrays; MemoryError where it says so.

    None is a null pointer. Arrays that are not contiguous are copied: what is written to must be.
    """
    if library is None:
        raise RuntimeError(f"the loops of {name} are not compiled; ask `loops` before")
    kept = [np.ascontiguousarray(one) if isinstance(one, np.ndarray) else one for one in arguments]
    if getattr(library, name)(*map(_passed, kept)):
        raise MemoryError(f"no memory is left for the loops of {name}")


def _passed(argument: int | npt.NDArray[Any] | None) -> object:
    """What ctypes takes for an argument of `call`."""
    if not isinstance(argument, np.ndarray):
        return argument if argument is None else ctypes.c_int64(argument)
    if argument.size and argument.flags.writeable:
        return ctypes.byref(ctypes.c_char.from_buffer(argument.data))  # in a quarter of the time
    return ctypes.c_void_p(argument.ctypes.data)


def _processor() -> str:
    """Model and instructions of the processor: a home folder may be seen by several machines."""
    try:
        lines = PROCESSOR.read_text(encoding="utf-8").splitlines()
    except OSError:
        return platform.processor()
    return "\n".join(
        sorted({line for line in lines if line.startswith(("model name", "flags", "Features", "CPU part"))})
    )


def _key(source: str, command: tuple[str, ...], flags: Sequence[str], known: Sequence[str]) -> str:
    """All that a library depends on: source, compiler, flags, machine and what else is known."""
    found = Path(command[0]).stat()
    machine = platform.machine(), *platform.libc_ver()
    parts = source, *command, found.st_mtime_ns, found.st_size, *flags, *known, *machine
    return hashlib.sha256("\0".join(map(str, parts)).encode()).hexdigest()[:32]


def _compile(source: str, call: Sequence[str], path: Path) -> None:
    """A complete library appears at path, or none."""
    with tempfile.TemporaryDirectory(dir=path.parent) as folder:
        code, made = Path(folder, "function.c"), Path(folder, "function.so")
        code.write_text(source, encoding="utf-8")
        whole = [*call, str(code), "-o", str(made), "-lm"]
        subprocess.run(whole, check=True, capture_output=True, timeout=MAX_COMPILE_S, cwd=folder)
        made.chmod(0o600)
        with made.open("rb") as written:
            os.fsync(written.fileno())
        made.replace(path)


def _check_is_private(path: Path, is_kind: Callable[[int], bool]) -> None:
    found = path.lstat()
    if not is_kind(found.st_mode) or found.st_uid != os.getuid() or found.st_mode & 0o022:
        raise PermissionError(f"{path} does not belong to this user alone")
