"""The recorded rig: one experiment read from every file format, and what is wrong with a log said in one message."""

from __future__ import annotations

import pickle
import re
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
from plants.notes import said
from scipy.io import savemat

from elastid.app.inspection import described as inspected
from elastid.base.errors import DataError, ElastidError, StudyError
from elastid.excitation.multisine import orthogonal_set, synthesise
from elastid.experiment.specs.experiment import ExperimentSpec
from elastid.experiment.specs.recorded import ChannelSpec, FileSpec, RecordedSpec, TextFormatSpec
from elastid.record import Record
from elastid.recorded.files.formats import contents, read_channels
from elastid.recorded.files.text import described_format, guess_format
from elastid.recorded.periodicity import repetition
from elastid.recorded.rig import RecordedRig
from elastid.robot import Body, Joint, Motor, Robot, Spring

SHARED = Path(__file__).parents[3] / "shared" / "data"
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
    ChannelSpec(at="motor 2", channel="i2", sign=-1, **CURRENT),  # type: ignore[arg-type]
    ChannelSpec(at="motor 1", channel="i1", **CURRENT),  # type: ignore[arg-type]
    ChannelSpec("y", "motor 1", "phi", quantity="position", unit="deg", side="motor"),
    ChannelSpec("y", "joint 2", "w2", quantity="velocity", scale=0.1),
)


@pytest.fixture(scope="module")
def log() -> dict[str, np.ndarray]:
    """Four periods of what a controller would have written, the angle with a ramp of drift."""
    lines = np.arange(3, 60, 2)
    U = orthogonal_set(np.ones((len(lines), 4)), np.random.default_rng(0))[0]
    signals = np.tile(synthesise(lines, U, N), (P, 1))
    signals[:, 2] += np.linspace(0, 300, len(signals))
    return dict(zip(("i1", "i2", "phi", "w2"), signals.T, strict=True))


def _spec(path: str, channels: tuple[ChannelSpec, ...] = CHANNELS, **changes: Any) -> ExperimentSpec:
    keys: dict[str, Any] = {
        "rate_hz": RATE,
        "period_samples": N,
        "channels": channels,
        "files": (FileSpec(path, "home"),),
    }
    return ExperimentSpec({"home": (0.0, 0.0)}, recorded=RecordedSpec(**(keys | changes)))


def _measure(base: Path, spec: ExperimentSpec) -> Record:
    rig = RecordedRig(ROBOT, spec, base)
    return rig.measure(rig.experiments[0])


def _csv(path: Path, log: Mapping[str, np.ndarray], delimiter: str = ",", head: str = "", comma: bool = False) -> None:
    rows = [delimiter.join(f"{v:.17g}" for v in row) for row in zip(*log.values(), strict=True)]
    text = head + delimiter.join(log) + "\n" + "\n".join(rows) + "\n"
    path.write_text(text.replace(".", ",") if comma else text)


def _renamed(names: Mapping[str, str], **same: Any) -> tuple[ChannelSpec, ...]:
    return tuple(replace(c, channel=names[c.channel], **same) for c in CHANNELS)


def _write_matlab(base: Path, log: dict[str, np.ndarray]) -> ExperimentSpec:
    struct = {"cur": np.stack([log["i1"], log["i2"]]), "phi": log["phi"], "note": "run 7"}
    runs = np.array([(log["w2"],), (2 * log["w2"],)], dtype=[("w", object)])
    cells = np.array([np.ones(50), "text"], dtype=object)
    savemat(base / "log.mat", {"rec": struct, "run": runs, "fs": 100.0, "cells": cells})
    channels = _renamed({"i1": "rec.cur", "i2": "rec.cur", "phi": "rec.phi", "w2": "run(1).w"})
    return _spec("log.mat", (replace(channels[0], column=2), replace(channels[1], column=1), *channels[2:]))


