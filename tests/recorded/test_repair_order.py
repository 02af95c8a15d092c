"""Logs with the faults of a real robot, from the file to the response: what is mended equals the clean one."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
from plants.notes import said
from plants.refusals import refused

from elastid.base.arrays import ComplexArray, FloatArray
from elastid.base.errors import DataError
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


def _spec(path: str = "log.h5", **changes: Any) -> ExperimentSpec:
    keys: dict[str, Any] = {"rate_hz": RATE, "period_samples": N, "channels": CHANNELS}
    keys["files"] = (FileSpec(path, "home"),)
    return ExperimentSpec({"home": (0.0,)}, recorded=RecordedSpec(**(keys | changes)))


def _measure(base: Path, spec: ExperimentSpec) -> Record:
    rig = RecordedRig(ROBOT, spec, base)
    return rig.measure(rig.experiments[0])


def write_log(path: Path, signals: Mapping[str, FloatArray]) -> None:
    """One dataset a channel."""
    with h5py.File(path, "w") as file:
        for name, values in signals.items():
            file[name] = values


def _of(base: Path, signals: Mapping[str, FloatArray]) -> Record:
    write_log(base / "log.h5", signals)
    return _measure(base, _spec())


def _error(record: Record) -> float:
    """The largest error of the response relative to the plant, at all lines."""
    response = estimate([record], EstimatorSpec(quantity="position"), LINES)
    assert response.n_lines == len(LINES)
    return float(np.max(np.abs(response.G[:, 0, 0] / plant(response.freq_hz) - 1)))


def _spoilt(name: str, at: Any, value: Any) -> dict[str, FloatArray]:
    column = CLEAN[name].copy()
    column[at] = value
    return CLEAN | {name: column}


def _all(change: Any) -> dict[str, FloatArray]:
    return {name: change(column) for name, column in CLEAN.items()}


FAULTS: list[tuple[str, dict[str, FloatArray], dict[str, int], float]] = [
    ("nothing", CLEAN, {}, 1.0),
    ("missing samples", _spoilt("y", [10, 11, 900, 2999], np.nan), {"missing samples filled": 4}, 1.2),
    ("a gap in all", _all(lambda x: np.r_[x[:800], np.full(30, np.inf), x[830:]]), {"missing samples filled": 90}, 1.5),
    (
        "most of a period missing",
        _all(lambda x: np.r_[x[:1100], np.full(200, np.nan), x[1300:]]),
        {"missing samples filled": 600, "repetitions left out": 1},
        1.5,
    ),
    (
        "spikes",
        _spoilt("y", [77, 1234, 2500], 5 * CLEAN["y"].max()),
        {"samples taken as missing": 3},
        1.2,
    ),
    (
        "a spike of the torque",
        _spoilt("u", [1777], -5.0),
        {"samples taken as missing": 1},
        1.2,
    ),
    ("a drift", CLEAN | {"y": CLEAN["y"] + 100 * CLEAN["y"].std() * np.linspace(0, 1, P * N)}, {}, 1.2),
]


@pytest.mark.parametrize(("signals", "repairs", "worse"), [f[1:] for f in FAULTS], ids=[f[0] for f in FAULTS])
def test_the_response_of_a_mended_log_is_as_exact_as_that_of_a_clean_one(
    signals: dict[str, FloatArray], repairs: dict[str, int], worse: float, tmp_path: Path
) -> None:
    """At most half as wrong again as with the noise alone (1e-4 of each signal); every repair counted and said."""
    clean, mended = _of(tmp_path, CLEAN), _of(tmp_path, signals)
    assert _error(clean) < 0.02
    assert _error(mended) < worse * _error(clean) + 1e-12
    assert mended.repairs == repairs
    assert len(said(mended.notes)) >= bool(repairs)
    assert all(note.startswith("record home-r0-e0: ") for note in said(mended.notes))


def test_without_its_repair_each_fault_would_spoil_the_response(tmp_path: Path) -> None:
    """The test above can fail: a spike alone makes the response thirty times worse."""
    record = _of(tmp_path, CLEAN)
    y = record.y.copy()
    y[[77, 1234, 2500], 0] = 5 * y.max()
    plain = replace(record, y=y)
    response = estimate([plain], EstimatorSpec(quantity="position", outlier_sigma=1e9), LINES)
    assert np.max(np.abs(response.G[:, 0, 0] / plant(response.freq_hz) - 1)) > 30 * _error(record)


def test_a_clipped_torque_is_counted_or_refused(tmp_path: Path) -> None:
    """At its largest 4 % a word; at a tenth refused with what to do."""
    limit = float(np.quantile(np.abs(CLEAN["u"]), 0.96))
    record = _of(tmp_path, CLEAN | {"u": np.clip(CLEAN["u"], -limit, limit)})
    assert record.repairs.keys() == {"samples at a limit"}
    with pytest.raises(DataError, match=r"u \(u at motor 1\): .* it is clipped; measure again with less torque"):
        _of(tmp_path, CLEAN | {"u": np.clip(CLEAN["u"], -0.5, 0.5)})


def test_a_slow_carrier_is_no_analysed_line(tmp_path: Path) -> None:
    """Thirty times the excitation on line 1 of u and y, r without: only the excited lines."""
    size = 30 * np.array([CLEAN["u"].std(), CLEAN["y"].std()])
    carrier = np.sin(2 * np.pi * np.arange(P * N) / N)
    record = _of(tmp_path, CLEAN | {"u": CLEAN["u"] + size[0] * carrier, "y": CLEAN["y"] + size[1] * carrier})
    response = estimate([record], EstimatorSpec(quantity="position"))
    np.testing.assert_allclose(response.freq_hz, LINES * RATE / N)


@pytest.mark.parametrize(("lost", "place"), [([1700, 1701], 1700), ([400], 400), ([2600, 2601, 2602], 2600)])
def test_lost_samples_are_refused_with_their_place(lost: list[int], place: int, tmp_path: Path) -> None:
    """What follows is shifted against what was before; a sample that is there twice likewise."""
    with refused("records/period-mismatch") as error:
        _of(tmp_path, _all(lambda x: np.delete(x, lost)))
    near = re.search(r"(\d+) samples are lost near sample (\d+)", str(error.value))
    assert near is not None, str(error.value)
    assert int(near[1]) == len(lost)
    assert abs(int(near[2]) - place) <= N // 8
    with refused("records/period-mismatch"):
        _of(tmp_path, _all(lambda x: np.insert(x, 1700, x[1700:1703])))


def test_records_of_unequal_numbers_of_periods_go_together(tmp_path: Path) -> None:
    """Realisations of 4 and 7 periods: the response is exact, its noise variance that of the mean of both."""
    estimated, errors = [], []
    for seed in range(12):
        for m, periods in enumerate((4, 7)):
            write_log(tmp_path / f"{m}.h5", log(np.arange(periods * N), seed=100 * seed + m, noise=1e-2))
        files = tuple(FileSpec(f"{m}.h5", "home", realisation=m) for m in (0, 1))
        rig = RecordedRig(ROBOT, _spec(files=files), tmp_path)
        records = [rig.measure(experiment) for experiment in rig.experiments]
        assert [record.n_periods for record in records] == [4, 7]
        response = estimate(records, EstimatorSpec(quantity="position"), LINES)
        assert response.noise is not None
        truth = plant(response.freq_hz)
        estimated.append(response.noise.variance[:, 0, 0] / np.abs(truth) ** 2)
        errors.append(np.abs(response.G[:, 0, 0] / truth - 1) ** 2)
    assert np.mean(np.median(estimated, axis=0) / np.mean(errors, axis=0)) == pytest.approx(1.0, abs=0.3)
