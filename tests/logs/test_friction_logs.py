"""Logs of a friction study: a record of each joint that moves, and energy and passes of warm-ups."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from plants.friction_logs import CHANNELS, ROBOT, THERMOMETER, logs, sliding_torque, trapezoids, write_log
from plants.refusals import refused
from plants.warm_rig import WarmLog, friction, warm_log

from elastid.experiment.specs.channels import ChannelSpec
from elastid.experiment.specs.experiment import ExperimentSpec
from elastid.experiment.specs.logs import FileSpec, RecordedSpec
from elastid.friction_record import FrictionRecord
from elastid.friction_study.warm_up import WarmUp, warm_up_of
from elastid.logs.friction_logs import read_friction_logs
from elastid.logs.warm_ups import join_warm_up_logs
from elastid.record import Configuration

Q = trapezoids([0.2, 0.5])
U = sliding_torque(Q)


def read(folder: Path, *files: FileSpec, channels: tuple[ChannelSpec, ...] = CHANNELS) -> tuple[FrictionRecord, ...]:
    return read_friction_logs(ROBOT, logs(*files, channels=channels), folder, ["1"], {}).records


def records_of(folder: Path, q: np.ndarray, u: np.ndarray) -> tuple[FrictionRecord, ...]:
    write_log(folder / "log.csv", q, u)
    return read(folder, FileSpec("log.csv"))


def test_a_log_is_read_on_the_link_side(tmp_path: Path) -> None:
    """Motor angle in deg over the ratio, motor current times constant and ratio."""
    write_log(tmp_path / "slow.csv", Q, U, np.full(len(Q), 104.0))
    channels = (*CHANNELS, replace(THERMOMETER, unit="degF"))
    (record,) = read(tmp_path, FileSpec("slow.csv", joint="1", speed=0.2, load="empty"), channels=channels)
    np.testing.assert_allclose(record.position, Q, rtol=0, atol=1e-5)
    np.testing.assert_allclose(record.torque, U, rtol=1e-6, atol=1e-6)
    assert (record.name, record.joint, record.purpose, record.speed) == ("slow", "1", "motion", 0.2)
    assert record.load_torque == pytest.approx(30 * abs(np.cos(record.position.mean())), rel=1e-3)
    assert record.mean_temperature == pytest.approx(40.0)


def test_spikes_of_torque_and_position_are_masked(tmp_path: Path) -> None:
    q, u = Q.copy(), U.copy()
    u[[0, 700, 1500, -1]] += [1e4, 60.0, 60.0, 1e4]
    q[[700, 1500]] = 0.0
    (of_torque,), (of_position,), (clean,) = (records_of(tmp_path, *each) for each in ((Q, u), (q, U), (Q, U)))
    assert np.abs(of_torque.torque - U[1:-1]).max() < 2.0
    assert {note.code for note in of_torque.notes} == {"records/corrected"}
    assert np.abs(of_position.position - Q).max() < np.abs(np.diff(Q)).max()
    assert clean.notes == ()


@pytest.mark.parametrize(("length", "parts", "limit"), [(4, 1, 3.0), (60, 4, 0.01)])
def test_dropouts_of_torque_are_missing_at_any_torque(tmp_path: Path, length: int, parts: int, limit: float) -> None:
    """Short dropouts are interpolated, others divide the log; a torque that crosses 0 in coarse steps has none."""
    lost = np.arange(600, len(U), 1300)[:, None] + np.arange(length)
    u = np.where(np.isin(np.arange(len(U)), lost), 0.0, U)
    records, (coarse,) = records_of(tmp_path, Q + 0.1, u), records_of(tmp_path, Q + 0.1, np.round(U / 2) * 2)
    assert (len(records), coarse.notes) == (parts, ())
    for record in records:
        first = round(record.start_s * record.rate_hz)
        assert np.abs(record.torque - U[first : first + len(record.torque)]).max() < limit


def test_a_block_far_outside_the_range_divides_the_log(tmp_path: Path) -> None:
    q = Q.copy()
    q[3000:3006] = 99.0
    first, second = records_of(tmp_path, q, U)
    assert max(np.abs(first.position).max(), np.abs(second.position).max()) < 2 * np.abs(Q).max()
    assert second.start_s * second.rate_hz == pytest.approx(3006)


def test_rows_of_zeros_are_missing_and_interpolated(tmp_path: Path) -> None:
    """One row in seven, as of a second publisher of a topic."""
    q, u = Q + 1.0, U.copy()
    q[::7] = u[::7] = 0.0
    (record,) = records_of(tmp_path, q, u)
    at = np.setdiff1d(np.arange(len(q)), np.arange(0, len(q), 7))
    inside = slice(at[0], at[-1] + 1)
    assert np.abs(record.position - (Q + 1.0)[inside][: len(record.position)]).max() < np.abs(np.diff(Q)).max()
    assert np.median(np.abs(record.torque - U[inside][: len(record.torque)])) < 1e-3 * np.ptp(U)


def test_long_gap_splits_log_and_lost_messages_do_not(tmp_path: Path) -> None:
    """Parts on both sides begin at their times and hold the samples of the log."""
    q, u = Q.copy(), U.copy()
    middle = len(q) // 2
    lost = np.random.default_rng(0).choice(np.arange(5, middle - 50), middle // 100, replace=False)
    for x in (q, u):
        x[lost] = x[middle : middle + 40] = np.nan
    first, second = records_of(tmp_path, q, u)
    assert (first.name, second.name) == ("log", "log part 2")
    assert second.start_s * second.rate_hz == pytest.approx(middle + 40)
    np.testing.assert_allclose(second.position, Q[middle + 40 :], atol=1e-5)
    assert np.abs(first.position - Q[: len(first.position)]).max() < np.abs(np.diff(Q)).max()


def test_a_log_in_which_nothing_moves_is_refused(tmp_path: Path) -> None:
    with refused("records/channels", place="log.csv"):
        records_of(tmp_path, 1e-4 * Q, U)


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
def folder(log, tmp_path_factory) -> Path:
    path = tmp_path_factory.mktemp("warm")
    write_warm(path / "warm.csv", log)
    return path


@pytest.fixture(scope="module")
def warm_up(folder, log) -> WarmUp:
    return read_warm_up(folder, log, FileSpec("warm.csv", purpose="warm_up"))


@pytest.mark.slow
def test_the_energy_of_a_log_is_kept_in_few_steps(warm_up: WarmUp, log: WarmLog) -> None:
    """Work of friction to 1 % of it, inertia and gravity taking no part; 500 steps of 180 000 samples."""
    assert len(warm_up.log.power) == 500
    speed = np.gradient(log.position, 1 / log.rate_hz)
    heat = float(np.sum(np.abs(speed) * friction(speed, log.gear)) / log.rate_hz)
    assert float(warm_up.log.power @ np.diff(warm_up.log.time_s)) == pytest.approx(heat, rel=0.01)


@settings(max_examples=15, deadline=None)
@given(
    cycles=st.integers(60, 240),
    pause=st.sampled_from([0.0, 90.0]),
    hold=st.sampled_from(["zero-order", "band-limited"]),
)
def test_a_warm_up_in_two_logs_is_the_warm_up(cycles: int, pause: float, hold: Any) -> None:
    """Its work, its time, and the thermometer at its times; at rest in a pause between them."""
    rate_hz, n, first = 20.0, 300 * 120, 120 * cycles
    time_s = np.arange(n) / rate_hz
    q = np.sin(2 * np.pi * (np.arange(n) + 0.5) / 120)
    u, degc = 5 * np.sign(np.diff(q, append=1.0)), 20 + 0.01 * time_s
    whole, *parts = (
        FrictionRecord(
            "log", "1", "warm_up", rate_hz, q[part], u[part], temperature=degc[part], hold=hold,
            start_s=time_s[part][0] + (pause if part.start else 0.0), configuration=Configuration("c", [0.0]),
        )
        for part in (slice(0, n), slice(0, first), slice(first, n))
    )  # fmt: skip
    one, two = (join_warm_up_logs(logs, [FileSpec("log.csv")]) for logs in ((whole,), parts))
    assert one.time_s[-1] == time_s[-1]
    assert two.time_s[-1] == time_s[-1] + pause
    works = [float(log.power @ np.diff(log.time_s)) for log in (one, two)]
    assert works == pytest.approx(2 * [5 * np.abs(np.diff(q)).sum()], rel=2e-3)
    assert np.all(two.power[(two.time_s[:-1] >= time_s[first]) & (two.time_s[1:] <= time_s[first] + pause)] == 0)
    late = two.time_s > time_s[first - 1] + pause / 2
    np.testing.assert_allclose(two.temperature, 20 + 0.01 * (two.time_s - pause * late), atol=0.03)


@pytest.mark.slow
def test_slow_thermometer_with_gaps_keeps_motion(warm_up: WarmUp, folder: Path, log: WarmLog) -> None:
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
