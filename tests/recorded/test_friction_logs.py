"""Logs of a friction study: a record of each joint that moves, and energy and passes of warm-ups."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from plants.friction_logs import CHANNELS, ROBOT, THERMOMETER, logs, sliding_torque, trapezoids, write_log
from plants.refusals import refused
from plants.warm_rig import WarmLog, friction, warm_log

from elastid.experiment.specs.channels import ChannelSpec
from elastid.experiment.specs.experiment import ExperimentSpec
from elastid.experiment.specs.recorded import FileSpec, RecordedSpec
from elastid.friction_study.warm_up import WarmUp, fit_warm_up, temperature, warm_up_of
from elastid.record import FrictionRecord
from elastid.recorded.friction_logs import read_friction_logs

Q = trapezoids([0.2, 0.5])
U = sliding_torque(Q)


def read(folder: Path, *files: FileSpec, channels: tuple[ChannelSpec, ...] = CHANNELS) -> tuple[FrictionRecord, ...]:
    return read_friction_logs(ROBOT, logs(*files, channels=channels), folder, ["1"], {}).records


def test_a_log_is_read_on_the_link_side(tmp_path: Path) -> None:
    """Motor angle in deg over the ratio, motor current times constant and ratio."""
    write_log(tmp_path / "slow.csv", Q, U)
    (record,) = read(tmp_path, FileSpec("slow.csv", joint="1", speed=0.2, load="empty"))
    np.testing.assert_allclose(record.position, Q, rtol=0, atol=1e-5)
    np.testing.assert_allclose(record.torque, U, rtol=1e-6, atol=1e-6)
    assert (record.name, record.joint, record.purpose, record.speed) == ("slow", "1", "motion", 0.2)
    assert record.load_torque == pytest.approx(30 * abs(np.cos(record.position.mean())), rel=1e-3)
    assert record.temperature is None


@pytest.mark.parametrize(("unit", "values"), [("degC", 40.0), ("K", 313.15), ("degF", 104.0), ("", 40.0)])
def test_a_temperature_is_read_in_its_unit(unit: str, values: float, tmp_path: Path) -> None:
    write_log(tmp_path / "log.csv", Q, U, np.full(len(Q), values))
    channels = (*CHANNELS, replace(THERMOMETER, unit=unit))
    (record,) = read(tmp_path, FileSpec("log.csv"), channels=channels)
    assert record.mean_temperature == pytest.approx(40.0)


def test_spikes_of_the_torque_are_taken_out(tmp_path: Path) -> None:
    spoilt = U.copy()
    spoilt[[700, 1500]] += 60.0
    write_log(tmp_path / "log.csv", Q, spoilt)
    (record,) = read(tmp_path, FileSpec("log.csv"))
    assert np.abs(record.torque - U).max() < 2.0
    assert [note.code for note in record.notes] == ["records/repaired"]
    write_log(tmp_path / "clean.csv", Q, U)
    assert read(tmp_path, FileSpec("clean.csv"))[0].notes == ()


def test_a_log_in_which_nothing_moves_is_refused(tmp_path: Path) -> None:
    write_log(tmp_path / "log.csv", 1e-4 * Q, U)
    with refused("records/channels", place="log.csv"):
        read(tmp_path, FileSpec("log.csv"))


def read_warm_up(folder: Path, log: WarmLog, file: FileSpec, thermometer: ChannelSpec = THERMOMETER) -> WarmUp:
    spec = ExperimentSpec(recorded=RecordedSpec(log.rate_hz, (*CHANNELS, thermometer), (file,)))
    measured = read_friction_logs(ROBOT, spec, folder, ["1"], {})
    return warm_up_of(measured.warm_ups[0], measured.records)


def write_warm(path: Path, log: WarmLog) -> None:
    write_log(path, log.position, log.torque, log.thermometer)


@pytest.fixture(scope="module")
def log() -> WarmLog:
    return warm_log(2.0)


@pytest.fixture(scope="module")
def folder(log: WarmLog, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("warm")
    write_warm(path / "warm.csv", log)
    return path


@pytest.fixture(scope="module")
def warm_up(folder: Path, log: WarmLog) -> WarmUp:
    """The log read once."""
    return read_warm_up(folder, log, FileSpec("warm.csv", purpose="warm_up"))


def test_the_energy_of_a_log_is_kept_in_few_steps(warm_up: WarmUp, log: WarmLog) -> None:
    """Work of friction to 1 % of it, inertia and gravity taking no part; 500 steps of 180 000 samples."""
    assert len(warm_up.log.power) == 500
    speed = np.gradient(log.position, 1 / log.rate_hz)
    heat = float(np.sum(np.abs(speed) * friction(speed, log.gear)) / log.rate_hz)
    assert float(warm_up.log.power @ np.diff(warm_up.log.time_s)) == pytest.approx(heat, rel=0.01)


def test_the_second_half_of_another_thermal_structure_is_predicted_to_one_percent(
    warm_up: WarmUp, folder: Path, log: WarmLog
) -> None:
    """Gear and housing with the thermometer outside, of its rise; a single node misses it by more than 3 %."""
    half = read_warm_up(folder, log, FileSpec("warm.csv", purpose="warm_up", samples=(0, len(log.torque) // 2)))
    model = fit_warm_up(half)
    late = warm_up.log.time_s > warm_up.log.time_s[-1] / 2
    quiet = warm_log(2.0, thermometer_std=0.0).thermometer
    housing = np.interp(warm_up.log.time_s, np.arange(len(quiet)) / log.rate_hz, quiet)
    error = temperature(warm_up.log, model.time_constants, model.shares, model.h, warm_up.log.start_degc) - housing
    assert np.sqrt(np.mean(error[late] ** 2)) < 0.01 * np.ptp(housing)
    error = temperature(warm_up.log, model.time_constants[:1], np.ones(1), model.h, warm_up.log.start_degc) - housing
    assert np.sqrt(np.mean(error[late] ** 2)) > 0.03 * np.ptp(housing)


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
    found = read_warm_up(folder, log, file, slow)
    np.testing.assert_array_equal(found.log.power, warm_up.log.power)
    np.testing.assert_allclose(found.log.temperature, warm_up.log.temperature, atol=1.2)


@pytest.mark.slow
def test_a_coarse_thermometer_counts_no_reading_twice(tmp_path: Path, log: WarmLog) -> None:
    """Whole degrees without noise: two readings for each of nine."""
    write_warm(tmp_path / "warm.csv", warm_log(2.0, thermometer_std=0.0, count=1.0))
    warm_up = read_warm_up(tmp_path, log, FileSpec("warm.csv", purpose="warm_up"))
    assert np.isfinite(warm_up.log.temperature).sum() < 25
    assert warm_up.log.temperature_std == pytest.approx(1 / np.sqrt(12), rel=0.01)
