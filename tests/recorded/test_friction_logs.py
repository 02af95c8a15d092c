"""Logs of a friction study: one record a joint that moves, on the link side, with its temperature."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from plants.friction_logs import (
    CHANNELS,
    ROBOT,
    THERMOMETER,
    logs,
    sliding_torque,
    trapezoids,
    write_log,
)
from plants.refusals import refused

from elastid.experiment.specs.channels import ChannelSpec
from elastid.experiment.specs.recorded import FileSpec
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


def test_a_temperature_written_by_hand_and_loops_are_of_their_file(tmp_path: Path) -> None:
    write_log(tmp_path / "loops.csv", 1e-4 * Q, U)
    (record,) = read(tmp_path, FileSpec("loops.csv", joint="1", purpose="loops", temperature=35.0))
    assert record.purpose == "loops"
    assert record.mean_temperature == 35.0
    assert record.resolution == pytest.approx(2 * np.pi / 65536 / 100, rel=1e-3)


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
