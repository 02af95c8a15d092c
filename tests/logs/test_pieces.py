"""A log that is too large for memory is measured in pieces: the same record, or all of it at once."""

from dataclasses import replace
from pathlib import Path

import h5py
import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from plants.lab_logs import N, Signals, measured, study_of, with_names
from plants.refusals import refused

from elastid.base import large_arrays
from elastid.base.large_arrays import LargeArray
from elastid.experiment.specs.experiment import ExperimentSpec
from elastid.frf import experiment_blocks
from elastid.frf import spectra as frf_spectra
from elastid.frf.estimate import estimate
from elastid.frf.spec import EstimatorSpec
from elastid.logs import rig
from elastid.logs.rig import piece_bounds
from elastid.record import Record
from elastid.store.measured import read_records, write_records

PERIODS = 40
NAMES = {"i1": "drive", "i2": "drive", "phi": "phi", "w2": "w2"}


@pytest.fixture
def large(monkeypatch: pytest.MonkeyPatch) -> None:
    """Everything is large from 8000 values on, and worked on 6400 at a time."""
    for module in (large_arrays, frf_spectra):
        monkeypatch.setattr(module, "MIN_LARGE_VALUES", 8000)
        monkeypatch.setattr(module, "PIECE_VALUES", 6400)
    monkeypatch.setattr(rig, "MIN_VALUES", 8000)


def _write(base: Path, log: Signals, extra: int = 0) -> ExperimentSpec:
    """Currents as columns of one matrix, motions of their own, in single precision; noise in all of them."""
    rng = np.random.default_rng(3)
    long = {name: np.resize(x[-2 * N :], PERIODS * N + extra) for name, x in log.items()}
    noisy = {name: x + 1e-3 * np.std(x) * rng.standard_normal(len(x)) for name, x in long.items()}
    with h5py.File(base / "log.h5", "w") as file:
        file["drive"] = np.stack([noisy["i1"], noisy["i2"]], axis=1).astype(np.float32)
        file["phi"], file["w2"] = (noisy[name].astype(np.float32) for name in ("phi", "w2"))
    i2, i1, *others = with_names(NAMES)
    return study_of("log.h5", (replace(i2, column=2), replace(i1, column=1), *others))


def _same(a: Record, b: Record) -> None:
    """But for rounding to single precision, in which the log stands."""
    assert a.discarded_periods == b.discarded_periods
    for role in ("u", "y"):
        np.testing.assert_allclose(getattr(a, role)[:], getattr(b, role), rtol=2.0**-24, atol=0)