def _write_matlab_73(base: Path, log: dict[str, np.ndarray]) -> ExperimentSpec:
    with h5py.File(base / "new.mat", "w", userblock_size=512) as file:
        file["rec/cur"] = np.stack([log["i1"], log["i2"]])  # a 800 x 2 matrix, as MATLAB writes it
        file["rec/phi"] = log["phi"][None]
        file["w2"] = log["w2"][None]
        file["#refs#/junk"] = np.zeros(3)
    with (base / "new.mat").open("r+b") as raw:
        raw.write(b"MATLAB 7.3 MAT-file".ljust(512))
    channels = _renamed({"i1": "rec.cur", "i2": "rec.cur", "phi": "rec.phi", "w2": "w2"})
    return _spec("new.mat", (replace(channels[0], column=2), replace(channels[1], column=1), *channels[2:]))


def _write_hdf5(base: Path, log: dict[str, np.ndarray]) -> ExperimentSpec:
    table = np.zeros(len(log["i1"]), dtype=[("i1", "f8"), ("i2", "f8")])
    table["i1"], table["i2"] = log["i1"], log["i2"]
    with h5py.File(base / "log.h5", "w") as file:
        file["drive/currents"], file["drive/phi"], file["w2"] = table, log["phi"], log["w2"]
    return _spec(
        "log.h5",
        _renamed({"i1": "drive/currents.i1", "i2": "drive/currents.i2", "phi": "/drive/phi", "w2": "w2"}),
    )


def _write_csv(base: Path, log: dict[str, np.ndarray]) -> ExperimentSpec:
    _csv(base / "log.csv", {"t": np.arange(len(log["i1"])) / RATE} | log)
    return _spec("log.csv")


def _write_csv_with_a_delimiter_at_every_end(base: Path, log: dict[str, np.ndarray]) -> ExperimentSpec:
    _csv(base / "log.csv", log)
    lines = (base / "log.csv").read_text().splitlines()
    (base / "log.csv").write_text("\r\n".join([lines[0], "", *(f"{line}," for line in lines[1:])]))
    return _spec("log.csv")


def _write_german_csv(base: Path, log: dict[str, np.ndarray]) -> ExperimentSpec:
    _csv(base / "log.txt", log, ";", comma=True, head="Messung 7\n3 Achsen\n")
    return _spec("log.txt", text=TextFormatSpec(";", ",", header_lines=3))


def _write_commented_table(base: Path, log: dict[str, np.ndarray]) -> ExperimentSpec:
    np.savetxt(base / "log.dat", np.stack(list(log.values()), axis=1), fmt="%.17g", header="a b c d")
    columns = {"i1": 1, "i2": 2, "phi": 3, "w2": 4}
    channels = tuple(replace(c, channel="", column=columns[c.channel]) for c in CHANNELS)
    return _spec("log.dat", channels, text=TextFormatSpec("whitespace"))


def _write_tab_table_with_units(base: Path, log: dict[str, np.ndarray]) -> ExperimentSpec:
    stamped = ["\t".join(["12:30:01", *(f"{v:.17g}" for v in row), "ok"]) for row in zip(*log.values(), strict=True)]
    (base / "log.tsv").write_text("\n".join(["time\ti1\ti2\tphi\tw2\tstate", "\tmA\tmA\tdeg\trad/s\t", *stamped]))
    return _spec("log.tsv", text=TextFormatSpec("tab"))


WRITERS = [
    _write_matlab,
    _write_matlab_73,
    _write_hdf5,
    _write_csv,
    _write_csv_with_a_delimiter_at_every_end,
    _write_german_csv,
    _write_commented_table,
    _write_tab_table_with_units,
]


