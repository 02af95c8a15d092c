"""What `measure` costs on a large HDF5 log, relative to reading it: time, bytes written and peak memory.

    python scripts/benchmarks/records.py [--quick] [--megabytes MB] [--channels C] [--cases periodic noise double]
        [--folder F]

The logs of large_record.py, 300 MB (--quick: 10 MB, without a period) of C channels (3), of which the study asks for
the first three: torque and two angles. Cases: `periodic` and `noise` (without a period) in single precision, `double`
periodic in double precision.
Time: CPU and wall clock of `python -m elastid measure --jobs 1`, a process of its own, over those of another one that
reads the same channels with h5py; both from the disk (pages dropped before) and, for the CPU time, from memory. Rate:
CPU time per value less that of a log of a tenth of the size, so that starting Python does not count.
Bytes: records.h5, and all that the process wrote to the disk, over the bytes of the channels asked for. Memory:
ru_maxrss of the process.
The last line is one JSON object with the numbers.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from large_record import ROBOT, STUDY, WITHOUT_PERIOD, noise, repeating, write_log

ASKED = 3
READ = "import h5py; file = h5py.File('log.h5'); [file[name][:] for name in ('torque', 'motor', 'load')]"
IMPORT = "import h5py"


@dataclass(frozen=True)
class Cost:
    """CPU and wall-clock time in s, bytes written to the disk, and peak memory in MB of a process."""

    cpu_s: float
    wall_s: float
    written: int
    peak_mb: float


def cost(command: list[str], folder: Path, cold: bool) -> Cost:
    """Cost of a command; cold: its log is not in memory before."""
    if cold:
        with (folder / "log.h5").open("rb") as file:
            os.fsync(file.fileno())
            os.posix_fadvise(file.fileno(), 0, 0, os.POSIX_FADV_DONTNEED)
    begin = time.perf_counter()
    process = subprocess.Popen(command, cwd=folder, stdout=subprocess.DEVNULL)
    _, status, usage = os.wait4(process.pid, 0)
    process.returncode = os.waitstatus_to_exitcode(status)
    if process.returncode:
        raise SystemExit(f"{' '.join(command)} failed")
    wall_s = time.perf_counter() - begin
    return Cost(usage.ru_utime + usage.ru_stime, wall_s, 512 * usage.ru_oublock, usage.ru_maxrss / 1024)


def prepare(folder: Path, case: str, size: int, channels: int) -> int:
    """A study and its log; the bytes of the channels that it asks for."""
    study, rng = STUDY, np.random.default_rng(0)
    for key, other in WITHOUT_PERIOD.items() if case == "noise" else ():
        study = study.replace(key, other)
    folder.mkdir()
    (folder / "study.yml").write_text(study)
    (folder / "robot.yml").write_text(ROBOT)
    dtype = "float64" if case == "double" else "float32"
    signals = noise(rng) if case == "noise" else repeating(rng)
    return ASKED * np.dtype(dtype).itemsize * write_log(folder / "log.h5", size, channels, signals, dtype)


def figures(folder: Path, case: str, size: int, channels: int) -> dict[str, float]:
    """The ratios of one case."""
    large, small = folder / case, folder / f"{case}-small"
    asked, asked_small = (prepare(each, case, n, channels) for each, n in ((large, size), (small, size // 10)))
    measure, read = [sys.executable, "-m", "elastid", "measure", "study.yml", "--jobs", "1"], [sys.executable, "-c"]
    started = cost([*read, IMPORT], large, cold=False)
    cold_read, warm_read = (cost([*read, READ], large, cold) for cold in (True, False))
    done = cost(measure, large, cold=True)
    small_done = cost(measure, small, cold=False)
    (records,) = (large / "runs").rglob("records.h5")
    itemsize = 8 if case == "double" else 4
    return {
        "asked_mb": round(asked / 2**20, 1),
        "cpu_over_read": round(done.cpu_s / max(cold_read.cpu_s - started.cpu_s, 1e-3), 1),
        "wall_over_cold_read": round(done.wall_s / max(cold_read.wall_s - started.wall_s, 1e-3), 1),
        "wall_over_warm_read": round(done.wall_s / max(warm_read.wall_s - started.wall_s, 1e-3), 1),
        "ns_per_value": round(1e9 * (done.cpu_s - small_done.cpu_s) * itemsize / (asked - asked_small), 1),
        "file_over_asked": round(records.stat().st_size / asked, 3),
        "written_over_asked": round(done.written / asked, 3),
        "peak_mb": round(done.peak_mb),
        "cpu_s": round(done.cpu_s, 1),
        "wall_s": round(done.wall_s, 1),
        "cold_read_s": round(cold_read.wall_s - started.wall_s, 2),
    }


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="one log of 10 MB")
    parser.add_argument("--megabytes", type=int, default=300, help="size of the log")
    parser.add_argument("--channels", type=int, default=ASKED, help="in the log")
    parser.add_argument("--cases", nargs="+", default=["periodic", "noise", "double"])
    parser.add_argument("--folder", type=Path, default=None, help="for the files")
    given = parser.parse_args()
    megabytes, cases = (10, ["noise"]) if given.quick else (given.megabytes, given.cases)
    result = {}
    with tempfile.TemporaryDirectory(dir=given.folder) as temporary:
        for case in cases:
            result[case] = figures(Path(temporary), case, megabytes << 20, given.channels)
            print(case, *(f"{name} {value}" for name, value in result[case].items()), sep="\n  ")
    print(json.dumps(result))
