"""Numerical kernels in C: a library that is built with the package, each kernel for several processor levels.

`scripts/kernels_hook.py` compiles the C files of this folder when a wheel or an editable installation is made. Without
a C compiler NumPy or CasADi is used instead; results then agree to rounding. The choice depends only on the
installation and the processor.
"""

import ctypes
import hashlib
import logging
import sys
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

FOLDER = Path(__file__).parent
LIBRARY = FOLDER / ("kernels.dll" if sys.platform == "win32" else "kernels.so")
_BUILD_AGAIN = "install elastid again (in a clone: uv sync --reinstall-package elastid) with a C compiler"

_log = logging.getLogger(__name__)


def is_compiled() -> bool:
    """Return True if kernels run in C."""
    return _library() is not None


def is_wide() -> bool:
    """Return True if kernels run in C with more than two numbers in a register."""
    return is_compiled() and _processor_level() != "portable"


def description() -> str:
    """Describe the kernels in use and the processor level that they are compiled for."""
    return f"kernels in C for {_processor_level()}" if is_compiled() else "kernels in NumPy"


def call(name: str, *arguments: int | npt.NDArray[Any] | None) -> None:
    """Call a kernel with 64-bit integers and contiguous arrays; raise MemoryError if it runs out of memory.

    None is a null pointer. Arrays that are not contiguous are copied, so output arrays must be contiguous.
    RuntimeError without the library.
    """
    contiguous = [np.ascontiguousarray(value) if isinstance(value, np.ndarray) else value for value in arguments]
    if _kernel(name)(*map(_c_argument, contiguous)):
        raise MemoryError(f"no memory is left for the kernel {name}")


def sources_hash() -> str:
    """Return the SHA-256 of the C files."""
    digest = hashlib.sha256()
    for path in sorted(FOLDER.glob("*.[ch]")):
        digest.update(path.read_bytes())
    return digest.hexdigest()


@cache
def _library() -> ctypes.CDLL | None:
    """Load the compiled library; return None without one, and warn if it does not load or has other sources."""
    if not LIBRARY.exists():
        return None
    try:
        library = ctypes.CDLL(str(LIBRARY))
        library.sources.restype = library.processor_level.restype = ctypes.c_char_p
        if library.sources().decode() != sources_hash():
            raise OSError("it was built from other C files")
    except (OSError, AttributeError) as error:
        _log.warning("%s is not used, NumPy does its work: %s; %s", LIBRARY, error, _BUILD_AGAIN)
        return None
    return library


@cache
def _processor_level() -> str:
    """Return the widest level of the library for this processor: portable, avx2 or avx512."""
    library = _library()
    if library is None:
        raise RuntimeError(f"there is no library of kernels at {LIBRARY}; {_BUILD_AGAIN}")
    return str(library.processor_level().decode())


@cache
def _kernel(name: str) -> Callable[..., int]:
    return getattr(_library(), f"{name}_{_processor_level()}")  # type: ignore[no-any-return]


def _c_argument(argument: int | npt.NDArray[Any] | None) -> object:
    if not isinstance(argument, np.ndarray):
        return argument if argument is None else ctypes.c_int64(argument)
    if argument.size and argument.flags.writeable:
        return ctypes.byref(ctypes.c_char.from_buffer(argument.data))  # four times faster than argument.ctypes
    return ctypes.c_void_p(argument.ctypes.data)