@pytest.mark.parametrize("write", WRITERS)
def test_every_format_gives_the_same_record_in_si_on_the_link_side(
    write: Callable[[Path, dict[str, np.ndarray]], ExperimentSpec], tmp_path: Path, log: dict[str, np.ndarray]
) -> None:
    """Current * constant * ratio, motor angle / ratio (which is negative), signs, scales, units, order of channels."""
    record = _measure(tmp_path, write(tmp_path, log))
    assert record.inputs == ("motor 2", "motor 1")
    assert record.outputs == ("motor 1", "joint 2")
    assert record.quantities == ("position", "velocity")
    expected_u = np.stack([-log["i2"] * 1e-3 * 0.5, log["i1"] * 1e-3 * 0.5 * RATIO], axis=1)
    expected_y = np.stack([np.radians(log["phi"]) / RATIO, 0.1 * log["w2"]], axis=1)
    np.testing.assert_allclose(record.u, expected_u, rtol=1e-12, atol=1e-15)
    np.testing.assert_allclose(record.y, expected_y, rtol=1e-12, atol=1e-15)
    assert (record.rate_hz, record.period_samples, record.n_periods) == (RATE, N, P)
    assert record.rate_is_known
    assert said(record.notes) == ()


def test_contents_lists_every_signal_of_a_file(tmp_path: Path, log: dict[str, np.ndarray]) -> None:
    """Names and shapes as a channel would be written in a study; no texts, scalars or references."""
    text = TextFormatSpec()
    _write_matlab(tmp_path, log)
    assert contents(tmp_path / "log.mat", text) == {
        "rec.cur": (2, 800),
        "rec.phi": (1, 800),
        "run(1).w": (1, 800),
        "run(2).w": (1, 800),
        "cells{1}": (1, 50),
    }
    _write_matlab_73(tmp_path, log)
    assert contents(tmp_path / "new.mat", text) == {"rec.cur": (800, 2), "rec.phi": (800, 1), "w2": (800, 1)}
    _write_csv(tmp_path, log)
    assert contents(tmp_path / "log.csv", text) == dict.fromkeys(("t", "i1", "i2", "phi", "w2"), (800,))


def test_reference_torques_are_put_in_the_order_of_the_inputs(tmp_path: Path, log: dict[str, np.ndarray]) -> None:
    """r is listed motor 1 first, u motor 2 first."""
    _csv(tmp_path / "log.csv", log)
    r = (ChannelSpec("r", "motor 1", "i1"), ChannelSpec("r", "motor 2", "i2"))
    record = _measure(tmp_path, _spec("log.csv", (*r, *CHANNELS)))
    assert record.r is not None
    np.testing.assert_allclose(record.r, np.stack([log["i2"], log["i1"]], axis=1), rtol=1e-12)


def test_an_encoder_that_starts_again_after_a_turn_is_unwrapped(tmp_path: Path, log: dict[str, np.ndarray]) -> None:
    """Angle modulo 360 deg on the motor side gives the same motion, with a word; its mean turns are lost."""
    _csv(tmp_path / "whole.csv", log)
    _csv(tmp_path / "wrapped.csv", log | {"phi": np.mod(log["phi"], 360.0)})
    whole, wrapped = (_measure(tmp_path, _spec(f"{name}.csv")) for name in ("whole", "wrapped"))
    np.testing.assert_allclose(wrapped.y[:, 0] - wrapped.y[0, 0], whole.y[:, 0] - whole.y[0, 0], atol=1e-12)
    assert "jumps of a whole turn were taken out of phi" in said(wrapped.notes)[0]


def test_an_input_that_stands_still_while_another_moves_is_taken_as_not_excited(
    tmp_path: Path, log: dict[str, np.ndarray]
) -> None:
    """One motor at a time is a lawful experiment; the estimator judges all of them together."""
    _csv(tmp_path / "log.csv", log | {"i2": np.full(800, 0.5)})
    notes = said(_measure(tmp_path, _spec("log.csv")).notes)
    sentence = "channel i2 (u at motor 2) is constant at 0.5: taken as not excited in this experiment"
    assert notes == (f"record home-r0-e0: {sentence}",)


