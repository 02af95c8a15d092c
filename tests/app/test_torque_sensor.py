"""A torque sensor behind the gear as the input: k and d without the friction in front of it."""

from pathlib import Path

import numpy as np
import pytest
from plants.drafts import drafted, save
from plants.refusals import refused
from plants.runs import summary_of

from elastid.app.cli import run_command
from elastid.study import load_with_logs

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
    save(folder / f"{realisation}.csv", "torque,motor,joint", signals)


def test_sensor_sign_is_the_one_of_the_motor_torque(tmp_path: Path) -> None:
    """`new` writes it; `check` reports a study with the other one at the line of the sensor."""
    study, path = drafted(tmp_path, arm_log(tmp_path, scale=-1.0)), tmp_path / "new" / "study.yml"
    assert [c.sign for c in study.experiment.as_recorded().channels if c.role == "d"] == [1, 1]
    lines = path.read_text().splitlines()
    number = next(i for i, line in enumerate(lines, start=1) if "role: d" in line)
    lines[number - 1] = lines[number - 1].replace("N*m}", "N*m, sign: -1}")
    path.write_text("\n".join(lines))
    with refused("study/invalid", holds=f"study.yml:{number}:"):
        load_with_logs(path)


def test_sensors_of_unknown_size_are_not_used(tmp_path: Path) -> None:
    """Unit, side and ratio of sensor or motor may be the reason, and nothing shows which of them."""
    study = drafted(tmp_path, arm_log(tmp_path, scale=1e3))
    assert not [c for c in study.experiment.as_recorded().channels if c.role == "d"]
    assert "times torque_sensor_1" in (tmp_path / "new" / "study.yml").read_text()


@pytest.mark.slow
def test_friction_before_torque_sensor_leaves_stiffness_and_damping(tmp_path: Path) -> None:
    """Inside their intervals, within 0.1 and 1 %, with a third of the torque lost in friction; the motor is unknown."""
    for realisation in (1, 2):
        write_log(tmp_path, realisation, friction=3.0)
    (tmp_path / "robot.yml").write_text(ROBOT)
    (tmp_path / "study.yml").write_text(STUDY)
    assert run_command(["run", str(tmp_path / "study.yml"), "-q", "--jobs", "1", "--run", str(tmp_path / "run")]) == 0
    summary = summary_of(tmp_path / "run")
    assert summary["status"] == "converged"
    for name, truth, limit in (("k_1", K, 1e-3), ("d_1", D, 1e-2)):
        estimate = summary["parameters"][name]
        assert estimate["value"] == pytest.approx(truth, rel=limit)
        assert abs(estimate["value"] - truth) < 3 * estimate["std"]


TORQUES = {"coulomb": (0.9, 0.5), "viscous": (0.3, 0.2), "armature": (0.05, 0.03)}  # in front of the sensors


def arm_log(folder: Path, scale: float = 1.0) -> Path:
    """A planar arm under gravity: torques of its motors, and of sensors behind their gears, which carry the links.

    scale: of the numbers of the sensors.
    """
    rng, t = np.random.default_rng(0), np.arange(0, 40, 1 / 500)
    q, v, a = np.zeros((3, 2, len(t)))
    for k in range(2):
        w = 2 * np.pi * np.array([0.11, 0.23, 0.41]) * (1 + 0.17 * k)
        wave = np.exp(1j * (np.outer(w, t) + rng.uniform(0, 6, (3, 1))))
        q[k], v[k], a[k] = (np.array([0.6, 0.3, 0.1]) @ ((1j * w[:, None]) ** m * wave).imag for m in range(3))
    # Torques of the links: masses of 1.2 and 0.6 kg, 0.25 m apart, at 0.12 and 0.10 m.
    h, b12 = 0.015 * np.sin(q[1]), 0.009 + 0.015 * np.cos(q[1])
    g2 = 0.6 * 0.10 * 9.81 * np.cos(q[0] + q[1])
    links = np.stack([
        (0.06378 + 0.03 * np.cos(q[1])) * a[0] + b12 * a[1] - h * (2 * v[0] * v[1] + v[1] ** 2)
        + (1.2 * 0.12 + 0.6 * 0.25) * 9.81 * np.cos(q[0]) + g2,
        b12 * a[0] + 0.009 * a[1] + h * v[0] ** 2 + g2,
    ])  # fmt: skip
    friction = np.stack(
        [F * np.tanh(x / 1e-3) + f * x for F, f, x in zip(TORQUES["coulomb"], TORQUES["viscous"], v, strict=True)]
    )
    motors = links + np.array(TORQUES["armature"])[:, None] * a + friction
    torques = np.vstack([motors, links]) + 0.01 * rng.standard_normal((4, len(t)))
    torques[2:] *= scale
    angles = (q + 1e-5 * rng.standard_normal(q.shape)).T
    head = "time,motor_torque_1,motor_torque_2,q_1,q_2,torque_sensor_1,torque_sensor_2"
    return save(folder / "arm.csv", head, t, torques[:2].T, angles, torques[2:].T)


def test_sensors_next_to_motor_torques_are_found(tmp_path: Path) -> None:
    """Each with the sign of the torque that the links exert on the motor."""
    channels = drafted(tmp_path, arm_log(tmp_path)).experiment.as_recorded().channels
    sensors = [(c.at, c.channel, c.sign) for c in channels if c.role == "d"]
    assert sensors == [(f"motor {i}", f"torque_sensor_{i}", -1) for i in (1, 2)]
    assert len([c for c in channels if c.role == "u"]) == 2


@pytest.mark.slow
def test_friction_before_sensor_needs_no_link_model(tmp_path: Path) -> None:
    """Coulomb and viscous friction of both joints within 1 %; the links and gravity are in the sensors' torques."""
    drafted(tmp_path, arm_log(tmp_path))
    assert run_command(["run", str(tmp_path / "new" / "study.yml"), "-q", "--run", str(tmp_path / "run")]) == 0
    summary = summary_of(tmp_path / "run")
    assert summary["status"] == "identified"
    for name, term in (("Fc", "coulomb"), ("f", "viscous")):
        for i, truth in enumerate(TORQUES[term], start=1):
            estimate = summary["parameters"][f"{name}_m{i}"]
            assert estimate["value"] == pytest.approx(truth, rel=0.01)
            assert estimate["interval95"][0] <= truth <= estimate["interval95"][1]
