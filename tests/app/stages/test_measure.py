"""A large log costs `measure` little more than its own bytes, on the disk and in memory."""

import subprocess
import sys
from pathlib import Path

import h5py
import numpy as np
import pytest
from plants.runs import summary_of

from elastid.app import cli

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
subprocess.run([sys.executable, "-m", "elastid", "run", "study.yml", "measure", "--jobs", "1", "-q"], check=True)
print(resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss)
"""


@pytest.mark.slow
@pytest.mark.skipif(sys.platform != "linux", reason="ru_maxrss is in kB on Linux alone")
def test_memory_does_not_grow_with_the_log(tmp_path: Path) -> None:
    """A log of 0.4 GB, 0.31 GB of it asked for, is measured with 200 MB."""
    asked = _write(tmp_path, 1600)
    done = subprocess.run([sys.executable, "-c", START], cwd=tmp_path, capture_output=True, text=True, check=True)
    (records,), peak = (tmp_path / "runs").rglob("records.h5"), int(done.stdout) * 1024
    assert asked < records.stat().st_size < asked + 64 * 1024
    assert peak < 200e6 < asked / 1.5


FRAME = "frames: [{name: tool, body: load, placement: {xyz: [0.4, 0, 0]}}]\n"
LISTED = """\
loads:
  file: loads.csv
  tests:
    - {configuration: a, force: [0, 30, 0], mass: 2 kg, along: y, std: 1 um}
    - {angles: [10 deg], torque: [0, 0, 5], frame: load, measured_at: tool, std: [1e-6, 1e-6, 1e-6]}
"""
TOOL = """\
validation:
  configurations: [b]
  tool:
    motors: locked
    responses:
      files: [{path: hammer.csv, configuration: b}]
      channels:
        - {role: u, at: force tool y, quantity: force, column: 1}
        - {role: y, at: frame tool y, quantity: acceleration, column: 1}
      relative_std: 0.02
"""
TAPPED = """\
tool:
  motors: controlled
  stiffness: [40]
  damping: [0.02 N*m*s/rad]
  responses:
    files: [{path: tapped.csv, configuration: a}]
    channels:
      - {role: u, at: force tool y, quantity: force, column: 1}
      - {role: y, at: frame tool y, quantity: acceleration, column: 1, sign: -1}
    relative_std: 0.02
"""
CSV = "configuration,fx,fy [N],fz,along_x,along_y,along_z,deflection [mm],std [um]\nb,10,0,0,1,0,0,,1\n"


@pytest.mark.slow
def test_a_study_with_load_tests_and_a_hammer(tiny: Path) -> None:
    """The simulated rig measures the deflections; the hammer's response is predicted."""
    robot = tiny.parent / "robot.yml"
    robot.write_text(robot.read_text() + FRAME)
    tiny.write_text(tiny.read_text() + LISTED + TOOL + TAPPED)
    (tiny.parent / "loads.csv").write_text(CSV)
    f = np.linspace(5, 80, 60)
    s = 2j * np.pi * f
    G = s**2 * 0.4**2 / (1e-3 * s**2 + 0.01 * s + 60)
    # The motor turns, too: 1e-3 s^2 + 1e-3 s, its drive, and the spring to the load.
    spring, drive = 0.01 * s + 60, 1e-3 * s**2 + 1e-3 * s + 0.02 * s + 40
    controlled = s**2 * 0.4**2 / (1e-3 * s**2 + spring - spring**2 / (drive + spring))
    for name, response in (("hammer", G), ("tapped", -controlled)):
        rows = np.column_stack([f, response.real, response.imag])
        np.savetxt(tiny.parent / f"{name}.csv", rows, delimiter=",", header="freq_hz,re_1_1,im_1_1", comments="")
    folder = tiny.parent / "run"
    assert cli.run_command(["run", str(tiny), "--run", str(folder)]) == 0
    summary = summary_of(folder)
    loads = summary["static_loads"]
    assert [each["configuration"] for each in loads["readings"]] == ["a", "load test", "load test", "load test", "b"]
    turned = 0.0
    for _ in range(50):  # 60 N m/rad hold 30 N at 0.4 m
        turned = 0.4 * 30 * np.cos(turned) / 60
    assert abs(loads["readings"][0]["measured"] - 0.4 * np.sin(turned)) < 5e-6
    assert loads["cause"] == ""
    predictions = summary_of(folder, "validation.json")["predictions"]
    keys = [(each["configuration"], each["motors"], each["is_fitted"]) for each in predictions]
    assert keys == [("b", "locked", False), ("a", "controlled", True)]
    assert min(each["inside"] for each in predictions) > 0.9
    at_tool = summary["tool_responses"]
    assert at_tool["cause"] == ""
    assert abs(at_tool["ratio"] - 1) < 3 * at_tool["ratio_std"]
    assert [each["configuration"] for each in at_tool["responses"]] == ["a at the tool"]