def test_a_last_period_that_is_not_whole_is_left_out_with_a_word(tmp_path: Path, log: dict[str, np.ndarray]) -> None:
    """780 samples are 3 periods of 200 and 180 more; also when a window of the file is asked for."""
    _csv(tmp_path / "log.csv", {k: v[:780] for k, v in log.items()})
    record = _measure(tmp_path, _spec("log.csv"))
    assert record.n_samples == 600
    assert "the last 180 of 780 samples are no whole period of 200" in said(record.notes)[0]
    window = _spec("log.csv", files=(FileSpec("log.csv", "home", samples=(30, 450)),))
    record = _measure(tmp_path, window)
    assert record.n_samples == 400
    np.testing.assert_allclose(record.u[0, 0], -log["i2"][30] * 0.5e-3)


def test_a_rig_pickles_and_lists_its_experiments_in_the_order_of_the_files(
    tmp_path: Path, log: dict[str, np.ndarray]
) -> None:
    """It goes to worker processes."""
    _csv(tmp_path / "log.csv", log)
    files = tuple(FileSpec("log.csv", "home", realisation=m, experiment=e) for m in (0, 1) for e in (0, 1))
    rig = pickle.loads(pickle.dumps(RecordedRig(ROBOT, _spec("", files=files), tmp_path)))
    assert [e.name for e in rig.experiments] == ["home-r0-e0", "home-r0-e1", "home-r1-e0", "home-r1-e1"]
    assert rig.measure(rig.experiments[3]).realisation == 1


Change = Callable[[dict[str, np.ndarray]], dict[str, np.ndarray]]


def _with(name: str, at: Any, value: float) -> Change:
    def change(log: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
        column = log[name].copy()
        column[at] = value
        return log | {name: column}

    return change


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (_with("phi", slice(123, 523), np.nan), r"phi \(y at motor 1\): 400 of 800 .*NaN.* sample 123 \(1.23 s\)"),
        (
            _with("phi", [23, 223, 423, 623], np.inf),
            r"4 of 800 .* in every period .* first sample 23 \(0.23 s\)",
        ),
        (_with("phi", slice(None), np.nan), r"phi \(y at motor 1\): none of its 800 samples is a finite number"),
        (_with("w2", slice(None), 0.25), r"w2 \(y at joint 2\) is constant at 0.25 over all 800 samples"),
        (lambda log: {k: v[:390] for k, v in log.items()}, r"390 samples \(3.9 s\) are 1.95 periods of 200 samples"),
    ],
)
def test_data_that_cannot_be_used_are_refused_with_channel_and_place(
    change: Change, message: str, tmp_path: Path, log: dict[str, np.ndarray]
) -> None:
    """NaN (how many, where first), a dead sensor, less than two periods."""
    _csv(tmp_path / "log.csv", change(log))
    with pytest.raises(DataError, match=message):
        _measure(tmp_path, _spec("log.csv"))


def test_all_inputs_constant_is_refused(tmp_path: Path, log: dict[str, np.ndarray]) -> None:
    """Nothing was excited, or another channel is meant."""
    _csv(tmp_path / "log.csv", log | {"i1": np.zeros(800), "i2": np.zeros(800)})
    with pytest.raises(DataError, match=r"channel i2 \(u at motor 2\) is constant at 0"):
        _measure(tmp_path, _spec("log.csv"))


@pytest.mark.parametrize(
    ("channel", "message"),
    [
        (
            ChannelSpec("y", "motor 1", "phy", quantity="position"),
            r"'phy' is not in it; did you mean phi\? There are i1",
        ),
        (ChannelSpec("y", "motor 1", column=9, quantity="position"), "there is no column 9; it has 4"),
    ],
)
def test_a_channel_that_a_text_log_does_not_have_is_named_with_those_it_has(
    channel: ChannelSpec, message: str, tmp_path: Path, log: dict[str, np.ndarray]
) -> None:
    """By heading and by number."""
    _csv(tmp_path / "log.csv", log)
    with pytest.raises(DataError, match=message):
        _measure(tmp_path, _spec("log.csv", (*CHANNELS[:2], channel)))


