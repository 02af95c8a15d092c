"""What a second process wins: a whole identification by one process and by two, on the wall clock.

    python scripts/benchmarks/processes.py [--quick]

The problem is that of fit.py, 20 configurations x 200 lines with full covariances and 40 parameters, from 8 starts, as
the template of `elastid new` asks for, and from 32. Two processes share the starts, the test of everything that the fit
held, the covariance and the ends of the intervals, configuration by configuration or parameter by parameter; the
responses' weights and the equations of the robot are worked out by the first alone. Wants a machine with two quiet
cores. Both must end in the same numbers. The last line is one JSON object; last_run.json has that of the last run.

Measured: one process takes 1.2 (two_processes_8_starts) times as long as two from few starts, and 1.5
(two_processes_32_starts) times as long from many.
"""

# One BLAS thread must be asked for before NumPy is loaded.
# ruff: noqa: E402
import os

for variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ[variable] = "1"

import argparse
import json
import statistics
import time

import numpy as np
from fit import IDENTIFIED, build_robot, measured
from timing import machine

from elastid.base.execution import Execution
from elastid.base.workers import lasting_workers, load_for_workers
from elastid.fit.identify import identify
from elastid.fit.spec import FitSpec, ParameterSpec


def wall_s(Q: int, F: int, starts: int, rounds: int) -> dict[int, float]:
    """Median seconds of a whole identification by one process and by two, in turns."""
    robot = build_robot()
    responses = measured(robot, Q, np.linspace(2.0, 100.0, F))
    spec = FitSpec(parameters={name: ParameterSpec() for name in IDENTIFIED}, starts=starts, seed=1)
    times: dict[int, list[float]] = {1: [], 2: []}
    ends = set()
    for _ in range(rounds):
        for jobs, each in times.items():
            begin = time.perf_counter()
            with lasting_workers():  # as every command of a study has them
                result = identify(responses, robot, spec, execution=Execution(jobs))
            each.append(time.perf_counter() - begin)
            ends.add(result.x.tobytes())
    assert len(ends) == 1
    return {jobs: statistics.median(each) for jobs, each in times.items()}


def main() -> None:
    """The table, then one JSON line."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--quick", action="store_true", help="a small problem, to see that it runs")
    quick = parser.parse_args().quick
    print(machine())
    load_for_workers(["elastid.fit.identify"])
    (Q, F), rounds = ((2, 30), 1) if quick else ((20, 200), 5)
    found = {}
    print(f"{'starts':>8s} {'one, s':>8s} {'two, s':>8s} {'ratio':>8s}")
    for starts in (2,) if quick else (8, 32):
        one, two = wall_s(Q, F, starts, rounds).values()
        found[f"two_processes_{starts}_starts"] = round(one / two, 2)
        print(f"{starts:8d} {one:8.2f} {two:8.2f} {one / two:8.2f}")
    print(json.dumps(found))


if __name__ == "__main__":
    main()
