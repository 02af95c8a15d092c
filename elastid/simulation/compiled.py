"""CasADi functions as machine code, made by the C compiler of the machine (`elastid.base.compiled`).

The code does the same operations in the same order as CasADi's virtual machine, without contraction into fused
multiply-adds and without the compiler's own arithmetic of pow, sin and cos: results are the same bit for bit with and
without a compiler. Whatever fails on the way, the function runs in the virtual machine.
"""

from __future__ import annotations

import logging
import subprocess

import casadi as ca

from elastid.base.compiled import compiler, library

FLAGS = ("-O1", "-shared", "-fPIC", "-ffp-contract=off", "-fno-builtin")
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


def _loaded(function: ca.Function, command: tuple[str, ...]) -> ca.Function:
    generator = ca.CodeGenerator(f"{function.name()}.c")
    generator.add(function)
    path = library(function.name(), generator.dump(), command, FLAGS, ca.CasadiMeta.version())
    return ca.external(function.name(), str(path))