@pytest.mark.parametrize(
    ("name", "column", "message"),
    [
        ("rec.psi", None, r"'rec.psi' is not in it; did you mean rec.phi\? There are rec.cur \(2 x 800\)"),
        ("rec.cur", None, "holds 2 signals of 800 samples; give column: 1 to 2"),
        ("rec.cur", 3, "has no column 3; it has 2, the first is column 1"),
        ("rec.note", None, "channel rec.note is no signal but <U5"),
        ("fs", None, "channel fs is no signal but"),
        ("cells{1}", None, "differ in length: run.1..w 800, cells.1. 50 samples"),
        ("", None, "give the name of a channel"),
    ],
)
def test_a_channel_that_a_matlab_file_does_not_hold_is_named_with_those_it_has(
    name: str, column: int | None, message: str, tmp_path: Path, log: dict[str, np.ndarray]
) -> None:
    """Missing, a matrix without a column, a wrong column, a text, a scalar, another length, no name at all."""
    _write_matlab(tmp_path, log)
    u = ChannelSpec("u", "motor 1", "run(1).w")
    y = ChannelSpec("y", "motor 1", name, column or (None if name else 1), "position")
    with pytest.raises(DataError, match=message):
        _measure(tmp_path, _spec("log.mat", (u, y)))


def test_a_text_that_is_not_a_number_is_refused_with_the_line_of_the_file(
    tmp_path: Path, log: dict[str, np.ndarray]
) -> None:
    """Line 102 of the file is sample 100 after one line of headings; a short line is told apart."""
    _csv(tmp_path / "log.csv", log)
    lines = (tmp_path / "log.csv").read_text().splitlines()
    lines[101] = re.sub(r",[^,]*,", ",ERR,", lines[101], count=1)
    (tmp_path / "log.csv").write_text("\n".join(lines))
    with pytest.raises(DataError, match=r"log.csv, line 102, column 2 \('i2'\): 'ERR' is not a number"):
        _measure(tmp_path, _spec("log.csv"))
    lines[101] = "1.0,2.0"
    (tmp_path / "log.csv").write_text("\n".join(lines))
    with pytest.raises(DataError, match=r"line 102: it has 2 columns, column 3 \('phi'\) is needed"):
        _measure(tmp_path, _spec("log.csv"))


def test_files_that_are_no_logs_are_refused(tmp_path: Path) -> None:
    """A damaged MATLAB file, a text without numbers, a format that contradicts itself."""
    (tmp_path / "bad.mat").write_bytes(b"MATLAB 5.0 MAT-file, but not really".ljust(200, b"x"))
    (tmp_path / "words.csv").write_text("no,numbers\nin,here\n")
    (tmp_path / "empty.csv").write_text("\n")
    for name, text, error, message in (
        ("bad.mat", TextFormatSpec(), DataError, "damaged, cut short or no MATLAB file"),
        ("words.csv", TextFormatSpec(), DataError, "no numbers in its 2 lines"),
        ("empty.csv", TextFormatSpec(), DataError, "the file is empty"),
        ("words.csv", TextFormatSpec(",", ","), StudyError, "delimiter and decimal are both ','"),
    ):
        with pytest.raises(error, match=message):
            _measure(tmp_path, _spec(name, text=text))


U, Y = CHANNELS[1], CHANNELS[2]


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"files": (FileSpec("gone.csv", "home"),)}, "log file .*gone.csv is not there"),
        ({"files": (FileSpec("log.csv", "away"),)}, "configuration 'away' is not under .*; there are home"),
        ({"files": (FileSpec("log.csv", "home"),) * 2}, "are both configuration home, realisation 0, experiment 0"),
        ({"channels": (U, replace(Y, at="motor 7"))}, "'motor 7' is not a place on robot two axes; there are motor 1"),
        ({"channels": (replace(U, at="joint 1"), Y)}, "u acts at 'joint 1', where no motor is; there are motor 1"),
        ({"channels": (U, replace(Y, at="body arm z"))}, "side: motor needs a gear, and body arm z has none"),
        ({"channels": (U, replace(Y, unit="N*m"))}, "channel phi .*: unit 'N.m' measures N.m, not rad"),
        ({"channels": (U, Y, replace(Y, channel="w2"))}, "two channels have role y at motor 1"),
        ({"channels": (U, Y, ChannelSpec("r", "motor 2", "i2"))}, "role r act at motor 2, those with role u at"),
        ({"period_samples": 201, "half_wave": True}, "half_wave needs an even number of samples per period, not 201"),
    ],
)
def test_a_study_that_does_not_fit_robot_or_files_is_refused_before_anything_is_read(
    changes: dict[str, Any], message: str, tmp_path: Path
) -> None:
    """Each with the name at fault and what there is."""
    (tmp_path / "log.csv").write_text("nothing is read")
    with pytest.raises(StudyError, match=message):
        RecordedRig(ROBOT, _spec("log.csv", **changes), tmp_path)


