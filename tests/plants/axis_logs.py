"""Logs of one elastic axis in HDF5, with a response that is known at every line."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from elastid.base.arrays import ComplexArray, FloatArray
from elastid.experiment.specs.channels import ChannelSpec
from elastid.experiment.specs.experiment import ExperimentSpec
from elastid.experiment.specs.recorded import FileSpec, RecordedSpec
from elastid.frf.estimate import estimate
from elastid.frf.spec import EstimatorSpec
from elastid.record import Record
from elastid.recorded.rig import RecordedRig
from elastid.robot import Body, Joint, Motor, Robot, Spring

N, P, RATE = 500, 6, 500.0


LINES = np.arange(3, 100)


ROBOT = Robot("one axis", (Body("arm", joints=(Joint("1", "z", Spring(1e3), Motor(1e-2)),), inertia=1.0),))


CHANNELS = (
    ChannelSpec("r", "motor 1", "r"),
    ChannelSpec("u", "motor 1", "u"),
    ChannelSpec("y", "motor 1", "y", quantity="position"),
)


def plant(freq_hz: FloatArray) -> ComplexArray:
    """Angle per torque with a resonance at 30 Hz of 4 % damping and an antiresonance at 20 Hz."""
    s = 2j * np.pi * freq_hz
    w, a = 2 * np.pi * 30, 2 * np.pi * 20
    return np.asarray(10 * (s**2 + 0.06 * a * s + a**2) / (s**2 * (s**2 + 0.08 * w * s + w**2)))


def log(t: FloatArray, seed: int = 0, noise: float = 0.0) -> dict[str, FloatArray]:
    """r, u (the loop turns and damps r) and y at times t, in samples of the generator's clock."""
    rng = np.random.default_rng(seed)
    R = np.exp(2j * np.pi * rng.random(len(LINES))) / np.sqrt(len(LINES))
    f = LINES * RATE / N
    U = R * (2j * np.pi * f) / (2j * np.pi * f + 2 * np.pi * 2)
    phasors = np.exp(2j * np.pi * np.outer(np.asarray(t) / N, LINES))
    signals = {name: (phasors @ X).real for name, X in (("r", R), ("u", U), ("y", U * plant(f)))}
    return {name: x + noise * x.std() * rng.normal(size=len(t)) for name, x in signals.items()}


CLEAN = log(np.arange(P * N), noise=1e-4)


def spec_of(path: str = "log.h5", **changes: Any) -> ExperimentSpec:
    keys: dict[str, Any] = {"rate_hz": RATE, "period_samples": N, "channels": CHANNELS}
    keys["files"] = (FileSpec(path, "home"),)
    return ExperimentSpec({"home": (0.0,)}, recorded=RecordedSpec(**(keys | changes)))


def measure(base: Path, spec: ExperimentSpec) -> Record:
    rig = RecordedRig(ROBOT, spec, base)
    return rig.measure(rig.experiments[0])


def write_log(path: Path, signals: Mapping[str, FloatArray]) -> None:
    """One dataset a channel."""
    with h5py.File(path, "w") as file:
        for name, values in signals.items():
            file[name] = values


def record_of(base: Path, signals: Mapping[str, FloatArray]) -> Record:
    write_log(base / "log.h5", signals)
    return measure(base, spec_of())


def error_of(record: Record) -> float:
    """The largest error of the response relative to the plant, at all lines."""
    response = estimate([record], EstimatorSpec(quantity="position"), LINES)
    assert response.n_lines == len(LINES)
    return float(np.max(np.abs(response.G[:, 0, 0] / plant(response.freq_hz) - 1)))
