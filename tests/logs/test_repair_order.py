"""Logs with the faults of a real robot, and channels of several files and rates: as exact as the clean log."""

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
from plants.lab_logs import measured
from plants.notes import said
from plants.refusals import refused

from elastid.base.arrays import ComplexArray, FloatArray
from elastid.experiment.specs.channels import ChannelSpec
from elastid.experiment.specs.experiment import ExperimentSpec
from elastid.experiment.specs.logs import FileSpec, RecordedSpec
from elastid.frf.estimate import estimate
from elastid.frf.spec import EstimatorSpec
from elastid.record import Record
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
    return 10 * (s**2 + 0.06 * a * s + a**2) / (s**2 * (s**2 + 0.08 * w * s + w**2))


def log(t: FloatArray, noise: float = 0.0) -> dict[str, FloatArray]:
    """r, u (the loop turns and damps r) and y at times t, in samples of the generator's clock."""
    rng = np.random.default_rng(0)
    R = np.exp(2j * np.pi * rng.random(len(LINES))) / np.sqrt(len(LINES))
    f = LINES * RATE / N
    U = R * (2j * np.pi * f) / (2j * np.pi * f + 2 * np.pi * 2)
    phasors = np.exp(2j * np.pi * np.outer(np.asarray(t) / N, LINES))
    signals = {name: (phasors @ X).real for name, X in (("r", R), ("u", U), ("y", U * plant(f)))}
    return {name: x + noise * x.std() * rng.normal(size=len(t)) for name, x in signals.items()}


CLEAN = log(np.arange(P * N), noise=1e-4)


def spec_of(**changes: Any) -> ExperimentSpec:
    keys = {"rate_hz": RATE, "period_samples": N, "channels": CHANNELS}
    keys["files"] = (FileSpec("log.h5", "home"),)
    return ExperimentSpec({"home": (0.0,)}, recorded=RecordedSpec(**(keys | changes)))


def write_log(path: Path, signals: Mapping[str, FloatArray]) -> None:
    with h5py.File(path, "w") as file:
        for name, values in signals.items():
            file[name] = values


def record_of(base: Path, signals: Mapping[str, FloatArray]) -> Record:
    write_log(base / "log.h5", signals)
    return measured(base, spec_of(), ROBOT)


def error_of(record: Record) -> float:
    """The largest error of the response relative to the plant, at all lines."""
    response = estimate([record], EstimatorSpec(quantity="position"), LINES)
    assert response.n_lines == len(LINES)
    return float(np.max(np.abs(response.G[:, 0, 0] / plant(response.freq_hz) - 1)))


AT_ONCE = np.random.default_rng(7)


@pytest.mark.parametrize("ppm", [40.0, -120.0])
def test_two_logs_whose_clocks_differ_are_brought_to_one(ppm: float, tmp_path: Path) -> None:
    """y and r by a second logger without stamps: 40 ppm turn a line at 100 Hz by 9 degrees in six seconds."""
    other = log(np.arange(P * N) * (1 + 1e-6 * ppm) - 12.3, noise=1e-4)
    write_log(tmp_path / "log.h5", {"t": np.arange(P * N) / RATE, "r": CLEAN["r"], "u": CLEAN["u"]})
    write_log(tmp_path / "encoder.h5", {"r": other["r"], "y": other["y"]})
    channels = (*CHANNELS[:2], replace(CHANNELS[0], file=2), replace(CHANNELS[2], file=2))
    files = (FileSpec("log.h5", "home", also=("encoder.h5",)),)
    record = measured(tmp_path, spec_of(channels=channels, files=files, time="t"), ROBOT)
    clock = next(note for note in said(record.notes) if "clocks of encoder.h5 and log.h5 differ" in note)
    assert abs(float(clock.split("by ")[1].split()[0]) + ppm) < 2
    assert error_of(record) < 2 * error_of(record_of(tmp_path, CLEAN))


def test_known_period_gives_reference_from_any_start(tmp_path: Path) -> None:
    """The generator's file: r is repeated, in step with u, and the response is that of the log itself."""
    signals = log(np.arange(P * N) + 211, noise=1e-4)
    write_log(tmp_path / "log.h5", {"u": signals["u"], "y": signals["y"]})
    write_log(tmp_path / "sent.h5", {"r": log(np.arange(N))["r"]})
    channels = (replace(CHANNELS[0], file=2), *CHANNELS[1:])
    record = measured(
        tmp_path, spec_of(channels=channels, files=(FileSpec("log.h5", "home", also=("sent.h5",)),)), ROBOT
    )
    assert record.n_periods == P
    np.testing.assert_allclose(record.r[:, 0], log(np.arange(P * N) + 211)["r"], atol=1e-9)
    assert "sent.h5 lags log.h5 by 211.000 samples" in said(record.notes)[0]


def test_logs_without_a_signal_in_common_are_refused(tmp_path: Path) -> None:
    """Of no motor in the second file, or with another r."""
    write_log(tmp_path / "log.h5", {"r": CLEAN["r"], "u": CLEAN["u"]})
    write_log(tmp_path / "encoder.h5", {"r": AT_ONCE.normal(size=P * N), "y": CLEAN["y"]})
    files = (FileSpec("log.h5", "home", also=("encoder.h5",)),)
    y = replace(CHANNELS[2], file=2)
    with refused("records/period-mismatch", place="encoder.h5"):
        measured(tmp_path, spec_of(channels=(*CHANNELS[:2], replace(y, at="body arm z")), files=files), ROBOT)
    with refused("records/period-mismatch", place="encoder.h5"):
        measured(tmp_path, spec_of(channels=(*CHANNELS[:2], replace(CHANNELS[0], file=2), y), files=files), ROBOT)


def test_channels_of_two_rates_meet_at_the_lower_one(tmp_path: Path) -> None:
    """The encoder at four times the rate of the torques; a rate without a whole number of samples is refused."""
    fast = log(np.arange(4 * P * N) / 4)["y"]
    write_log(tmp_path / "log.h5", {"r": CLEAN["r"], "u": CLEAN["u"], "y": fast})
    channels = (*CHANNELS[:2], replace(CHANNELS[2], rate_hz=4 * RATE))
    record = measured(tmp_path, spec_of(channels=channels), ROBOT)
    assert (record.rate_hz, record.period_samples, record.n_periods) == (RATE, N, P)
    assert record.repairs == {"channels brought to another rate": 1}
    assert error_of(record) < 0.02
    files = (FileSpec("log.h5", "home", samples=(N // 2, N // 2 + 4 * N)),)
    part = measured(tmp_path, spec_of(channels=channels, files=files), ROBOT)
    assert part.n_periods == 4
    assert error_of(part) < 0.02
    slow = replace(CHANNELS[2], rate_hz=333.3)
    with refused("study/recorded", holds=("333.3 Hz", "1 s")):
        measured(tmp_path, spec_of(channels=(*CHANNELS[:2], slow)), ROBOT)