@pytest.mark.parametrize(("stated", "found"), [(199, 200), (210, 200), (100, 200), (90, 200)])
def test_a_wrong_period_is_found_and_the_right_one_said(
    stated: int, found: int, tmp_path: Path, log: dict[str, np.ndarray]
) -> None:
    """By autocorrelation of the inputs; a multiple of the period is right too, and the drift of a position is none."""
    _csv(tmp_path / "log.csv", log)
    with pytest.raises(DataError, match=rf"does not repeat with the period of {stated} .* every {found} samples"):
        _measure(tmp_path, _spec("log.csv", period_samples=stated))
    assert _measure(tmp_path, _spec("log.csv", period_samples=400)).n_periods == 2


def test_an_excitation_without_a_period_is_refused(tmp_path: Path, log: dict[str, np.ndarray]) -> None:
    """Noise instead of a multisine."""
    rng = np.random.default_rng(0)
    _csv(tmp_path / "log.csv", {name: rng.normal(size=800) for name in log})
    with pytest.raises(DataError, match=r"nor at any other lag .* needs a periodic excitation"):
        _measure(tmp_path, _spec("log.csv"))


def test_repetition_survives_drift_noise_and_an_input_at_rest() -> None:
    """A ramp a hundred times the signal, noise of its own power, a second input that only rustles."""
    rng = np.random.default_rng(1)
    x = np.tile(synthesise(np.arange(1, 40), np.exp(2j * np.pi * rng.random((39, 1))), 300)[:, 0], 6)
    excited = x + x.std() * (0.7 * rng.normal(size=1800) + np.linspace(0, 100, 1800))
    signals = np.stack([excited, 1e-3 * rng.normal(size=1800)], axis=1)
    assert repetition(signals, 300).is_as_stated
    assert not repetition(signals, 280).is_as_stated
    assert repetition(signals, 280).best_samples == pytest.approx(300, abs=0.5)


def test_a_clock_that_runs_a_thousandth_wrong_shows_in_the_period() -> None:
    """Logged at a rate 0.1 % off, the period is 500.5 samples: neither 500 nor 501 repeat it."""
    lines, rng = np.arange(2, 120), np.random.default_rng(2)
    U = np.exp(2j * np.pi * rng.random(len(lines)))
    t = np.arange(20000) / 500.5
    x = sum((u * np.exp(2j * np.pi * k * t)).real for k, u in zip(lines, U, strict=True))
    for stated in (500, 501):
        found = repetition(np.asarray(x)[:, None], stated)
        assert not found.is_as_stated
        assert found.best_samples == pytest.approx(500.5, abs=0.02)


def test_half_wave_records_need_one_period_and_say_so(tmp_path: Path) -> None:
    """Odd lines: x(t + T/2) = -x(t). One period gives two repetitions; without the key the message names it."""
    lines = np.arange(1, 60, 2)
    U = orthogonal_set(np.ones((len(lines), 4)), np.random.default_rng(3))[0]
    _csv(tmp_path / "log.csv", dict(zip(("i1", "i2", "phi", "w2"), synthesise(lines, U, N).T, strict=True)))
    record = _measure(tmp_path, _spec("log.csv", half_wave=True, rate_hz="unknown"))
    assert record.half_wave
    assert record.repeat_samples == 100
    assert not record.rate_is_known
    assert record.rate_hz == 1.0
    for stated in (100, 200):
        with pytest.raises(DataError, match="with period_samples: 200 and half_wave: true one period is enough"):
            _measure(tmp_path, _spec("log.csv", period_samples=stated))
    with pytest.raises(DataError, match="second half minus first"):
        _measure(tmp_path, _spec("log.csv", period_samples=150, half_wave=True))


