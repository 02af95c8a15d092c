"""CPU times of functions for the benchmarks, their command-line options, and the description of the machine.

Scripts import this module first: it sets one BLAS thread, which NumPy reads when it is loaded.
"""

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1] / "studies"))

import ctypes
import os
import platform
import statistics
import time
from collections.abc import Callable, Mapping

import study_run  # sets one BLAS thread
import numpy as np

from elastid.base.kernels import description

options = study_run.options


def cpu_seconds(function: Callable[[], object], repeats: int) -> float:
    """Return the median CPU time of a call, s, after a warm-up call."""
    return in_turn({"": function}, repeats)[""]


def in_turn(functions: Mapping[str, Callable[[], object]], repeats: int) -> dict[str, float]:
    """Return median CPU times, s, of functions called in turn, so that other load affects all of them equally."""
    times: dict[str, list[float]] = {name: [] for name in functions}
    for repeat in range(repeats + 1):
        for name, function in functions.items():
            begin = time.process_time()
            function()
            if repeat:
                times[name].append(time.process_time() - begin)
    return {name: statistics.median(each) for name, each in times.items()}


def bare_work_s() -> float:
    """Return the CPU time, s, of a fixed mixture of FFT, matrix products, copies and Python: the unit of benchmarks."""
    far = np.zeros(1 << 24)  # 128 MB, larger than caches: machines differ most in memory bandwidth
    x = np.random.default_rng(0).standard_normal((6, 1 << 18))
    A = x[:, :15000].reshape(-1, 150, 150) + 0j

    def work() -> None:
        np.fft.rfft(x, axis=1)
        A @ A
        far.copy()
        sum(i * i for i in range(1_000_000))

    return cpu_seconds(work, 9)


def machine() -> str:
    """Describe the processor, the kernels of elastid, and BLAS with its number of threads."""
    return f"{_processor()}; {description()}; {_blas()}"


def _processor() -> str:
    cpuinfo = Path("/proc/cpuinfo")
    lines = cpuinfo.read_text(encoding="utf-8").splitlines() if cpuinfo.is_file() else []
    names = [line.partition(": ")[2] for line in lines if line.startswith("model name")]
    return f"{names[0] if names else platform.processor() or platform.machine()}, {os.cpu_count()} threads"


def _blas() -> str:
    """Describe BLAS, with the processor type that OpenBLAS selected at load time."""
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
