"""Texts as people have them: languages, units, separators, codes of letters, remarks; one axis at 250 Hz."""

import re
from collections.abc import Callable
from datetime import datetime, timedelta
from pathlib import Path
from typing import NamedTuple

import h5py
import numpy as np
import pytest
from plants.drafts import drafted, save
from plants.friction_study import friction_study
from plants.refusals import refused

from elastid.app.from_log import texts_from_logs
from elastid.base.errors import notes_of
from elastid.experiment.specs.channels import ChannelSpec
from elastid.experiment.specs.logs import TextFormatSpec
from elastid.logs.files.formats import open_log, read_channels
from elastid.logs.friction_logs import read_friction_logs

N, RATE = 1500, 250.0
T = np.arange(N) / RATE
Q = 0.8 * np.sin(1.9 * T) + 0.3 * np.sin(4.4 * T + 1)
V = np.gradient(Q, 1 / RATE)
U = 0.05 * np.gradient(V, 1 / RATE) + 0.08 * V + 0.3 * np.sign(V)
DEG, RPM = 180 / np.pi, 30 / np.pi


class Log(NamedTuple):
    """A log and what is right: units of torque and position (``?``: asked for), with scales of the columns."""

    head: str
    units: tuple[str, str]
    scales: tuple[float, ...] = (1.0, 1.0, 1.0)
    sep: str = ","
    decimal: str = "."
    code: str = "utf-8"
    end: str = ""
    digits: str = "%.7g"


SI = ("N*m", "rad")
LOGS = {
    "German": Log("Zeit [ms];Drehmoment [mNm];Winkel [°]", ("mN*m", "deg"), (1e3, 1e3, DEG), ";", ",", "cp1252"),
    "French": Log("temps (ms);couple (N.m);position (rad)", SI, (1e3, 1, 1), ";", ","),
    "French, no units": Log("temps,couple,position", SI),
    "Spanish, no units": Log("tiempo,par,posicion", SI),
    "Italian": Log("tempo [s];coppia [Nm];posizione [rad]", SI, (1, 1, 1), ";"),
    "Swedish": Log("tid [s]\tmoment [Nm]\tläge [grader]", ("N*m", "deg"), (1, 1, DEG), "\t"),
    "Portuguese": Log("tempo (s),torque (N.m),posição (graus)", ("N*m", "deg"), (1, 1, DEG)),
    "Japanese": Log("時間[s],トルク[Nm],位置[deg]", ("N*m", "deg"), (1, 1, DEG), code="shift_jis"),
    "Chinese, wide brackets": Log("时间（s）,力矩（Nm）,角度（deg）", ("N*m", "deg"), (1, 1, DEG)),
    "centimetres": Log("Time (s),Torque (Ncm),Angle (deg)", ("N*cm", "deg"), (1, 100, DEG)),
    "kilopond": Log("t,Torque [kgf.cm],Angle [deg]", ("?", "deg"), (1, 10, DEG)),
    "per mille": Log("Time [ms];Actual torque [‰];Position [increments]", ("?", "?"), (1e3, 500, 1e4), ";"),
    "thousandths": Log("Time [ms]\tTorque [1/1000]\tPosition [qc]", ("?", "?"), (1e3, 900, 318), "\t"),
    "whole numbers": Log("timestamp,current,position", ("?", "?"), (1e3, 300, 652), digits="%.0f"),
    "turns": Log("timestamp_us,motor_torque_Nm,motor_pos_turns", ("N*m", "rev"), (1e6, 1, 0.5 / np.pi)),
    "thousands": Log("t [ms];torque [mNm];position [mrad]", ("mN*m", "mrad"), (1e3, 1e3, 1e3), ";", ","),
    "unit row": Log("t;Moment;Winkel\n s; Nm; deg", ("N*m", "deg"), (1, 1, DEG), ";", ","),
    "properties": Log("Logger 7\nDate,2024-05-01\nRate,250\n\nt [s],Torque [Nm],Angle [rad]", SI),
    "comment of MATLAB": Log("% t torque position", SI, sep=" "),
    "comment of C": Log("// t,torque,position", SI),
    "bars": Log("t|torque|position", SI, sep="|"),
    "remarks": Log("t,torque,position", SI, end="# 1500 samples\n\n-- end --\nchecksum,12ab\n"),
    "16 bits": Log("Time\tTorque\tPosition", SI, sep="\t", code="utf-16"),
    "16 bits, no mark": Log("Time,Torque,Position", SI, code="utf-16-le"),
    "32 bits": Log("Time,Torque,Position", SI, code="utf-32"),
    "equal headings": Log("t,Torque,Position,Position", SI),
    "time twice": Log("t,torque,position,t", SI),
}


