"""Time and peak memory from a large HDF5 log to its response: measure and estimate, as a study does them.

    python scripts/benchmarks/large_record.py [--without-period] [--quick] [--megabytes MB] [--channels C] [--folder F]

A log of C channels (8) as single precision, 2 GB together (--quick: 40 MB): the torque and the angles of a motor and of
its load with noise, and other signals that the study does not ask for; the excitation repeats with 16384 samples.
--without-period: speeds instead of angles, white noise as torque, `period: none` in the study, and h1.
Stages run one after the other in processes of their own.
Two peaks: all memory that the process has (VmHWM), and the part that it holds for itself (RssAnon, sampled every
20 ms); the rest are pages of files, which go where another program needs the room. Linux only.
The last line is one JSON object with the numbers.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from itertools import islice
from pathlib import Path

import h5py
import numpy as np
from scipy.signal import cont2discrete, lfilter

N, RATE_HZ, BAND_LINES = 16384, 2000.0, 400
QUICK_BYTES, BYTES = 40 << 20, 2 << 30
STUDY = """\
name: large
robot: robot.yml
experiment:
  configurations: {bench: [0]}
  recorded:
    rate_hz: 2000
    period_samples: 16384
    channels:
      - {role: u, at: motor 1, channel: torque}
      - {role: y, at: motor 1, channel: motor, quantity: position}
      - {role: y, at: joint 1, channel: load, quantity: position}
    files:
      - {path: log.h5, configuration: bench}
fit:
  parameters: {k_1: {}}
"""
# In its place in a study without a period.
WITHOUT_PERIOD = {
    "period_samples: 16384": "period: none\n    hold: zero-order",
    "quantity: position": "quantity: velocity",
    "fit:": "estimator: {method: h1}\nfit:",
}
ROBOT = """\
name: one elastic joint
gravity: [0, 0, 0]
bodies:
  - name: load
    joints:
      - name: 1
        axis: z
        motor: {inertia: 1e-3, ratio: 1, viscous: 1e-3}
        spring: {stiffness: 50, damping: 0.01}
    inertia: 1e-3
"""


def repeating(rng: np.random.Generator) -> Iterator[np.ndarray]:
    """Torque, motor angle and load angle (3, N): one period again and again."""
    lines = np.arange(1, BAND_LINES + 1)
    s = 2j * np.pi * lines * RATE_HZ / N
    motor = (1e-3 * s**2 + 0.01 * s + 50) / (
        (1e-3 * s**2 + 1e-3 * s) * (1e-3 * s**2 + 0.01 * s + 50) + 1e-3 * s**2 * 50
    )
    U = np.exp(2j * np.pi * rng.uniform(size=BAND_LINES))
    spectrum = np.zeros((3, N // 2 + 1), dtype=complex)
    spectrum[:, lines] = [U, motor * U, motor * U * (0.01 * s + 50) / (1e-3 * s**2 + 0.01 * s + 50)]
    # So small that no angle turns.
    period = 1e-3 * np.fft.irfft(spectrum * N / 2, N)
    while True:
        yield period


def noise(rng: np.random.Generator) -> Iterator[np.ndarray]:
    """Torque, motor speed and load speed (3, N): white noise that is held, piece by piece."""
    load = np.array([1e-3, 0.01, 50])
    denominator = np.polyadd(np.polymul([1e-3, 1e-3], load), np.polymul([1e-3, 0], load[1:]))
    filters = []
    for numerator in (load, load[1:]):
        b, a, _ = cont2discrete((numerator, denominator), 1 / RATE_HZ)
        filters.append((b.ravel(), a))
    states = [np.zeros(len(a) - 1) for _, a in filters]
    while True:
        signals = np.empty((3, N))
        signals[0] = rng.standard_normal(N)
        for i, (b, a) in enumerate(filters):
            signals[i + 1], states[i] = lfilter(b, a, signals[0], zi=states[i])
        yield signals


def write_log(path: Path, size: int, channels: int, pieces: Iterator[np.ndarray], dtype: str = "float32") -> int:
    """The log, piece by piece; its samples."""
    rng = np.random.default_rng(1)
    count = size // (np.dtype(dtype).itemsize * channels * N)
    names = ["torque", "motor", "load", *(f"other_{i}" for i in range(channels - 3))]
    with h5py.File(path, "w") as file:
        datasets = [file.create_dataset(name, (count * N,), dtype=dtype) for name in names]
        for p, signals in enumerate(islice(pieces, count)):
            for i, dataset in enumerate(datasets):
                signal = signals[i] if i < len(signals) else np.zeros(N)
                scatter = 0.01 * (float(np.std(signal)) or 1.0) * rng.standard_normal(N)
                dataset[p * N : (p + 1) * N] = signal + scatter
    return count * N


def peaks_of(command: list[str], folder: Path) -> tuple[float, dict[str, int]]:
    """Seconds, and the largest memory in MB that a command had, and held for itself."""
    start, peaks = time.perf_counter(), {"VmHWM": 0, "RssAnon": 0}
    with subprocess.Popen(command, cwd=folder) as process:
        while process.poll() is None:
            try:
                status = Path(f"/proc/{process.pid}/status").read_text()
            except OSError:
                break
            for line in status.splitlines():
                name, _, value = line.partition(":")
                if name in peaks:
                    peaks[name] = max(peaks[name], int(value.split()[0]) // 1024)
            time.sleep(0.02)
    if process.returncode:
        raise SystemExit(f"{' '.join(command)} failed")
    return time.perf_counter() - start, peaks


def main(size: int, channels: int, without_period: bool, folder: Path) -> dict[str, float]:
    """The figures of both stages."""
    study, rng = STUDY, np.random.default_rng(0)
    for key, other in WITHOUT_PERIOD.items() if without_period else ():
        study = study.replace(key, other)
    (folder / "study.yml").write_text(study)
    (folder / "robot.yml").write_text(ROBOT)
    n = write_log(folder / "log.h5", size, channels, noise(rng) if without_period else repeating(rng))
    result: dict[str, float] = {"log_mb": (folder / "log.h5").stat().st_size / 2**20, "samples": n}
    for stage in ("measure", "estimate"):
        command = [sys.executable, "-m", "elastid", stage, "study.yml", "--jobs", "1"]
        seconds, peaks = peaks_of(command, folder)
        print(f"{stage:10} {seconds:8.1f} s {peaks['VmHWM']:8} MB, {peaks['RssAnon']:8} MB of its own")
        result |= {f"{stage}_s": round(seconds, 1), f"{stage}_mb": peaks["VmHWM"], f"{stage}_own_mb": peaks["RssAnon"]}
    return result


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true")
    parser.add_argument("--megabytes", type=int, default=BYTES >> 20, help="size of the log")
    parser.add_argument("--without-period", action="store_true", help="of the log; h1 estimates")
    parser.add_argument("--channels", type=int, default=8)
    parser.add_argument(
        "--folder", type=Path, default=None, help="for the files, instead of the one for temporary ones"
    )
    asked = parser.parse_args()
    size = QUICK_BYTES if asked.quick else asked.megabytes << 20
    with tempfile.TemporaryDirectory(dir=asked.folder) as temporary:
        print(json.dumps(main(size, asked.channels, asked.without_period, Path(temporary))))
