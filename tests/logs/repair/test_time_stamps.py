"""Time stamps: grids that they lie on, and signals at instants that lie on none."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from plants.marks import slow
from plants.refusals import refused
from plants.waves import CLEAN, DRIFT, LOG, N, P, outcome, wave

from elastid.base.arrays import FloatArray
from elastid.logs.repair import Findings, LogReport
from elastid.logs.repair.clock_drift import estimate_delay, resample_to_generator
from elastid.logs.repair.time_stamps import (
    GAPS,
    JITTER,
    SET_BACK,
    describe_steps,
    even_grid,
    resample_to_rate,
    sampling_times,
    stamp_line,
    without_jumps,
)

RNG = np.random.default_rng(5)


def waves(t: FloatArray, highest_hz: float) -> FloatArray:
    """Two signals (n, 2) of twenty sines each, one with a ramp, at times t in s."""
    rng = np.random.default_rng(3)
    freq_hz, phase = rng.uniform(0.1, highest_hz, (2, 20)), rng.uniform(0, 2 * np.pi, (2, 20))
    sines = [np.cos(2 * np.pi * np.outer(t, f) + p).sum(axis=1) for f, p in zip(freq_hz, phase, strict=True)]
    return np.stack(sines, axis=1) + np.outer(t, [0.0, 2.0])


def on_grid(t: FloatArray, signals: FloatArray, rate_hz: float, log: LogReport) -> FloatArray:
    return resample_to_rate(*sampling_times(t, signals, log), rate_hz, log)


def test_gaps_in_even_times_become_missing_samples() -> None:
    """Stamps to a hundredth of a sample, and a clock 200 ppm off, change no sample."""
    t = np.arange(100) / 1000 * (1 + 2e-4) + 1e-5 * np.random.default_rng(1).uniform(-1, 1, 100)
    left = np.r_[0:20, 23:70, 71:100]
    x = np.arange(100.0)[:, None]
    repaired, findings = outcome(on_grid, t[left], x[left], 1000.0)
    assert np.flatnonzero(np.isnan(repaired[:, 0])).tolist() == [20, 21, 22, 70]
    assert findings == {GAPS: 4}
    np.testing.assert_array_equal(repaired[left], x[left])
    assert not outcome(on_grid, t, x, 1000.0)[1]


UNEVEN = {
    "10 or 12 ms": (np.cumsum(RNG.choice([0.010, 0.012], 3000)), 100.0, 35.0),
    "jitter of a fifth": (np.arange(5000) / 1000 + RNG.uniform(-2e-4, 2e-4, 5000), 1000.0, 400.0),
    "another rate": (7.0 + np.arange(4000) / 98, 100.0, 40.0),
    "UNIX time": (1.7e9 + np.cumsum(RNG.choice([0.010, 0.012], 3000)), 100.0, 35.0),
    "more than a block": (np.cumsum(RNG.uniform(0.8e-3, 1.2e-3, 40_000)), 900.0, 300.0),
}


@pytest.mark.parametrize("kind", UNEVEN)
@pytest.mark.slow
def test_band_limited_signal_is_equal_on_even_grid(kind: str) -> None:
    """To 1e-4 of its size but near the ends, and the message states the steps and the band."""
    t, rate_hz, highest_hz = UNEVEN[kind]
    log = replace(LOG, findings=Findings())
    repaired = on_grid(t, waves(t - t[0], highest_hz), rate_hz, log)
    grid = np.arange(len(repaired)) / rate_hz
    assert grid[-1] == pytest.approx(t[-1] - t[0], abs=1 / rate_hz)
    error = repaired - waves(grid, highest_hz)
    assert np.abs(error[60:-60]).max() < 1e-4 * waves(grid, highest_hz)[:, 0].std() + 1e-3 * ("UNIX" in kind)
    assert describe_steps(t - t[0]) in log.findings.notes[0].text


@pytest.mark.parametrize("jitter", [slow(0.05), slow(0.2), 0.45])
@pytest.mark.parametrize("highest_hz", [20.0, 300.0])
def test_stamps_of_an_even_sampling_do_not_move_samples(jitter: float, highest_hz: float) -> None:
    """Rows of a controller whose logger stamps late; noise of 1e-3, a rate that is 100 ppm off."""
    rng, rows = np.random.default_rng(7), np.arange(3000)
    t = (rows + rng.uniform(-jitter, jitter, len(rows))) / 1000.1
    signals = waves(rows / 1000, highest_hz) + 1e-3 * rng.normal(size=(len(rows), 2))
    repaired, findings = outcome(on_grid, t, signals, 1000.0)
    np.testing.assert_array_equal(repaired, signals)
    assert findings == {JITTER: 3000}


def test_a_lower_rate_leaves_frequencies_beyond_its_band_out() -> None:
    """1 kHz to 500 Hz: 320 Hz, which would be read as 180 Hz, to 1e-5; 100 Hz stays."""
    t = np.arange(4000) / 1000
    signals = np.sin(2 * np.pi * np.outer(t, [320.0, 100.0]))
    repaired = on_grid(t, signals, 500.0, LOG)
    grid = np.arange(len(repaired)) / 500
    assert np.abs(repaired[100:-100, 0]).max() < 1e-5
    np.testing.assert_allclose(repaired[100:-100, 1], np.sin(200 * np.pi * grid)[100:-100], atol=1e-5)


def test_long_pause_and_empty_channel_stay_missing() -> None:
    """40 s at 1 kHz, and a channel that was never logged."""
    t = np.cumsum(np.random.default_rng(6).uniform(0.8e-3, 1.2e-3, 20_000))
    t[10_000:] += 40.0
    signals = waves(t, 100.0)
    signals[:, 1] = np.nan
    repaired, findings = outcome(on_grid, t, signals, 1000.0)
    missing = np.isnan(repaired)
    assert missing[:, 1].all()
    assert missing[:, 0].sum() == pytest.approx(40_000, abs=3)
    assert findings[GAPS] == missing[:, 0].sum()


@pytest.mark.parametrize(
    ("stamps", "rate_hz"),
    [
        (lambda k: k / 1000, 1000.0),
        (lambda k: np.round(k / 400, 3), 400.0),
        (lambda k: np.round(1.7e9 + k / 250, 2), 250.0),
        (lambda k: 1.7e9 + k / 51200, 51200.0),
        (lambda k: np.array([float(f"{each / 256:.4g}") for each in k]), 256.0),
        (lambda k: np.floor(k / 1000 * 64) / 64, 1000.0),
    ],
    ids=["exact", "2 and 3 ms in turn", "UNIX time in 10 ms", "fast UNIX time", "four digits", "no decimal step"],
)
def test_rounded_stamps_lie_on_an_even_grid(stamps: Callable[[FloatArray], FloatArray], rate_hz: float) -> None:
    """But those that are rounded to no decimal step: their deviations are taken for what they say."""
    grid = even_grid(stamps(np.arange(4000.0)))
    if rate_hz == 1000.0 and stamps(np.ones(1)) == 0:
        assert grid is None
    else:
        assert grid[1] == pytest.approx(rate_hz, rel=1e-6)


@pytest.mark.parametrize("lateness", ["bursts", "queue", "rounding"])
def test_lost_messages_are_counted_among_late_ones(lateness: str) -> None:
    """Of 20 000 at 501.3 Hz, 1 % of which are lost; stamps are late by up to five periods."""
    rng, T = np.random.default_rng(8), 1 / 501.3
    rows = np.delete(np.arange(20_000), rng.choice(np.arange(1, 19_900), 200, replace=False))
    due = T * rows
    late = {
        "bursts": due[np.minimum(np.arange(len(due)) // 5 * 5 + 4, len(due) - 1)] + 1e-5 * (np.arange(len(due)) % 5),
        "queue": np.maximum.accumulate(due + 0.25 * T * rng.exponential(size=len(due))),
        "rounding": np.floor(1e4 * due) / 1e4,
    }[lateness]
    line = stamp_line(1.7e9 + late)
    assert line.rate_hz == pytest.approx(501.3, rel=1e-6)
    is_late = np.abs(line.rows - rows) > 0
    assert is_late.mean() <= (0.04 if lateness == "bursts" else 0.002)
    assert line.rows[-1] == rows[-1]
    assert np.abs(line.times_s - 1.7e9 - due)[~is_late].max() < 0.05 * T


def test_times_that_hold_too_little_are_refused_with_what_to_state() -> None:
    """A rate that the stamps do not have, another unit, a clock that falls, is missing or stands."""
    t = np.cumsum(np.random.default_rng(4).choice([0.010, 0.012], 2000))
    with refused("records/clock", place="log.csv", holds=("37.5 Hz", "90 Hz", "rate_hz 200", "rate_hz: 83")):
        on_grid(t, t[:, None], 200.0, LOG)
    resample_to_generator, findings = outcome(on_grid, t, t[:, None], 83.0)
    assert findings
    assert len(resample_to_generator) == int((t[-1] - t[0]) * 83.0) + 1
    with refused("records/clock", place="log.csv", holds="sample 50"):
        on_grid(np.where(np.arange(2000) < 50, t, -t), t[:, None], 100.0, LOG)
    with refused("records/clock", place="log.csv", holds="sample 7"):
        on_grid(np.where(np.arange(2000) == 7, np.nan, t), t[:, None], 100.0, LOG)
    for wrong in (np.zeros(2000), 1e3 * t, 1e9 * t, t / 60):
        with refused("records/clock", place="log.csv"):
            on_grid(wrong, t[:, None], 100.0, LOG)


@pytest.mark.parametrize(("jump_s", "first"), [(0.0, 700), (-3.0, 700), (3e7, 700), (-500.0, 3)])
def test_reordered_messages_are_sorted_and_a_set_clock_splits(jump_s: float, first: int) -> None:
    """The gap is of unknown length if the clock falls by 3 s, jumps by a year, or begins with wrong stamps."""
    t, rows = np.arange(2000) / 100, np.arange(2000)
    if not jump_s:
        rows[[700, 701, 1500, 1501]] = rows[[701, 700, 1501, 1500]]
    stamps = t[rows] + jump_s * (rows >= first)
    gridded, findings = outcome(on_grid, stamps, np.sin(t[rows])[:, None], 100.0)
    missing = np.flatnonzero(np.isnan(gridded[:, 0]))
    assert missing.tolist() == [first, first + 1, first + 2] * bool(jump_s)
    np.testing.assert_array_equal(np.delete(gridded[:, 0], missing), np.sin(t))
    assert findings == ({SET_BACK: 1, GAPS: 3} if jump_s else {"rows sorted by time": 2})
    assert not without_jumps(t[:2])[1].size  # a single increase: no other increases for the comparison


@settings(max_examples=20, deadline=None)
@given(tau=st.floats(-240, 240), noise=st.sampled_from([0.0, 0.3]))
def test_delay_between_logs_is_exact_to_hundredth_sample(tau: float, noise: float) -> None:
    """Any delay within half a period, with noise on both."""
    rng = np.random.default_rng(1)
    a, b = wave(np.arange(P * N))[:, 0], wave(np.arange(P * N) - tau)[:, 0]
    a, b = (x + noise * rng.normal(size=x.shape) for x in (a, b))
    lag, correlation = estimate_delay(a, b, N)
    assert lag == pytest.approx(tau, abs=0.03 if noise else 1e-6)
    assert correlation > 0.9
    assert estimate_delay(a, rng.normal(size=P * N), N)[1] < 0.5


@pytest.mark.parametrize("drift", [0.0, 1.0])
@pytest.mark.parametrize("excess", [0.2, -0.13, 0.03])
def test_a_clock_that_differs_is_taken_out(excess: float, drift: float) -> None:
    """A period of N + e samples: the signal is back to 2e-4 of its size, drift or not."""
    t = np.arange(int(np.ceil(P * (N + excess)))) * N / (N + excess)
    signals = wave(t) + drift * np.outer(t / (P * N), [0.0, 5e4])
    repaired, findings = outcome(resample_to_generator, signals, signals[:, :1], N)
    error = repaired - CLEAN - drift * DRIFT
    # Near its ends the log leans on what it is continued with.
    assert np.all(np.abs(error[50:-50]).max(axis=0) < 2e-4 * CLEAN.std(axis=0))
    assert findings == {"samples resampled": P * N}
