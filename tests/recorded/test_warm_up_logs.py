"""Logs of warm-ups: energy kept in few steps, test passes within them, another thermal structure predicted."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from plants.friction_logs import ROBOT
from plants.warm_rig import ROOM, WarmLog, friction, warm_log, write_warm_log

from elastid.experiment.specs.channels import ChannelSpec
from elastid.experiment.specs.experiment import ExperimentSpec
from elastid.experiment.specs.recorded import FileSpec, RecordedSpec
from elastid.friction_study.warm_up import WarmUp, fit_warm_up, temperature, warm_up_of
from elastid.recorded.friction_logs import read_friction_logs

CHANNELS = (
    ChannelSpec("u", "motor 1", "torque"),
    ChannelSpec("y", "motor 1", "angle", quantity="position"),
)
THERMOMETER = ChannelSpec("t", "joint 1", "temperature", quantity="temperature")


def read(folder: Path, log: WarmLog, file: FileSpec, thermometer: ChannelSpec = THERMOMETER) -> WarmUp:
    spec = ExperimentSpec(recorded=RecordedSpec(log.rate_hz, (*CHANNELS, thermometer), (file,)))
    measured = read_friction_logs(ROBOT, spec, folder, ["1"], {})
    return warm_up_of(measured.warm_ups[0], measured.records)


@pytest.fixture(scope="module")
def log() -> WarmLog:
    return warm_log(2.0, 25.0, thermometer_std=0.3)


@pytest.fixture(scope="module")
def folder(log: WarmLog, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("warm")
    write_warm_log(path / "warm.csv", log)
    return path


@pytest.fixture(scope="module")
def warm_up(folder: Path, log: WarmLog) -> WarmUp:
    """The log read once."""
    return read(folder, log, FileSpec("warm.csv", purpose="warm_up"))


def test_the_energy_of_a_log_is_kept_in_few_steps(warm_up: WarmUp, log: WarmLog) -> None:
    """Work of friction to 1 % of it, inertia and gravity taking no part; 500 steps of 180 000 samples."""
    assert len(warm_up.log.power) == 500
    speed = np.gradient(log.position, 1 / log.rate_hz)
    heat = float(np.sum(np.abs(speed) * friction(speed, log.gear)) / log.rate_hz)
    assert float(warm_up.log.power @ np.diff(warm_up.log.time_s)) == pytest.approx(heat, rel=0.01)


def test_test_passes_are_those_of_the_motion_throughout(warm_up: WarmUp, log: WarmLog) -> None:
    """Two speeds in each part of the log that works, with the gear's friction to 2 %."""
    assert 36 <= len(warm_up.test) <= 48
    gear = np.interp(warm_up.log.time_s[warm_up.test], np.arange(len(log.gear)) / log.rate_hz, log.gear)
    np.testing.assert_allclose(warm_up.level, friction(warm_up.test_speed, gear), rtol=0.02)


def test_the_second_half_of_another_thermal_structure_is_predicted_to_one_percent(
    warm_up: WarmUp, folder: Path, log: WarmLog
) -> None:
    """Gear and housing with the thermometer outside, of its rise; a single node misses it by more than 3 %."""
    half = read(folder, log, FileSpec("warm.csv", purpose="warm_up", samples=(0, len(log.torque) // 2)))
    model = fit_warm_up(half)
    late = warm_up.log.time_s > warm_up.log.time_s[-1] / 2
    housing = np.interp(warm_up.log.time_s, np.arange(len(log.gear)) / log.rate_hz, without_noise(log))
    error = temperature(warm_up.log, model.time_constants, model.shares, model.h, warm_up.log.start_degc) - housing
    assert np.sqrt(np.mean(error[late] ** 2)) < 0.01 * np.ptp(housing)
    error = temperature(warm_up.log, model.time_constants[:1], np.ones(1), model.h, warm_up.log.start_degc) - housing
    assert np.sqrt(np.mean(error[late] ** 2)) > 0.03 * np.ptp(housing)


def without_noise(log: WarmLog) -> np.ndarray:
    return warm_log(len(log.torque) / log.rate_hz / 3600, log.rate_hz, thermometer_std=0.0).thermometer


def test_a_thermometer_of_its_own_rate_with_gaps_leaves_the_motion_as_it_is(
    warm_up: WarmUp, folder: Path, log: WarmLog
) -> None:
    """A reading every 10 s, some missing, in another file: the power is that of the log."""
    readings = log.thermometer[:: round(10 * log.rate_hz)].copy()
    readings[100:110] = np.nan
    rows = "\n".join(f"{each:.6g}" for each in readings)
    (folder / "slow.csv").write_text(f"degc\n{rows}\n")
    slow = replace(THERMOMETER, channel="degc", file=2, rate_hz=0.1)
    file = FileSpec("warm.csv", purpose="warm_up", also=("slow.csv",))
    found = read(folder, log, file, slow)
    np.testing.assert_array_equal(found.log.power, warm_up.log.power)
    np.testing.assert_allclose(found.log.temperature, warm_up.log.temperature, atol=1.2)


@pytest.mark.slow
def test_a_coarse_thermometer_counts_no_reading_twice(tmp_path: Path, log: WarmLog) -> None:
    """Whole degrees without noise: two readings for each of nine."""
    write_warm_log(tmp_path / "warm.csv", warm_log(2.0, 25.0, thermometer_std=0.0, count=1.0))
    warm_up = read(tmp_path, log, FileSpec("warm.csv", purpose="warm_up"))
    assert np.isfinite(warm_up.log.temperature).sum() < 25
    assert warm_up.log.temperature_std == pytest.approx(1 / np.sqrt(12), rel=0.01)


def test_the_room_and_the_start_are_those_of_the_file(warm_up: WarmUp, folder: Path, log: WarmLog) -> None:
    """A joint that was still warm: the room is colder than its first reading."""
    found = read(folder, log, FileSpec("warm.csv", purpose="warm_up", ambient=18.0, start=600.0))
    assert found.log.ambient_degc == 18.0
    assert found.log.start_degc == pytest.approx(ROOM, abs=0.5)
    assert found.log.time_s[0] == 600.0
    assert np.isnan(warm_up.log.ambient_degc)
