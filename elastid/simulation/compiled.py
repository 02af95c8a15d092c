"""CasADi functions as machine code, made on request by the C compiler of the machine in a temporary folder.

The code does the same operations in the same order as CasADi's virtual machine, without contraction into fused
multiply-adds and without the compiler's own arithmetic of pow, sin and cos: results are the same bit for bit. Where
compiling fails a warning gives the reason, and the function runs in the virtual machine. Nothing is left on the disk.
"""

from __future__ import annotations

import logging
import os
import shlex
import shutil
import subprocess
import tempfile
from pathlib import Path

import casadi as ca

FLAGS = ["-O1", "-shared", "-fPIC", "-ffp-contract=off", "-fno-builtin"]
MAX_COMPILE_S = 60.0
# Calls that save as much time as compiling takes.
MIN_CALLS = 20_000

_log = logging.getLogger(__name__)


def compiled(function: ca.Function, calls: int) -> ca.Function:
    """The function as machine code if at least MIN_CALLS calls are announced, otherwise itself."""
    if calls < MIN_CALLS:
        return function
    try:
        return _loaded(function)
    except (OSError, RuntimeError, subprocess.SubprocessError) as error:
        _log.warning(
            "the equations of the simulation are interpreted, with the same results in about three times the time, "
            "because they cannot be compiled: %s; name a C compiler by CC, or leave out experiment.simulated.compiled",
            error,
        )
        return function


def compiler() -> list[str]:
    """The command of the C compiler: $CC, otherwise cc, gcc or clang; OSError where there is none."""
    try:
        given = shlex.split(os.environ.get("CC", ""), posix=os.name != "nt")
    except ValueError as error:
        raise OSError(f"CC={os.environ['CC']} is no command: {error}") from None
    for name, *words in [given] if given else [["cc"], ["gcc"], ["clang"]]:
        path = shutil.which(name)
        if path:
            return [path, *words]
    raise OSError(f"there is no C compiler ({given[0] if given else 'cc, gcc, clang'})")


def _loaded(function: ca.Function) -> ca.Function:
    """The function from a library whose file is gone; OSError, RuntimeError or SubprocessError where that fails."""
    generator = ca.CodeGenerator(f"{function.name()}.c")
    generator.add(function)
    # Windows removes no library that is loaded.
    with tempfile.TemporaryDirectory(prefix="elastid-", ignore_cleanup_errors=True) as folder:
        source, library, output = (Path(folder, name) for name in ("function.c", "function.so", "output"))
        source.write_text(generator.dump(), encoding="utf-8")
        command = [*compiler(), *FLAGS, str(source), "-o", str(library), "-lm"]
        with output.open("wb") as file:  # a pipe would stay open with a child of the compiler that never ends
            done = subprocess.run(command, stdout=file, stderr=file, timeout=MAX_COMPILE_S, cwd=folder, check=False)
        if done.returncode:
            words = output.read_text(encoding="utf-8", errors="replace").strip()[-300:]
            raise OSError(f"{command[0]} ended with status {done.returncode} {words}".rstrip())
        return ca.external(function.name(), str(library))