@given(n=st.integers(8 * N, 80 * N), is_periodic=st.booleans())
@settings(max_examples=50, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_pieces_are_whole_periods_and_cover_the_log(large: None, n: int, is_periodic: bool) -> None:
    """The first of eight periods, all of so many values that they fit; none where the log fits or has few periods."""
    parts = piece_bounds(n, N if is_periodic else None, 4)
    if not parts:
        assert n * 4 < 8000 or (is_periodic and n < 16 * N)
        return
    starts, ends = zip(*parts, strict=True)
    assert (starts[0], starts[1:]) == (0, ends[:-1])
    assert ends[-1] == (n // N * N if is_periodic else n)
    sizes = np.diff([*starts, ends[-1]])
    assert sizes[0] == 8 * N or not is_periodic
    assert sizes.max() * 4 <= (2 if is_periodic else 1) * 8 * N * 4
    assert not is_periodic or np.all(sizes % N == 0)


def test_a_log_in_pieces_is_the_same_record(tmp_path: Path, log: Signals, request: pytest.FixtureRequest) -> None:
    """Sample by sample, with the note on the end that is no period; read from the file again it stays there."""
    spec = _write(tmp_path, log, extra=7)
    whole = measured(tmp_path, spec)
    request.getfixturevalue("large")
    parts = measured(tmp_path, spec)
    assert isinstance(parts.u, LargeArray)
    _same(parts, whole)
    assert {note.code for note in parts.notes} == {note.code for note in whole.notes}
    write_records(tmp_path / "records.h5", [parts])
    (read,) = read_records(tmp_path / "records.h5")
    assert isinstance(read.y, LargeArray)
    _same(read, whole)
    with h5py.File(tmp_path / "records.h5") as file:
        assert {file[f"records/{read.name}/{role}"].dtype for role in ("u", "y")} == {np.dtype(np.float32)}


def test_each_piece_is_repaired(tmp_path: Path, log: Signals, large: None) -> None:
    """A spike and a missing sample are filled from their own piece, and nothing else changes."""
    spec = _write(tmp_path, log)
    clean = measured(tmp_path, spec)
    with h5py.File(tmp_path / "log.h5", "r+") as file:
        file["w2"][12 * N + 70] += 0.2 * np.ptp(log["w2"])
        file["phi"][33 * N] = np.nan
    spoilt = measured(tmp_path, spec)
    assert spoilt.repairs == {"samples taken as missing": 1, "missing samples filled": 2}
    kept = np.r_[: 8 * N, 16 * N : 32 * N]
    np.testing.assert_array_equal(spoilt.y[:][kept], clean.y[:][kept])


@pytest.mark.parametrize("turns", [False, True])
def test_pieces_of_log_give_same_record(
    turns: bool, tmp_path: Path, log: Signals, request: pytest.FixtureRequest
) -> None:
    """To its last sample, with a missing one; as a whole where an angle starts again after a turn."""
    spec = _write(tmp_path, log, extra=7)
    recorded = replace(spec.as_recorded(), period_samples=None, period="none")
    with h5py.File(tmp_path / "log.h5", "r+") as file:
        file["w2"][3000] = np.nan
        if turns:
            file["phi"][...] = np.mod(np.linspace(0, 3000, PERIODS * N + 7), 360)
    whole = measured(tmp_path, replace(spec, recorded=recorded))
    request.getfixturevalue("large")
    parts = measured(tmp_path, replace(spec, recorded=recorded))
    assert isinstance(parts.u, LargeArray) != turns
    assert (parts.is_periodic, parts.n_samples, parts.period_samples) == (False, PERIODS * N + 7, PERIODS * N + 7)
    assert parts.repairs == whole.repairs == {"missing samples interpolated": 1}
    _same(parts, whole)


def test_a_large_record_has_the_same_response(
    tmp_path: Path, log: Signals, request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Lines are found, bad periods are left out by a few lines, and spectra are added up in groups of periods."""
    record = measured(tmp_path, _write(tmp_path, log))
    y = record.y.copy()
    y[7 * N + 100 : 7 * N + 300] *= -1
    y[: N // 2] += 0.1 * np.ptp(y, axis=0)
    one_input = [replace(record, inputs=record.inputs[:1], u=record.u[:, :1], y=y, r=record.u[:, :1])]
    spec = EstimatorSpec()
    expected = estimate(one_input, spec)
    request.getfixturevalue("large")
    monkeypatch.setattr(experiment_blocks, "_MAX_COMPARED_VALUES", 4000)
    found = estimate(one_input, spec)
    for code in ("frf/transient-discarded", "frf/periods-discarded"):
        assert (
            [note.code for note in found.notes].count(code) == [note.code for note in expected.notes].count(code) == 1
        )
    np.testing.assert_array_equal(found.freq_hz, expected.freq_hz)
    np.testing.assert_allclose(found.G, expected.G, rtol=1e-9)
    np.testing.assert_allclose(found.noise.variance, expected.noise.variance, rtol=1e-6)


def test_pieces_out_of_step_are_refused_like_whole_log(tmp_path: Path, log: Signals, large: None) -> None:
    """Samples lost between two pieces are found where the whole log is looked at."""
    spec = _write(tmp_path, log)
    with h5py.File(tmp_path / "log.h5", "r+") as file:
        for name in ("drive", "phi", "w2"):
            values = np.delete(file[name][:], np.arange(16 * N, 16 * N + 3), axis=0)
            del file[name]
            file[name] = values
    with refused("records/period-mismatch", holds="3 samples"):
        measured(tmp_path, spec)
