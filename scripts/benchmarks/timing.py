"""CPU times of functions for the benchmarks: medians, of functions that are compared in turn; and the machine.

Scripts import it first: it asks for one BLAS thread, which NumPy reads when it is loaded.
"""

import os

os.environ |= dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), "1")

import ctypes
import platform
import statistics
import time
from collections.abc import Callable, Mapping
from pathlib import Path

import numpy as np

from elastid.base.kernels import description


def cpu_seconds(function: Callable[[], object], repeats: int) -> float:
    """Return the median CPU time of a call, after one that does not count; the machine may be shared."""
    return in_turn({"": function}, repeats)[""]


def in_turn(functions: Mapping[str, Callable[[], object]], repeats: int) -> dict[str, float]:
    """Return median CPU times of functions that take turns, so that what else the machine does meets all of them."""
    times: dict[str, list[float]] = {name: [] for name in functions}
    for repeat in range(repeats + 1):
        for name, function in functions.items():
            begin = time.process_time()
            function()
            if repeat:
                times[name].append(time.process_time() - begin)
    return {name: statistics.median(each) for name, each in times.items()}


def bare_work_s() -> float:
    """Return the CPU time of a fixed mixture of FFT, products of matrices, copies and Python, a unit for programs."""
    far = np.zeros(1 << 24)  # 128 MB, in no cache: machines differ most in how fast memory is
    x = np.random.default_rng(0).standard_normal((6, 1 << 18))
    A = x[:, :15000].reshape(-1, 150, 150) + 0j

    def work() -> None:
        np.fft.rfft(x, axis=1)
        A @ A
        far.copy()
        sum(i * i for i in range(1_000_000))

    return cpu_seconds(work, 9)


def machine() -> str:
    """Name the processor, the kernels of this package, and those of BLAS with its number of threads."""
    return f"{_processor()}; {description()}; {_blas()}"


def _processor() -> str:
    cpuinfo = Path("/proc/cpuinfo")
    lines = cpuinfo.read_text(encoding="utf-8").splitlines() if cpuinfo.is_file() else []
    names = [line.partition(": ")[2] for line in lines if line.startswith("model name")]
    return f"{names[0] if names else platform.processor() or platform.machine()}, {os.cpu_count()} threads"


def _blas() -> str:
    """Name the processor of OpenBLAS's kernels, which it chooses when it is loaded."""
    built = np.show_config(mode="dicts")["Build Dependencies"]["blas"]
    words = f"BLAS {built['name']} {built['version']}"
    for path in Path(np.__file__).parents[1].glob("numpy.libs/*openblas*"):
        library = ctypes.CDLL(str(path))
        for suffix in ("64_", ""):
            if core := getattr(library, f"scipy_openblas_get_corename{suffix}", None):
                core.restype = ctypes.c_char_p
                threads = getattr(library, f"scipy_openblas_get_num_threads{suffix}")()
                return f"{words}, kernels for {core().decode()}, {threads} threads"
    return words
