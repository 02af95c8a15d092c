"""Peak memory of a fit of a thousand configurations whose lines have full covariances, and what workers win.

    python scripts/benchmarks/large_fit.py [--quick] [--configurations Q] [--jobs N] [--folder F]

The robot of fit.py, 18 coordinates and 40 parameters, 200 lines, six inputs and outputs, a covariance of 36 x 36 at
every line: 4.2 MB a configuration in frf.h5, whose arrays stay in the file. Two starts, a floor of 1 %, no profiles;
search, covariance of the estimate and diagnosis as in a study. File and fit are made by processes of their own; the
peak is all memory that the fit ever had (ru_maxrss), pages of the file included.

--jobs N (1): the same fit by N worker processes, too, which must end in the same numbers. CPU seconds of the process
that asks, which no worker takes from it, and of all workers; the bytes that it sent; and how many times as fast as one
process N and 64 workers would be, if each had a processor of its own and a network took no time. Linux only.
--folder F: for the file (a temporary one).

The last line is one JSON object. Measured with a thousand: 1.41 GB of memory at the peak, in 233 CPU seconds.
"""

import json
import os
import resource
import tempfile
import time
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from contextlib import suppress
from hashlib import sha256
from multiprocessing import get_context
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

import timing
import numpy as np
from fit import IDENTIFIED, build_robot, measure

from elastid.base.execution import Execution, persistent_workers
from elastid.fit.identify import identify
from elastid.fit.spec import FitSpec, ParameterSpec, WeightSpec
from elastid.store.measured import read_responses, write_responses


def write(path: Path, Q: int, F: int) -> None:
    """Write frf.h5 with simulated responses in Q configurations at F lines."""
    write_responses(path, measure(build_robot(), Q, np.linspace(2.0, 100.0, F)))


def fit(path: Path, jobs: int) -> dict[str, Any]:
    """Fit the responses of a file. Return times, memory and properties of the result."""
    spec = FitSpec(
        parameters={name: ParameterSpec() for name in IDENTIFIED}, starts=2, seed=1, profile=(),
        weights=WeightSpec(model_error=0.01),
    )  # fmt: skip
    sent, send = [0], Connection.send_bytes

    def counted(self: Connection, data: bytes, *further: int) -> None:
        sent[0] += len(data)
        send(self, data, *further)

    Connection.send_bytes = counted  # type: ignore[method-assign]
    wall, begin = time.perf_counter(), time.process_time()
    responses = read_responses(path)
    with persistent_workers():
        result = identify(responses, build_robot(), spec, execution=Execution(jobs))
        cpu_s = time.process_time() - begin
        return {
            "configurations": len(responses),
            "peak_gb": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024 / 1e9,
            "cpu_s": cpu_s,
            "wall_s": time.perf_counter() - wall,
            "sent_mb": sent[0] / 1e6,
            "status": result.status,
            "converged_starts": result.n_converged_starts,
            "V_over_expected": result.cost / result.cost_expected,
            "sha256": sha256(result.x.tobytes() + result.covariance.tobytes()).hexdigest()[:16],
            "cpu_over_work": cpu_s / timing.bare_work_s(),
        }


def in_process(function: Callable[..., Any], *arguments: object) -> tuple[Any, float]:
    """Call a function in a new process. Return its value, and the CPU seconds of the descendants of this process."""
    seconds: dict[int, float] = {}
    with ProcessPoolExecutor(1, get_context("spawn")) as pool:
        process, value = pool.submit(os.getpid).result(), pool.submit(function, *arguments)
        while not value.done():
            seconds |= cpu_of_descendants(process)
            time.sleep(0.2)
        return value.result(), sum(seconds.values())


def cpu_of_descendants(pid: int) -> dict[int, float]:
    """Return the CPU seconds of all descendants of a process, by process id."""
    parents, seconds = dict[int, int](), dict[int, float]()
    for stat in Path("/proc").glob("[0-9]*/stat"):
        with suppress(OSError):
            fields = stat.read_text(encoding="ascii", errors="replace").rpartition(")")[2].split()
            parents[int(stat.parent.name)] = int(fields[1])
            seconds[int(stat.parent.name)] = (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")

    def descends(child: int) -> bool:
        return child in parents and (parents[child] == pid or descends(parents[child]))

    return {child: seconds[child] for child in parents if descends(child)}


def of_workers(single: dict[str, Any], parallel: dict[str, Any], theirs: float, jobs: int) -> dict[str, float]:
    """Compare fits without and with workers. Model: one processor per worker, idle while the main process works."""
    assert single["sha256"] == parallel["sha256"]
    worker_s = parallel["cpu_s"]
    return {
        "asking_cpu_s": worker_s,
        "workers_cpu_s": theirs,
        "serial_share": worker_s / (worker_s + theirs),
        "sent_mb": parallel["sent_mb"],
        "asking_peak_gb": parallel["peak_gb"],
        f"wall_{jobs}_over_1": single["wall_s"] / parallel["wall_s"],
        **{f"model_{n}_over_1": single["cpu_s"] / (worker_s + theirs / n) for n in sorted({jobs, 64})},
    }


def main() -> None:
    """Print the measurements, then one JSON line."""
    args = timing.options(__doc__, "three configurations", configurations=1000, jobs=1, folder=Path)
    Q, F = (3, 30) if args.quick else (args.configurations, 200)
    print(timing.machine(), flush=True)
    with tempfile.TemporaryDirectory(dir=args.folder) as folder:
        path = Path(folder) / "frf.h5"
        in_process(write, path, Q, F)
        results, _ = in_process(fit, path, 1)
        if args.jobs > 1:
            results |= of_workers(results, *in_process(fit, path, args.jobs), args.jobs)
        results["file_gb"] = path.stat().st_size / 1e9
    print(json.dumps({name: round(v, 3) if isinstance(v, float) else v for name, v in results.items()}))


if __name__ == "__main__":
    main()
