"""Peak memory of a fit of a thousand configurations whose lines have full covariances, from its file.

    python scripts/benchmarks/large_fit.py [--quick] [--configurations Q] [--folder F]

The robot of fit.py, 18 coordinates and 40 parameters, 200 lines, six inputs and outputs, a covariance of 36 x 36 at
every line: 4.2 MB a configuration in frf.h5, whose arrays stay in the file. Two starts, a floor of 1 %, no profiles;
search, covariance of the estimate and diagnosis as in a study. File and fit are made by processes of their own; the
peak is all memory that the fit ever had (ru_maxrss), pages of the file included. Linux only. The last line is one
JSON object.
"""

# One BLAS thread must be asked for before NumPy is loaded.
# ruff: noqa: E402
import os

for variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ[variable] = "1"

import argparse
import json
import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
from fit import IDENTIFIED, build_robot, measured
from timing import machine

from elastid.fit.identify import identify
from elastid.fit.spec import FitSpec, ParameterSpec, WeightSpec
from elastid.store.measured import read_responses, write_responses


def write(path: Path, Q: int, F: int) -> None:
    """frf.h5 of Q configurations and F lines."""
    write_responses(path, measured(build_robot(), Q, np.linspace(2.0, 100.0, F)))


def fit(path: Path) -> None:
    """The fit of a file, and what it took, as JSON."""
    spec = FitSpec(
        parameters={name: ParameterSpec() for name in IDENTIFIED}, starts=2, seed=1, profile=(),
        weights=WeightSpec(floor=0.01),
    )  # fmt: skip
    begin = time.process_time()
    responses = read_responses(path)
    result = identify(responses, build_robot(), spec)
    peak_gb = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024 / 1e9
    cpu_s = time.process_time() - begin
    found = {"status": result.status, "hits": result.hits, "V_over_expected": result.cost / result.cost_expected}
    print(json.dumps({"configurations": len(responses), "peak_gb": peak_gb, "cpu_s": cpu_s, **found}))


def main() -> None:
    """The figures, then one JSON line."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--quick", action="store_true", help="three configurations, to see that it runs")
    parser.add_argument("--configurations", type=int, default=1000)
    parser.add_argument("--folder", type=Path, help="for the file (default: a temporary one)")
    parser.add_argument("--write", type=Path, help=argparse.SUPPRESS)
    parser.add_argument("--fit", type=Path, help=argparse.SUPPRESS)
    given = parser.parse_args()
    Q, F = (3, 30) if given.quick else (given.configurations, 200)
    if given.write:
        write(given.write, Q, F)
    elif given.fit:
        fit(given.fit)
    else:
        print(machine(), flush=True)
        with tempfile.TemporaryDirectory(dir=given.folder) as folder:
            path, size = Path(folder) / "frf.h5", ["--configurations", str(Q), *(["--quick"] if given.quick else [])]
            subprocess.run([sys.executable, __file__, "--write", path, *size], check=True)
            answer = subprocess.run([sys.executable, __file__, "--fit", path], check=True, capture_output=True)
            found = json.loads(answer.stdout) | {"file_gb": path.stat().st_size / 1e9}
        print(json.dumps({name: round(v, 2) if isinstance(v, float) else v for name, v in found.items()}))


if __name__ == "__main__":
    main()
