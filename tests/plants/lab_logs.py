"""A log of two axes in every format, and the study that reads it."""

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np

from elastid.excitation.multisine import orthogonal_set
from elastid.experiment.specs.channels import ChannelSpec
from elastid.experiment.specs.experiment import ExperimentSpec
from elastid.experiment.specs.logs import FileSpec, RecordedSpec
from elastid.logs.rig import RecordedRig
from elastid.record import Record
from elastid.robot import Body, Joint, Motor, Robot, Spring

Signals: TypeAlias = dict[str, np.ndarray]  # samples by channel
N, P, RATE, RATIO = 200, 4, 100.0, -50.0
ROBOT = Robot(
    "two axes",
    (
        Body("turret", joints=(Joint("1", motor=Motor(1e-3, RATIO), spring=Spring(1e5)),), inertia=1.0),
        Body("arm", "turret", joints=(Joint("2", "y", Spring(1e5), Motor(1e-3)),), inertia=1.0),
    ),
)


# Currents of both motors in mA and motor side, the angle of motor 1 in deg and motor side, the speed of joint 2.
CURRENT = {"role": "u", "quantity": "current", "unit": "mA", "torque_constant": 0.5, "side": "motor"}


CHANNELS = (
    ChannelSpec(at="motor 2", channel="i2", sign=-1, **CURRENT),
    ChannelSpec(at="motor 1", channel="i1", **CURRENT),
    ChannelSpec("y", "motor 1", "phi", quantity="position", unit="deg", side="motor"),
    ChannelSpec("y", "joint 2", "w2", quantity="velocity", scale=0.1),
)


def multisines(lines: np.ndarray, T: float, n: int) -> Signals:
    """Four orthogonal multisines (n,) with a period of T samples, by channel."""
    U = orthogonal_set(np.ones((len(lines), 4)), np.random.default_rng(0))[0]
    x = (np.exp(2j * np.pi * np.outer(np.arange(n) / T, lines)) @ U).real
    return dict(zip(("i1", "i2", "phi", "w2"), x.T, strict=True))


def study_of(path: str, channels: tuple[ChannelSpec, ...] = CHANNELS, **changes: Any) -> ExperimentSpec:
    keys = {"rate_hz": RATE, "period_samples": N, "channels": channels, "files": (FileSpec(path, "home"),)}
    return ExperimentSpec({"home": (0.0, 0.0)}, recorded=RecordedSpec(**(keys | changes)))


def measured(base: Path, spec: ExperimentSpec, robot: Robot = ROBOT) -> Record:
    rig = RecordedRig(robot, spec, base)
    return rig.measure(rig.experiments[0])


def save_csv(
    path: Path, log: Mapping[str, np.ndarray], delimiter: str = ",", head: str = "", comma: bool = False
) -> None:
    rows = [delimiter.join(f"{v:.17g}" for v in row) for row in zip(*log.values(), strict=True)]
    text = head + delimiter.join(log) + "\n" + "\n".join(rows) + "\n"
    path.write_text(text.replace(".", ",") if comma else text)


def record_of(
    base: Path, log: Mapping[str, np.ndarray], channels: tuple[ChannelSpec, ...] = CHANNELS, **changes: Any
) -> Record:
    """The record of a log that is written as CSV."""
    save_csv(base / "log.csv", log)
    return measured(base, study_of("log.csv", channels, **changes))


def with_names(names: Mapping[str, str], **same: Any) -> tuple[ChannelSpec, ...]:
    return tuple(replace(c, channel=names[c.channel], **same) for c in CHANNELS)


def write_csv(base: Path, log: Signals) -> ExperimentSpec:
    save_csv(base / "log.csv", {"t": np.arange(len(log["i1"])) / RATE} | log)
    return study_of("log.csv")


U, Y = CHANNELS[1], CHANNELS[2]
