"""CasADi functions as machine code: made once by the C compiler of the machine, kept in the cache folder of the user.

The code does the same operations in the same order as CasADi's virtual machine, without contraction into fused
multiply-adds and without the compiler's own arithmetic of pow, sin and cos: results are the same bit for bit with and
without a compiler. A library is only loaded from a file and a folder that belong to the user and that nobody else can
write. Whatever fails on the way, the function runs in the virtual machine.
"""

from __future__ import annotations

import hashlib
import logging
import os
import platform
import shlex
import shutil
import stat
import subprocess
import tempfile
from collections.abc import Callable
from pathlib import Path

import casadi as ca

COMPILERS = ("cc", "gcc", "clang")
FLAGS = ("-O1", "-shared", "-fPIC", "-ffp-contract=off", "-fno-builtin")
MAX_COMPILE_S = 20.0
# Calls that save as much time as compiling takes.
MIN_CALLS = 20_000

_log = logging.getLogger(__name__)


def compiled(function: ca.Function, calls: int) -> ca.Function:
    """The function as machine code where it will be called so often that it is worth it, itself otherwise."""
    command = compiler()
    if calls < MIN_CALLS or not command:
        return function
    try:
        return _loaded(function, command)
    except (OSError, RuntimeError, subprocess.SubprocessError) as error:
        _log.debug("%s runs in CasADi's virtual machine: %s", function.name(), error)
        return function


def compiler() -> tuple[str, ...]:
    """The command of the C compiler: $CC, cc, gcc or clang; empty where there is none, or no owners of files."""
    if not hasattr(os, "getuid"):
        return ()
    for words in (shlex.split(os.environ.get("CC", "")), *([name] for name in COMPILERS)):
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


def _loaded(function: ca.Function, command: tuple[str, ...]) -> ca.Function:
    generator = ca.CodeGenerator(f"{function.name()}.c")
    generator.add(function)
    source = generator.dump()
    folder = cache_folder()
    path = folder / f"{function.name()}-{_key(source, command)}.so"
    if not path.exists():
        _compile(source, command, path)
    _check_is_private(path, stat.S_ISREG)
    return ca.external(function.name(), str(path))


def _key(source: str, command: tuple[str, ...]) -> str:
    """All that a library depends on: source, compiler, flags, CasADi and machine."""
    found = Path(command[0]).stat()
    machine = platform.machine(), *platform.libc_ver()
    parts = source, *command, found.st_mtime_ns, found.st_size, *FLAGS, ca.CasadiMeta.version(), *machine
    return hashlib.sha256("\0".join(map(str, parts)).encode()).hexdigest()[:32]


def _compile(source: str, command: tuple[str, ...], path: Path) -> None:
    """A complete library appears at path, or none; processes that compile the same do not disturb each other."""
    with tempfile.TemporaryDirectory(dir=path.parent) as folder:
        code, library = Path(folder, "function.c"), Path(folder, "function.so")
        code.write_text(source, encoding="utf-8")
        call = [*command, *FLAGS, str(code), "-o", str(library), "-lm"]
        subprocess.run(call, check=True, capture_output=True, timeout=MAX_COMPILE_S, cwd=folder)
        library.chmod(0o600)
        with library.open("rb") as written:
            os.fsync(written.fileno())
        library.replace(path)


def _check_is_private(path: Path, is_kind: Callable[[int], bool]) -> None:
    found = path.lstat()
    if not is_kind(found.st_mode) or found.st_uid != os.getuid() or found.st_mode & 0o022:
        raise PermissionError(f"{path} does not belong to this user alone")
