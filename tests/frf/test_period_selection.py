"""Periods of a record: transients and outliers are left out, good ones kept."""

from dataclasses import replace

import numpy as np
import pytest
from plants.marks import slow
from plants.measured import with_records
from plants.notes import said
from plants.paths import ROOT
from plants.refusals import refused
from plants.steady_record import AUTO, LINES, N, periods_of, steady_record

from elastid.frf import period_selection
from elastid.frf.period_selection import select_periods, without_transient
from elastid.frf.spec import EstimatorSpec
from elastid.logs.rig import RecordedRig
from elastid.record import Record
from elastid.study import load

BENCH_STUDY = ROOT / "configs" / "real" / "motor_bench.yml"


def _kept(record: Record, spec: EstimatorSpec = AUTO) -> tuple[list[int], tuple[str, ...]]:
    found = select_periods(periods_of(record, LINES, "acceleration"), spec)
    return found.periods.tolist(), said(found.notes)


@pytest.mark.parametrize(("periods", "noise"), [(3, 1e-3), (4, 1e-2), (6, 1e-3), (12, 1e-2)])
def test_a_transient_at_the_start_is_left_out_and_described(periods: int, noise: float) -> None:
    """A decaying oscillation of 30 % in the first period; the word names record, period, size and channel."""
    record = steady_record(periods, noise=noise)
    t = np.arange(record.n_samples) / N
    decaying = 0.3 * record.y.std() * np.exp(-8 * t) * np.sin(2 * np.pi * 9.3 * t)
    kept, notes = _kept(replace(record, y=record.y + 3 * decaying[:, None]))
    assert kept == list(range(1, periods))
    assert notes[0].startswith("record c-r0-e0: ")
    assert f" 1 of {periods} " in notes[0]
    assert "joint 1" in notes[0]


@pytest.mark.parametrize("seed", range(4))
def test_a_slow_transient_is_found_below_fast_noise(seed: int) -> None:
    """The angle of a loop that settles: all noise of its acceleration is at fast lines, all of the transient at slow
    ones, where it moves the damping of the motor. Without it all periods are kept."""
    record = steady_record(3, quantity="position", noise=2e-5, seed=seed)
    t = np.arange(record.n_samples) * 2.0 / N
    settling = 0.02 * record.y.std() * np.exp(-8 * t) * np.cos(12 * t)
    transient = select_periods(periods_of(replace(record, y=record.y + settling[:, None]), LINES, "acceleration"), AUTO)
    assert transient.periods.tolist() == [1, 2]
    assert len(select_periods(periods_of(record, LINES, "acceleration"), AUTO).periods) == 3


def test_stated_transient_is_discarded_in_any_case() -> None:
    """A number in the study; one that leaves less than two periods is refused."""
    assert _kept(steady_record(6), replace(AUTO, transient_periods=2))[0] == [2, 3, 4, 5]
    with refused("frf/periods", place="record c-r0-e0"):
        _kept(steady_record(4), replace(AUTO, transient_periods=3))


def test_second_period_is_steady_after_decay_of_first() -> None:
    """A transient of 3 % at the start of a log; of three periods their distances tell it, and the log stays.

    So does one whose transient is a millionth of the motion, however far above the noise.
    """
    for record, size in (
        (steady_record(2, noise=1e-4), 0.03),
        (steady_record(3, noise=1e-4), 0.03),
        (steady_record(2, noise=1e-9), 1e-6),
    ):
        t = np.arange(record.n_samples) / N
        decaying = size * record.y.std() * np.exp(-30 * t) * np.cos(60 * t)
        log = replace(record, y=record.y + decaying[:, None])
        expected = log.y[N:] if log.n_periods == 2 and size > 1e-3 else log.y
        np.testing.assert_array_equal(without_transient(log).y, expected)


@pytest.mark.parametrize("periods", [5, 8, 20])
def test_single_bad_periods_are_left_out_and_described(periods: int) -> None:
    """A burst of 10 % in one period, a lost sample in the encoder of another (from eight periods on)."""
    record = steady_record(periods, noise=0.01)
    y = record.y.copy()
    y[3 * N : 3 * N + 100] *= 1.2
    bad = [3]
    if periods >= 8:
        y[5 * N + 17] += 20 * y.std()
        bad.append(5)
    kept, notes = _kept(replace(record, y=y))
    assert kept == [p for p in range(periods) if p not in bad]
    assert f" {', '.join(str(p + 1) for p in bad)} of {periods} " in notes[0]


@pytest.mark.parametrize("n_lines", [4, slow(20), 75])
def test_good_periods_are_almost_never_left_out(n_lines: int) -> None:
    """Gaussian noise, 3 to 20 periods, few or many lines: less than one record in a hundred loses a period."""
    lost = 0
    for seed in range(400):
        record = steady_record((3, 4, 5, 7, 20)[seed % 5], noise=0.05, seed=seed)
        found = select_periods(periods_of(record, LINES[:n_lines], "acceleration"), AUTO)
        lost += len(found.periods) < record.n_periods
    assert lost <= 4


def test_bad_periods_of_real_bench_are_discarded() -> None:
    """The first of 20, and the 7th and 14th of those after it."""
    study = load(with_records(BENCH_STUDY)).study
    rig = RecordedRig(study.robot, study.experiment, BENCH_STUDY.parent)
    periods = periods_of(rig.measure(rig.experiments[0]), np.arange(11, 251), "acceleration")
    assert set(range(20)) - {*select_periods(periods, EstimatorSpec()).periods.tolist()} == {0, 7, 14}


def test_periods_of_a_slow_wander_are_kept() -> None:
    """A random walk has its scatter in few lines, where the distances of three or five periods differ by chance."""
    lost = 0
    for seed in range(100):
        record = steady_record((3, 5)[seed % 2], noise=1e-4, seed=seed)
        walk = np.cumsum(np.random.default_rng(seed).normal(size=record.u.shape), axis=0)
        wandering = replace(record, u=record.u + 2e-3 * record.u.std() * walk)
        lost += len(select_periods(periods_of(wandering, LINES, "acceleration"), AUTO).periods) < record.n_periods
    assert lost <= 1


def test_a_steady_drift_is_no_transient() -> None:
    """The first of four periods is far from the last two, and the last one as far from the first two."""
    record = steady_record(4, noise=1e-5)
    drifting = 1 + 0.01 * np.repeat(np.arange(4), N)[:, None]
    assert _kept(replace(record, y=record.y * drifting)) == ([0, 1, 2, 3], ())
    decaying = 1 + 0.01 * np.repeat([1.0, 0.3, 0.0, 0.0], N)[:, None]
    assert _kept(replace(record, y=record.y * decaying))[0] == [2, 3]


def test_long_record_compares_selected_periods(monkeypatch: pytest.MonkeyPatch) -> None:
    """Pairs of all would not fit into memory; the same bad periods are found, among those compared with or not."""
    record = steady_record(60, noise=0.01)
    y = record.y.copy()
    for bad in (3, 30, 47):
        y[bad * N : bad * N + 100] *= 1.5
    spoilt = replace(record, y=y)
    everything = _kept(spoilt)[0]
    monkeypatch.setattr(period_selection, "MAX_PAIRS", 1)
    monkeypatch.setattr(period_selection, "MIN_COMPARED", 12)
    assert _kept(spoilt)[0] == everything
    assert set(range(60)) - set(everything) == {3, 30, 47}