@pytest.mark.skipif(not SHARED.exists(), reason="the measured data in ../shared are not here")
def test_a_log_of_an_industrial_robot_is_read_and_refused_as_not_periodic() -> None:
    """KUKA KR300: struct members, rows as axes, objects of unknown classes beside them; one movement."""
    path = SHARED / "kuka_kr300" / "traj_A.mat"
    shapes = contents(path, TextFormatSpec())
    assert shapes["rec.act_torque_abs_nm"] == (6, 2501)
    channels = (
        ChannelSpec("u", "motor 1", "rec.act_torque_abs_nm", 1, side="motor"),
        ChannelSpec("y", "motor 1", "rec.act_pos_mot_deg", 1, "position", "deg"),
    )
    with pytest.raises(ElastidError, match="needs a periodic excitation"):
        _measure(path.parent, _spec(path.name, channels, rate_hz=250.0, period_samples=250))


@pytest.mark.parametrize(
    ("delimiter", "decimal", "encoding"),
    [(";", ",", "utf-8-sig"), ("\t", ".", "cp1252"), (",", ".", "utf-16"), ("  ", ",", "utf-8")],
)
def test_inspect_and_messages_tell_how_a_text_log_is_written(
    delimiter: str, decimal: str, encoding: str, tmp_path: Path
) -> None:
    """Semicolons, tabs, blanks, decimal commas; UTF-8, UTF-16 and what Windows loggers write; the text fits a study."""
    path = tmp_path / "log.csv"
    numbers = np.random.default_rng(0).standard_normal((50, 3))
    rows = [delimiter.join(("u", "°C", "yl")), *(delimiter.join(f"{x:.6f}" for x in row) for row in numbers)]
    path.write_text("\n".join([rows[0], *(row.replace(".", decimal) for row in rows[1:])]), encoding=encoding)
    assert contents(path, guess_format(path)) == dict.fromkeys(("u", "°C", "yl"), (50,))
    page, text = inspected(path), guess_format(path)
    assert page.count("50") == 3
    if text == TextFormatSpec():
        return
    assert described_format(text) in page
    with pytest.raises(DataError, match=re.escape(described_format(text))):
        read_channels(path, [ChannelSpec("u", "motor 1", "u")], TextFormatSpec())


def test_headings_that_are_given_twice_or_elsewhere_are_not_guessed_at(tmp_path: Path) -> None:
    """The first of two equal headings was taken in silence, and column with it was not looked at."""
    path = tmp_path / "log.csv"
    path.write_text("x,x,y\n1,2,3\n4,5,6\n")

    def read(name: str, column: int | None) -> list[float]:
        values = read_channels(path, [ChannelSpec("u", "motor 1", name, column)], TextFormatSpec())
        return [float(v) for v in values[:, 0]]

    assert read("x", 2) == [2, 5]
    assert read("y", 3) == read("y", None) == [3, 6]
    with pytest.raises(DataError, match="'x' is the heading of column 1, 2; give column, too"):
        read("x", None)
    with pytest.raises(DataError, match="column 1 is not headed 'y', but column 3 is"):
        read("y", 1)


def test_an_hdf5_log_that_is_cut_short_is_named(tmp_path: Path) -> None:
    """The message of the library below does not say which of many files it was."""
    path = tmp_path / "cut.h5"
    with h5py.File(path, "w") as file:
        file["u"] = np.arange(5000.0)
    path.write_bytes(path.read_bytes()[:20000])
    with pytest.raises(DataError, match=r"cut\.h5: damaged, cut short or no HDF5 file .* copy it or export it again"):
        contents(path, TextFormatSpec())
