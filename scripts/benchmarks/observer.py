"""What a sample of the filter that follows friction costs: exported as C, in this process, and beside least squares.

    python scripts/benchmarks/observer.py [--quick]

An elastic joint with eight states, of which three are followed, over 60 s at 1 kHz: the exported C function compiled
by `cc -O2`, the filter as `elastid follow` runs it, and recursive least squares with forgetting on three numbers, a
loop in NumPy that follows no states. CPU time, microseconds a sample and axis, best of several runs. The states of C
must be those of the filter to 1e-9. The last line is one JSON object; without a compiler C is left out.

Found at full size, on a busy machine of two cores: C 0.88 us, the filter 26 us, least squares 6.6 us; 0.60 and 13.9 us
without the five numbers that this joint holds with errors.
"""

# One BLAS thread must be asked for before NumPy is loaded.
# ruff: noqa: E402
import os

for variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ[variable] = "1"

import argparse
import ctypes
import json
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[2]))
from elastid.base.arrays import FloatArray
from elastid.export.friction import Observer, write_observers
from elastid.friction_study.extended_kalman_filter import FilterNoise, KalmanFilter, first_estimate
from tests.plants.warm_joint import COUNT, FOLLOWED, RATE_HZ, TORQUE_STD, rich, simulate

NOISE = FilterNoise(COUNT / np.sqrt(12), TORQUE_STD, drift={"Fc": 6e-3, "f": 25e-3, "offset": 1e-3})
REPEATS = 5
FORGET = 1 - 1 / 5000
LOOP = """
#include "observer.h"
void over(int n, double *x, double *P, const double *u, const double *g, const double *y) {
  for (int i = 0; i < n; i++) joint_1_follow(x, P, u[i], g[i], y[i], 0, 0);
}
"""


def microseconds(work: Callable[[], object], samples: int) -> float:
    """CPU time of one sample, best of several runs."""
    times = []
    for _ in range(REPEATS):
        began = time.process_time()
        work()
        times.append(time.process_time() - began)
    return 1e6 * min(times) / samples


def compiled(folder: Path) -> ctypes.CDLL:
    """The exported filter with a loop over samples."""
    source, _ = write_observers(folder, {"1": Observer(FOLLOWED, NOISE, RATE_HZ)})
    loop, library = folder / "loop.c", folder / "observer.so"
    loop.write_text(LOOP)
    subprocess.run(["cc", "-std=c99", "-O2", "-shared", "-fPIC", source, loop, "-o", library, "-lm"], check=True)
    return ctypes.CDLL(str(library))


def least_squares(x: FloatArray, y: FloatArray) -> FloatArray:
    """Recursive least squares with forgetting of y (n,) on x (n, 3); the last estimate (3,)."""
    estimate, P = np.zeros(3), np.eye(3) * 1e4
    for row, value in zip(x, y, strict=True):
        gain = P @ row / (FORGET + row @ P @ row)
        estimate = estimate + gain * (value - row @ estimate)
        P = (P - np.outer(gain, row @ P)) / FORGET
    return estimate


def main() -> None:
    """Print a table, then one JSON line."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--quick", action="store_true", help="2 s of motion")
    seconds = 2 if parser.parse_args().quick else 60
    samples = simulate(rich(seconds), 1).samples
    n, start = len(samples.angle), first_estimate(FOLLOWED, float(samples.angle[0]))
    kalman = KalmanFilter(FOLLOWED, RATE_HZ)
    track = kalman.run(samples, NOISE, start)
    found = {"filter": microseconds(lambda: kalman.run(samples, NOISE, start), n)}
    v = np.gradient(samples.angle) * RATE_HZ
    regressors = np.stack([np.sign(v), v, np.ones_like(v)], axis=1)
    found["least squares"] = microseconds(lambda: least_squares(regressors, samples.torque), n)
    if shutil.which("cc") is not None:
        with tempfile.TemporaryDirectory() as folder:
            library = compiled(Path(folder))
            given = [part.ctypes.data_as(ctypes.c_void_p) for part in (samples.torque, samples.load, samples.angle)]

            def run() -> FloatArray:
                x, P = start.x.copy(), start.P.ravel(order="F")
                library.over(n, *(part.ctypes.data_as(ctypes.c_void_p) for part in (x, P)), *given)
                return x

            np.testing.assert_allclose(run(), track.last.x, rtol=1e-9, atol=1e-12)
            found["C"] = microseconds(run, n)
    for name, value in found.items():
        print(f"{name:14} {value:6.2f} us a sample")
    print(json.dumps({"samples": n, "microseconds": found}))


if __name__ == "__main__":
    main()
