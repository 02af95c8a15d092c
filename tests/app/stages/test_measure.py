"""A large log costs `measure` little more than its own bytes, on the disk and in memory."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import h5py
import numpy as np
import pytest

from elastid.store.measured import read_records

N, NAMES = 16384, ("torque", "motor", "load")
STUDY = """\
name: large
robot:
  name: one joint
  gravity: [0, 0, 0]
  bodies:
    - name: load
      inertia: 1e-3
      joints:
        - {name: 1, axis: z, motor: {inertia: 1e-3, ratio: 1}, spring: {stiffness: 50, damping: 0.01}}
fit: {parameters: {k_1: {}}}
experiment:
  configurations: {bench: [0]}
  recorded:
    rate_hz: 2000
    period_samples: 16384
    channels:
      - {role: u, at: motor 1, channel: torque}
      - {role: y, at: motor 1, channel: motor, quantity: position, unit: deg}
      - {role: y, at: joint 1, channel: load, quantity: position, unit: deg}
    files: [{path: log.h5, configuration: bench}]
"""


def _write(folder: Path, periods: int) -> int:
    """A study, and its log in single precision with a channel that is not asked for; bytes of those that are."""
    rng, t = np.random.default_rng(0), 2 * np.pi * np.arange(N) / N
    (folder / "study.yml").write_text(STUDY)
    shapes = [sum(np.cos(k * t + k * k + c) / k for k in range(1, 40)) for c in range(4)]
    noise = 0.01 * rng.standard_normal((4, 16 * N))
    with h5py.File(folder / "log.h5", "w") as file:
        for name, shape, of_channel in zip((*NAMES, "other"), shapes, noise, strict=True):
            dataset = file.create_dataset(name, (periods * N,), np.float32)
            for p in range(periods):
                # Noise that does not repeat with the pieces.
                start = int(rng.integers(15 * N))
                dataset[p * N : (p + 1) * N] = shape + of_channel[start : start + N]
    return 4 * len(NAMES) * periods * N


# Peak memory counts what a process had before it became another one, as a copy of this one has: a small one starts it.
START = """
import resource, subprocess, sys
subprocess.run([sys.executable, "-m", "elastid", "measure", "study.yml", "--jobs", "1", "-q"], check=True)
print(resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss)
"""


def _measure(folder: Path) -> tuple[Path, int]:
    """records.h5 of a process of its own, and its peak memory in bytes."""
    done = subprocess.run([sys.executable, "-c", START], cwd=folder, capture_output=True, text=True, check=True)
    (records,) = (folder / "runs").rglob("records.h5")
    return records, int(done.stdout) * 1024


@pytest.mark.slow
def test_single_precision_is_written_once_and_stays_what_it_is(tmp_path: Path) -> None:
    """No times, no doubles, no channel that is not asked for; a spike is repaired, the rest is the log's own."""
    asked = _write(tmp_path, 86)
    with h5py.File(tmp_path / "log.h5", "r+") as file:
        file["load"][50 * N + 77] += 3
        load = file["load"][:]
    records, _ = _measure(tmp_path)
    assert asked < records.stat().st_size < asked + 64 * 1024
    with h5py.File(records) as file:
        (record,) = (group for name, group in file["records"].items() if name != "%names")
        assert {record[role].dtype for role in ("u", "y")} == {np.dtype(np.float32)}
        stored = record["y"][:, 1]
    changed = np.flatnonzero(stored != np.deg2rad(load.astype(np.float64)).astype(np.float32))
    assert changed.tolist() == [50 * N + 77]
    (measured,) = read_records(records)
    assert measured.repairs == {"spikes replaced": 1}


@pytest.mark.slow
@pytest.mark.skipif(sys.platform != "linux", reason="ru_maxrss is in kB on Linux alone")
def test_memory_does_not_grow_with_the_log(tmp_path: Path) -> None:
    """A log of 1.2 GB, 0.9 GB of it asked for, is measured with 300 MB."""
    asked = _write(tmp_path, 4800)
    records, peak = _measure(tmp_path)
    assert asked < records.stat().st_size < asked + 64 * 1024
    assert peak < 300e6 < asked / 3
