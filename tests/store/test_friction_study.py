"""Artefacts of a friction study hold every part of a result, to the last bit; foreign files are refused."""

from pathlib import Path

import numpy as np
from plants.friction_study import friction_result

from elastid.base.errors import Note
from elastid.friction_record import FrictionRecord, WarmUpLog
from elastid.store.description import describe_artefact
from elastid.store.friction_study import (
    read_friction_records,
    read_friction_result,
    write_friction_records,
    write_friction_result,
)


def test_every_part_of_a_result_comes_back(tmp_path: Path) -> None:
    """FrictionCurve, law, loops, elements, bristles, warm-up, motion, notes; names that are no names of files."""
    result = friction_result()
    write_friction_result(tmp_path / "friction.h5", result)
    assert repr(read_friction_result(tmp_path / "friction.h5")) == repr(result)
    assert "Fc_melbow" in describe_artefact(tmp_path / "friction.h5")


def test_records_keep_temperatures_windows_and_warm_ups(tmp_path: Path) -> None:
    """Signals have axes and units for other readers; what is absent stays absent."""
    t = np.arange(100) / 50.0
    one = FrictionRecord("a/b", "1", "constant_velocity", 50.0, np.sin(t), np.cos(t), temperature=np.full(100, np.nan),
                         there=(10, 40), back=(50, 90), speed=0.1, notes=(Note("code", "text", "place"),))  # fmt: skip
    slide = FrictionRecord("s", "2", "motion", 50.0, t, t, velocity=np.ones(100), slides=True)
    log = WarmUpLog("1", np.arange(4.0), np.ones(3), np.full(4, np.nan), 0.5, 20.0, 21.0)
    write_friction_records(tmp_path / "records.h5", [one, slide], warm_ups=[log], notes=[Note("a", "b")])
    found = read_friction_records(tmp_path / "records.h5")
    assert repr(found.records) == repr((one, slide))
    assert repr(found.warm_ups) == repr((log,))
    assert found.notes == (Note("a", "b"),)
    assert (found.records[0].velocity, found.records[1].there) == (None, None)
    text = describe_artefact(tmp_path / "records.h5")
    assert "torque (sample 100): torque of the motor, link side [N*m]" in text
    assert "velocity (sample 100): velocity of the joint [m/s]" in text


def test_a_pass_is_a_table_for_a_controller(tmp_path: Path) -> None:
    """Time, position, velocity and acceleration, a line each sample."""
    from elastid.store.trajectory import write_signals

    ramp = np.arange(4.0)
    write_signals(tmp_path / "pass.csv", 10.0, position=ramp, velocity=ramp, acceleration=ramp)
    lines = (tmp_path / "pass.csv").read_text().splitlines()
    assert lines[0] == "t_s,position,velocity,acceleration"
    assert lines[2] == "0.1,1,1,1"