@pytest.mark.parametrize("mark", [b"PK\3\4", b"\x28\xb5\x2f\xfd"])
def test_archives_are_refused(mark: bytes, tmp_path: Path) -> None:
    (tmp_path / "log.csv").write_bytes(mark + bytes(100))
    with refused("files/damaged"):
        texts_from_logs(tmp_path, [tmp_path / "log.csv"])


@pytest.mark.parametrize(
    ("heading", "code"),
    [("トルク[Nm]", "cp932"), ("力矩[Nm]", "gb2312"), ("Größe läge ÄÖ °C", "cp1252"), ("couple é à", "cp1252")],
)
def test_headings_in_legacy_encodings_are_decoded(heading: str, code: str, tmp_path: Path) -> None:
    (tmp_path / "log.csv").write_text(f"t,{heading},x\n0,1,2\n1,2,3\n", encoding=code)
    with open_log(tmp_path / "log.csv", TextFormatSpec()) as log:
        assert heading in log.headings


@pytest.mark.parametrize("name", LOGS)
def test_units_of_a_log_are_read_or_asked_for(name: str, tmp_path: Path) -> None:
    log = LOGS[name]
    columns = np.stack([x * scale for x, scale in zip((T, U, Q), log.scales, strict=True)], axis=1)
    if log.head.count(log.sep) == 3 and not log.head.startswith("%"):
        columns = np.column_stack([columns, columns[:, 0] if log.head.endswith("t") else 0.5 * columns[:, 2]])
    rows = [log.sep.join((log.digits % x).replace(".", log.decimal) for x in row) for row in columns.tolist()]
    (tmp_path / "log.csv").write_bytes(f"{log.head}\n{chr(10).join(rows)}\n{log.end}".encode(log.code))
    study = drafted(tmp_path, tmp_path / "log.csv")
    recorded = study.experiment.as_recorded()
    assert study.friction is not None
    assert recorded.known_rate_hz == pytest.approx(RATE, rel=1e-3)
    text = (tmp_path / "new" / "study.yml").read_text(encoding="utf-8")
    lines = [line for line in text.splitlines() if "- {role: " in line]
    for channel, line, unit in zip(recorded.channels, lines, log.units, strict=True):
        assert ("# guessed: ?" in line) == (unit == "?"), line
        assert unit in ("?", channel.unit)


@pytest.mark.parametrize("form", ["%Y-%m-%dT%H:%M:%S.%fZ", "%d.%m.%Y %H:%M:%S,%f", "%H:%M:%S.%f"])
def test_dates_and_times_of_day_are_a_clock(form: str, tmp_path: Path) -> None:
    start, comma = datetime(2024, 5, 1, 9, 30), "," if "," in form else "."
    stamps = [(start + timedelta(seconds=t)).strftime(form) for t in T.tolist()]
    numbers = [f"{u:.7f};{q:.7f}".replace(".", comma) for u, q in zip(U.tolist(), Q.tolist(), strict=True)]
    rows = [f"{stamp};{row}" for stamp, row in zip(stamps, numbers, strict=True)]
    (tmp_path / "log.csv").write_text("time;torque;position\n" + "\n".join(rows) + "\n")
    text = texts_from_logs(tmp_path / "new", [tmp_path / "log.csv"])["study.yml"]
    assert "rate_hz: 250 " in text
    assert "friction:" in text


def test_torque_without_own_motion_is_not_used(tmp_path: Path) -> None:
    """One position is the motion of one motor."""
    study = drafted(tmp_path, save(tmp_path / "log.csv", "t,tau_1,tau_2,q_1", T, U, 0.5 * U, Q))
    channels = study.experiment.as_recorded().channels
    assert [(channel.role, channel.name_in_file) for channel in channels] == [("u", "tau_1"), ("y", "q_1")]


def rows_with(edit: Callable[[np.ndarray], np.ndarray | None]) -> Callable[[], list[str]]:
    """Rows of the log with a fault of its numbers (n, 3)."""

    def rows() -> list[str]:
        rng = np.random.default_rng(0)
        table = np.stack([LONG, *motion_of(LONG)], axis=1)
        table[:, 1:] += [2e-3, 1e-5] * rng.standard_normal((len(LONG), 2))
        changed = edit(table)
        return [",".join(f"{x:.7g}" for x in row) for row in (table if changed is None else changed)]

    return rows


