"""Logs of one axis whose friction is known, as lab files: motor side, in A and deg, with a thermometer."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from elastid.base.arrays import FloatArray
from elastid.experiment.specs.channels import ChannelSpec
from elastid.experiment.specs.experiment import ExperimentSpec
from elastid.experiment.specs.logs import FileSpec, RecordedSpec
from elastid.robot import Body, Joint, Motor, Robot
from elastid.study.robots import yaml_text

RATE, RATIO, TORQUE_CONSTANT = 500.0, 100.0, 0.5
# Link side: Coulomb and viscous friction, rotor and arm, gravity, ripple of a motor turn, offset.
COULOMB, VISCOUS, INERTIA, GRAVITY, RIPPLE, OFFSET = 12.0, 20.0, 15.0, 30.0, 0.3, 1.0

ROBOT = Robot(
    "one axis",
    (
        Body(
            "arm",
            joints=(Joint("1", "y", motor=Motor(1e-3, RATIO)),),
            mass=10.0,
            center_of_mass=(GRAVITY / 98.1, 0.0, 0.0),
            inertia=INERTIA - 10.0 - 10.0 * (GRAVITY / 98.1) ** 2,
        ),
    ),
)
CHANNELS = (
    ChannelSpec("u", "motor 1", "current", quantity="current", unit="A", torque_constant=TORQUE_CONSTANT, side="motor"),
    ChannelSpec("y", "motor 1", "angle", quantity="position", unit="deg", side="motor"),
)
THERMOMETER = ChannelSpec("t", "joint 1", "temperature", quantity="temperature")


def trapezoids(speeds: Sequence[float], travel: float = 0.8, rate_hz: float = RATE) -> FloatArray:
    """Position (n,) of passes there and back, one speed after the other, at rest between them."""
    rest = np.zeros(round(0.3 * rate_hz))
    parts = [rest]
    for speed in speeds:
        n_ramp, n_flat = round(speed / 4.0 * rate_hz), max(0, round((travel / speed - speed / 4.0) * rate_hz))
        x = (np.arange(n_ramp) + 0.5) / max(n_ramp, 1)
        rise = x**3 * (10 - 15 * x + 6 * x**2)
        way = speed * np.concatenate([rise, np.ones(n_flat), rise[::-1], rest])
        parts += [way, -way]
    return np.cumsum(np.concatenate(parts)) / rate_hz


def sliding_torque(q: FloatArray, seed: int = 0) -> FloatArray:
    """Link-side torque (n,) of a motion: inertia, friction, gravity, ripple, offset and noise."""
    v = np.gradient(q, 1 / RATE)
    rest = np.abs(v) < 1e-6
    friction = np.where(rest, 0.0, COULOMB * np.sign(v)) + VISCOUS * v
    known = INERTIA * np.gradient(v, 1 / RATE) - GRAVITY * np.cos(q) + RIPPLE * np.sin(RATIO * q) + OFFSET
    return friction + known + 0.3 * np.random.default_rng(seed).standard_normal(len(q))


def write_log(path: Path, q: FloatArray, torque: FloatArray, temperature: FloatArray | None = None) -> None:
    """A CSV of motor current (A), motor angle (deg, 16 bit a turn) and temperature."""
    counts = np.round(q * RATIO / (2 * np.pi) * 65536)
    columns = {"current": torque / RATIO / TORQUE_CONSTANT, "angle": counts * 360 / 65536}
    columns |= {} if temperature is None else {"temperature": temperature}
    rows = "\n".join(",".join(f"{x:.9g}" for x in row) for row in zip(*columns.values(), strict=True))
    path.write_text(",".join(columns) + "\n" + rows + "\n")


def logs(*files: FileSpec, channels: tuple[ChannelSpec, ...] = CHANNELS, **changes: Any) -> ExperimentSpec:
    return ExperimentSpec(recorded=RecordedSpec(RATE, channels, files, **changes))


# The same as a study, of files that a user has.
STUDY = """
name: axis
robot: robot.yml
friction: {{constant_velocity: {constant_velocity}, law: {{temperature: {temperature}}}, loads: [{{name: empty}}]}}
experiment:
  recorded:
    rate_hz: {rate_hz:g}
    channels:
      - {{role: u, at: motor 1, channel: current, quantity: current, unit: A, {constant}side: {torque_side}}}
      - {{role: y, at: motor 1, channel: angle, quantity: position, unit: deg, side: {angle_side}}}
      {thermometer}
    files:
{files}
"""
THERMOMETER_LINE = "- {role: t, at: joint 1, channel: temperature, quantity: temperature}"
SPEEDS = (0.03, 0.1, 0.2, 0.4, 0.6, 0.9)


def write_study(
    folder: Path, entries: Sequence[str] = ("{path: log.csv}",), rate_hz: float = RATE, **keys: str
) -> Path:
    """The path of a study of logs, in the folder, with its robot."""
    defaults = {
        "temperature": "auto",
        "constant_velocity": "detect",
        "constant": "torque_constant: 0.5 N*m/A, ",
        "torque_side": "motor",
        "angle_side": "motor",
        "thermometer": "",
        "files": "\n".join(f"      - {log}" for log in entries),
    }
    (folder / "robot.yml").write_text(yaml_text(ROBOT))
    (folder / "study.yml").write_text(STUDY.format(rate_hz=rate_hz, **(defaults | keys)))
    return folder / "study.yml"
