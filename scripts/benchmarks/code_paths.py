"""One evaluation of a fit over its floor, on each code path of OpenBLAS that this processor has.

    python scripts/benchmarks/code_paths.py [--quick]

The problem of fit.py, 20 configurations x 200 lines. The floor, 96 kflop a line by zgemm, is as fast as the code path
that OpenBLAS takes: Haswell (AVX2) or SkylakeX (AVX-512), asked for by OPENBLAS_CORETYPE in a process each. Kernels of
this package take the widest registers in both. CPU time, medians in turn. The last line is one JSON object;
last_run.json has that of the last run.

Measured, on a machine whose caches twenty other processes shared: 2.8 (Haswell) times the floor on the one code path,
3.6 (SkylakeX) times on the other.
"""

# One BLAS thread must be asked for before NumPy is loaded.
# ruff: noqa: E402
import os

for variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ[variable] = "1"

import argparse
import json
import subprocess
import sys
from pathlib import Path

from fit import EVALUATION, FLOOR, assemble, flop_floor
from timing import in_turn, machine

# Each with the flag of the processors that have it.
CODE_PATHS = {"Haswell": "avx2", "SkylakeX": "avx512f"}


def over_floor(Q: int, F: int, repeats: int) -> float:
    """Time of an evaluation over that of the floor."""
    fit, x = assemble(Q, F)
    fit.rough(x)
    times = in_turn({FLOOR: flop_floor(Q * F), EVALUATION: lambda: fit.rough(x)}, repeats)
    return times[EVALUATION] / times[FLOOR]


def main() -> None:
    """A line for each code path, then one JSON line."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--quick", action="store_true", help="a small problem, to see that it runs")
    parser.add_argument("--this", action="store_true", help="the code path of this process alone")
    given = parser.parse_args()
    if given.this:
        print(machine())
        print(over_floor(*((2, 12, 3) if given.quick else (20, 200, 41))))
        return
    cpuinfo = Path("/proc/cpuinfo")
    flags = set(cpuinfo.read_text(encoding="utf-8").split()) if cpuinfo.is_file() else set()
    paths = [name for name, flag in CODE_PATHS.items() if flag in flags] or [""]
    found = {}
    for name in paths:
        environment = os.environ | ({"OPENBLAS_CORETYPE": name} if name else {})
        command = [sys.executable, __file__, "--this", *(["--quick"] if given.quick else [])]
        said = subprocess.run(command, env=environment, check=True, capture_output=True, text=True).stdout.splitlines()
        print(said[0], f"{float(said[1]):.2f} x floor", sep="\n", flush=True)
        found[name or "default"] = round(float(said[1]), 2)
    print(json.dumps(found))


if __name__ == "__main__":
    main()