LONG = np.arange(4000) / RATE


def motion_of(t: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Torque and position of an axis of 0.05 kg*m^2, 0.08 N*m*s/rad and 0.3 N*m."""
    q, v, a = (
        sum(x * w**k * np.sin(w * t + p + k * np.pi / 2) for x, w, p in ((0.8, 1.9, 0), (0.3, 4.4, 1)))
        for k in (0, 1, 2)
    )
    return 0.05 * a + 0.08 * v + 0.3 * np.sign(v), q


def put(value: float, column: int, first: int, end: int) -> Callable[[], list[str]]:
    return rows_with(lambda x: x.__setitem__((slice(first, end), column), value))


def held(column: int) -> Callable[[], list[str]]:
    return rows_with(lambda x: x.__setitem__((slice(2000, 2200), column), x[2000, column]))


FAULTS = {
    "none": rows_with(lambda x: None),
    "row lost": rows_with(lambda x: np.delete(x, 2000, 0)),
    "row twice": rows_with(lambda x: np.insert(x, 2000, x[2000], 0)),
    "rows swapped": rows_with(lambda x: x[np.r_[0:2000, 2001, 2000, 2002:4000]]),
    "clock set back": rows_with(lambda x: np.column_stack([x[:, 0] - 3 * (LONG > 8), x[:, 1:]])),
    "clock set forward": rows_with(lambda x: np.column_stack([x[:, 0] + 5 * (LONG > 8), x[:, 1:]])),
    "1 % lost, times in ms": rows_with(lambda x: np.delete(x * [1e3, 1, 1], np.arange(50, 4000, 101), 0)),
    "one spike": put(1e3, 2, 2000, 2001),
    "impossible value": put(-1e308, 1, 2000, 2001),
    "time of zero": put(0, 0, 2000, 2001),
    "spikes beside each other": rows_with(lambda x: x.__setitem__((np.r_[50:4000:170, 55:4000:170], 2), 50.0)),
    "no numbers at the start": put(np.nan, 2, 0, 150),
    "no numbers for a time": put(np.nan, 1, 2000, 2100),
    "torque hangs": held(1),
    "position hangs": held(2),
    "torque drops to 0": put(0, 1, 2000, 2200),
    "heading again": lambda: [*(rows := FAULTS["none"]())[:2000], "time,tau_1,q_1", *rows[2000:]],
    "division by zero": lambda: [r if i != 2000 else "8.0,#DIV/0!,0.1" for i, r in enumerate(FAULTS["none"]())],
    "cut off": lambda: [r if i != 3999 else r[:9] for i, r in enumerate(FAULTS["none"]())],
}


@pytest.mark.slow
@pytest.mark.parametrize("fault", FAULTS)
def test_one_fault_of_a_log_changes_no_number(fault: str, tmp_path: Path) -> None:
    """Inertia, viscous and Coulomb friction to 1 % from what `new` writes and `check` accepts."""
    (tmp_path / "log.csv").write_text("\n".join(["time,tau_1,q_1", *FAULTS[fault]()]) + "\n")
    study = drafted(tmp_path, tmp_path / "log.csv")
    robot = study.as_robot()
    measured = read_friction_logs(robot, study.experiment, tmp_path / "new", robot.driven_names, {})
    result = friction_study(robot, measured, study.as_friction())
    numbers = {row.name: row.value for row in result.numbers}
    assert numbers["J_m1"] == pytest.approx(0.05, rel=0.01)
    assert numbers["f_m1"] == pytest.approx(0.08, rel=0.01)
    assert numbers["Fc_m1"] == pytest.approx(0.3, rel=0.01)
    said = [*measured.notes, *notes_of(measured.records)]
    assert fault in ("none", "heading again", "time of zero", "cut off") or said


def test_tdms_channels_with_own_rates_are_aligned(tmp_path: Path) -> None:
    """Torque at four times the rate of the position, which begins 0.4 s later."""
    nptdms = pytest.importorskip("nptdms")
    fast, start = np.arange(4 * len(LONG)) / (4 * RATE), np.datetime64("2024-05-01T10:00:00.000000")
    rows = (("torque", motion_of(fast)[0], 4 * RATE, 0, "Nm"), ("position", motion_of(LONG)[1], RATE, 400, "rad"))
    channels = []
    for label, x, rate, late, unit in rows:
        properties = {"wf_start_time": start + np.timedelta64(late, "ms"), "wf_increment": 1 / rate}
        values, properties = x[round(late * rate / 1e3) :], properties | {"unit_string": unit}
        channels.append(nptdms.ChannelObject("log", label, values, properties=properties))
    with nptdms.TdmsWriter(tmp_path / "log.tdms") as writer:
        writer.write_segment(channels)
    study = drafted(tmp_path, tmp_path / "log.tdms")
    robot = study.as_robot()
    (record,) = read_friction_logs(robot, study.experiment, tmp_path / "new", robot.driven_names, {}).records
    torque, position = motion_of(0.4 + np.arange(len(record.position)) / RATE)
    np.testing.assert_allclose(record.position, position, atol=1e-9)
    assert np.median(np.abs(record.torque - torque)) < 1e-3


def test_cells_of_matlab_7_3_are_names_and_units(tmp_path: Path) -> None:
    """Of an iddata struct."""
    with h5py.File(tmp_path / "log.mat", "w", userblock_size=512) as file:
        group, texts = file.create_group("data"), file.create_group("#refs#")
        for name, values in (("InputData", U), ("OutputData", Q), ("Ts", np.array([1 / RATE]))):
            group.create_dataset(name, data=values[None])
        for name, words in (("InputName", "motor"), ("OutputName", "arm"), ("InputUnit", "N*m"), ("OutputUnit", "rad")):
            cell = texts.create_dataset(name, data=np.array([[ord(letter)] for letter in words], np.uint16))
            cell.attrs["MATLAB_class"] = np.bytes_("char")
            references = np.array([[cell.ref]], dtype=h5py.ref_dtype)
            group.create_dataset(name, data=references, dtype=h5py.ref_dtype).attrs["MATLAB_class"] = np.bytes_("cell")
    content = bytearray((tmp_path / "log.mat").read_bytes())
    content[:128] = b"MATLAB 7.3 MAT-file".ljust(124) + b"\x00\x02IM"
    (tmp_path / "log.mat").write_bytes(bytes(content))
    text = texts_from_logs(tmp_path / "new", [tmp_path / "log.mat"])["study.yml"]
    assert "channel: data.InputData, quantity: torque, unit: N*m}" in text
    assert "channel: data.OutputData, quantity: position, unit: rad}" in text
    assert "rate_hz: 250 " in text


def test_exponents_of_fortran_and_other_functions_of_universal_files(tmp_path: Path) -> None:
    """Time histories are read with rate and units; power spectra are refused by their name."""
    pyuff = pytest.importorskip("pyuff")
    keys = {"rsp_dir": 3, "ref_dir": 0, "ref_node": 0, "id1": "", "rsp_ent_name": "NONE", "ref_ent_name": "NONE"}
    keys |= {"abscissa_spacing": 1, "abscissa_inc": 1 / RATE, "abscissa_spec_data_type": 17, "x": T, "type": 58}
    keys |= {"orddenom_spec_data_type": 0}
    for kind, name in ((1, "log.uff"), (2, "psd.uff")):
        for node, x in enumerate((U, Q), start=1):
            data = {"data": x if kind == 1 else x**2, "func_type": kind, "rsp_node": node}
            units = {"ordinate_spec_data_type": 14 - node, "ordinate_axis_units_lab": ("N", "m/s^2")[node - 1]}
            pyuff.UFF(str(tmp_path / name)).write_sets(keys | data | units, "add" if node > 1 else "overwrite")
    path = tmp_path / "log.uff"
    path.write_text(re.sub(r"(\d)[eE]([+-]\d\d)", r"\1D\2", path.read_text()))
    with open_log(path, TextFormatSpec()) as opened:
        assert [(x.units, x.rate_hz) for x in opened.arrays.values()] == [("N", RATE), ("m/s^2", RATE)]
    log = read_channels(path, [ChannelSpec("u", "1z", "1z", quantity="force")], TextFormatSpec())
    np.testing.assert_allclose(log[:, 0], U, atol=1e-6)
    with refused("responses/table", place="psd.uff", holds="auto spectrum"):
        texts_from_logs(tmp_path / "new", [tmp_path / "psd.uff"])


def test_signals_of_different_lengths_without_rates_are_refused(tmp_path: Path) -> None:
    """As of two topics."""
    np.savez(tmp_path / "log.npz", tau_1=U[::5], q_1=Q)
    with refused("records/clock", place="log.npz", holds=("tau_1 300", "q_1 1500")):
        texts_from_logs(tmp_path / "new", [tmp_path / "log.npz"])
