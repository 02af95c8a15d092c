"""A torque sensor behind the gear as the input: k and d without the friction in front of it."""

import json
from pathlib import Path

import numpy as np
import pytest

from elastid.app.cli import run_command

RATE, N, PERIODS = 1000, 4000, 5
K, D, INERTIA, VISCOUS = 20e3, 15.0, 1.8, 0.5  # of the spring, the link and its bearing
MOTOR = 1.2  # kg*m^2, which the study does not know

ROBOT = """
name: joint with a torque sensor
gravity: [0, 0, -9.81]
tolerances: exact
bodies:
  - name: link
    parent: base
    mass: 5
    inertia: [1.8, 1.8, 1.8]
    joints:
      - {name: 1, axis: z, viscous: 0.5, motor: {inertia: 1.0e-8}, spring: {stiffness: 15 kN*m/rad, damping: 10}}
"""
STUDY = """
name: sensor
robot: robot.yml
experiment:
  recorded:
    rate_hz: 1000
    period: 4 s
    channels:
      - {role: u, at: motor 1, channel: torque}
      - {role: y, at: motor 1, channel: motor, quantity: position}
      - {role: y, at: joint 1, channel: joint, quantity: position}
    files: [{path: 1.csv, configuration: c1}, {path: 2.csv, configuration: c1, realisation: 2}]
  configurations: {c1: [0]}
"""


def write_log(folder: Path, realisation: int, friction: float) -> None:
    """Angles and sensor torque; `friction`: rms of a torque at the motor that repeats in no period."""
    rng, n = np.random.default_rng(realisation), N * PERIODS
    s = 2j * np.pi * np.fft.rfftfreq(n, 1 / RATE)
    u = np.zeros(len(s), complex)
    u[PERIODS * np.arange(8, 320, 4)] = np.exp(2j * np.pi * rng.random(78))
    band = (np.abs(s) > 2 * np.pi) & (np.abs(s) < 2 * np.pi * 150)
    f = np.where(band, rng.normal(size=(2, len(s))).T @ [1, 1j], 0)
    spring, link = K + s * D, INERTIA * s**2 + VISCOUS * s
    sizes = (np.std(np.fft.irfft(x, n)) for x in (u, f))
    torque = 10 * u / next(sizes) - friction * f / next(sizes)
    # The loop of the drive, 4000 N*m/rad and 300 N*m*s/rad, closed around the motor.
    motor = torque / (MOTOR * s**2 + 4000 + 300 * s + np.divide(spring * link, spring + link, where=s != 0, out=0 * s))
    joint = motor * spring / (spring + link)
    signals = np.stack([np.fft.irfft(x, n) for x in (spring * (motor - joint), motor, joint)], axis=1)
    signals += rng.normal(size=signals.shape) * [0.02, 1e-7, 1e-7]
    np.savetxt(folder / f"{realisation}.csv", signals, delimiter=",", header="torque,motor,joint", comments="")


@pytest.mark.slow
def test_friction_in_front_of_the_sensor_does_not_move_stiffness_and_damping(tmp_path: Path) -> None:
    """Inside their intervals, within 0.1 and 1 %, with a third of the torque lost in friction; the motor is unknown."""
    for realisation in (1, 2):
        write_log(tmp_path, realisation, friction=3.0)
    (tmp_path / "robot.yml").write_text(ROBOT)
    (tmp_path / "study.yml").write_text(STUDY)
    assert run_command(["run", str(tmp_path / "study.yml"), "-q", "--jobs", "1", "--run", str(tmp_path / "run")]) == 0
    summary = json.loads((tmp_path / "run" / "summary.json").read_text())
    assert summary["status"] == "converged"
    for name, truth, limit in (("k_1", K, 1e-3), ("d_1", D, 1e-2)):
        estimate = summary["parameters"][name]
        assert estimate["value"] == pytest.approx(truth, rel=limit)
        assert abs(estimate["value"] - truth) < 3 * estimate["std"]
