"""Each fault of a log, put into signals whose truth is known: mended to what they were, counted, or refused."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from elastid.base.arrays import FloatArray
from elastid.base.errors import DataError
from elastid.recorded.repair import Finding, Log, counts
from elastid.recorded.repair.clock import GAPS, at_times, clock_drift, delay, on_grid, resampled
from elastid.recorded.repair.converter import CLIPPED, find_clipping, find_steps, step
from elastid.recorded.repair.missing import DOUBLED, DROPPED, FILLED, filled, realigned
from elastid.recorded.repair.repeats import flat
from elastid.recorded.repair.spikes import REPLACED, despiked

N, P = 500, 6
LINES = np.arange(2, 150)
LOG = Log("log.csv", ("torque", "angle"), 1000.0)


def wave(t: FloatArray, seed: int = 0) -> FloatArray:
    """Two periodic signals (n, 2) of period N at times t in samples: a torque of rms 1 and a position with it."""
    rng = np.random.default_rng(seed)
    U = np.exp(2j * np.pi * rng.random(len(LINES))) * np.sqrt(2 / len(LINES))
    G = 1e3 / (1 + 2j * 0.03 * LINES / 40 - (LINES / 40) ** 2)
    phasors = np.exp(2j * np.pi * np.outer(np.asarray(t) / N, LINES))
    return np.asarray(np.stack([(phasors @ U).real, (phasors @ (U * G)).real], axis=1))


CLEAN = wave(np.arange(P * N))
DRIFT = np.arange(P * N)[:, None] / (P * N) * np.array([0.0, 5e4])
NOISE = np.random.default_rng(9).normal(size=CLEAN.shape) * np.array([1e-3, 1.0])


def test_missing_samples_come_back_exactly_where_nothing_else_is_wrong() -> None:
    """Single ones, a gap, both ends, with a drift of a hundred times the signal: equal to the signal to 1e-9."""
    signals = CLEAN + DRIFT
    signals[[0, 7, 2 * N, P * N - 1], 1] = np.nan
    signals[3 * N + 100 : 3 * N + 130] = np.nan
    repaired = filled(signals, N, 1, LOG)
    np.testing.assert_allclose(repaired.signals, CLEAN + DRIFT, atol=1e-6 * CLEAN.std(axis=0).max())
    assert counts(repaired.findings) == {FILLED: 30 + 34}
    assert repaired.left_out == ()
    assert (
        "angle: 34 of 3000 samples are missing (NaN or infinite), the first is sample 0 (0 s)"
        in [f.text.split(":")[0] + ":" + f.text.split(":")[1] for f in repaired.findings][1]
    )


@settings(max_examples=25, deadline=None)
@given(st.lists(st.tuples(st.integers(0, P * N - 1), st.integers(1, 20)), max_size=12), st.sampled_from([1, -1]))
def test_what_is_filled_never_touches_what_was_measured(gaps: list[tuple[int, int]], sign: int) -> None:
    """Good samples stay bit for bit; the result is finite; also half-wave."""
    signals = CLEAN + NOISE
    for start, length in gaps:
        signals[start : start + length, 0] = np.nan
    good = np.isfinite(signals)
    repaired = filled(signals, N, sign, LOG)
    np.testing.assert_array_equal(repaired.signals[good], signals[good])
    assert np.isfinite(repaired.signals).all()
    assert counts(repaired.findings).get(FILLED, 0) == np.sum(~good)


def test_half_wave_samples_are_filled_with_the_other_sign() -> None:
    """Odd lines only: the second half of the period is minus the first."""
    rng = np.random.default_rng(3)
    lines = np.arange(1, 120, 2)
    t = np.arange(4 * N // 2)
    x = (np.exp(2j * np.pi * np.outer(t / N, lines)) @ np.exp(2j * np.pi * rng.random(60))).real[:, None]
    spoilt = x.copy()
    spoilt[300:310] = np.nan
    repaired = filled(spoilt, N // 2, -1, Log("x", ("u",)))
    np.testing.assert_allclose(repaired.signals, x, atol=1e-8)


def test_a_period_that_lacks_too_much_is_left_out_and_too_little_is_refused() -> None:
    """A tenth of a period; a phase that no period has; a third of a channel; one period left."""
    signals = CLEAN.copy()
    signals[2 * N + 50 : 2 * N + 101] = np.nan
    repaired = filled(signals, N, 1, LOG)
    assert repaired.left_out == (2,)
    assert "repetitions 3 of 6 lack more than 10%" in repaired.findings[-1].text
    everywhere = CLEAN.copy()
    everywhere[40::N, 1] = np.nan
    with pytest.raises(DataError, match=r"log.csv: angle: 6 of 3000 .* 1 of them in every period .* sample 40"):
        filled(everywhere, N, 1, LOG)
    with pytest.raises(DataError, match=r"angle: 1500 of 3000 samples are missing"):
        filled(np.where(np.arange(P * N)[:, None] < 1500, np.nan, CLEAN), N, 1, Log("log.csv", ("angle", "torque")))
    two = CLEAN[: 2 * N].copy()
    two[100:200] = np.nan
    with pytest.raises(DataError, match="1 of 2 repetitions lack more than 10%"):
        filled(two, N, 1, LOG)


def test_spikes_are_found_and_nothing_else_is_touched() -> None:
    """Five spikes of 30 sigma of the noise, on a drift and a decaying transient; noise, not truth, is what is left."""
    ring = np.exp(-np.arange(P * N) / 80) * np.cos(2 * np.pi * np.arange(P * N) / 12.5)
    signals = CLEAN + DRIFT + NOISE + ring[:, None] * np.array([0.1, 300.0])
    spoilt, where = signals.copy(), [640, 1033, 1034, 2222, 2990]
    spoilt[where, 1] += np.array([40, -40, -40, 30, 50.0])
    repaired = despiked(spoilt, N, 1, LOG)
    untouched = np.ones(signals.shape, dtype=bool)
    untouched[where, 1] = False
    np.testing.assert_array_equal(repaired.signals[untouched], signals[untouched])
    assert counts(repaired.findings) == {REPLACED: 5}
    assert np.abs(repaired.signals - signals)[where, 1].max() < 6
    assert "angle: 5 of 3000 samples are spikes, the first is sample 640 (0.64 s)" in repaired.findings[0].text


@settings(max_examples=15, deadline=None)
@given(seed=st.integers(0, 10**6), level=st.sampled_from([0.0, 1e-3, 1.0]), q=st.sampled_from([0.0, 0.01, 3.0]))
def test_noise_and_steps_of_an_encoder_are_no_spikes(seed: int, level: float, q: float) -> None:
    """White noise of any size, coarse steps, or both: not one sample changes."""
    signals = wave(np.arange(4 * N), seed)
    signals += level * signals.std(axis=0) * np.random.default_rng(seed).normal(size=signals.shape)
    if q:
        signals[:, 1] = q * np.round(signals[:, 1] / q)
    repaired = despiked(signals, N, 1, LOG)
    assert repaired.findings == ()
    np.testing.assert_array_equal(repaired.signals, signals)


def test_what_is_no_single_spike_is_left_with_a_word() -> None:
    """2 % of a channel; a burst of oscillation that only one period has."""
    rng = np.random.default_rng(5)
    many = CLEAN + NOISE
    many[rng.choice(P * N, 60, replace=False), 0] += 1.0
    repaired = despiked(many, N, 1, LOG)
    np.testing.assert_array_equal(repaired.signals, many)
    assert "differ from the other periods: too many for spikes, left unchanged" in repaired.findings[0].text
    burst = CLEAN + NOISE
    burst[1200:1260, 0] += np.sin(np.arange(60) * 2.0)
    assert despiked(burst, N, 1, LOG).findings == ()
    assert despiked(many[: 2 * N], N, 1, LOG).findings == ()


@pytest.mark.parametrize("excess", [0.2, -0.13, 0.03])
def test_a_clock_that_differs_is_measured_and_resampled(excess: float) -> None:
    """A period of N + e samples: e within 1e-3, and the signal back to 2e-4 of its size, drift or not."""
    n = int(np.ceil(P * (N + excess)))
    t = np.arange(n) * N / (N + excess)
    for drift in (0.0, 1.0):
        signals = wave(t) + drift * np.outer(t / (P * N), [0.0, 5e4])
        assert clock_drift(signals[:, :1], N).excess == pytest.approx(excess, abs=1e-3)
        repaired = resampled(signals, signals[:, :1], N, LOG)
        error = repaired.signals - CLEAN - drift * DRIFT
        # Near its ends the log leans on what it is continued with.
        assert np.all(np.abs(error[50:-50]).max(axis=0) < 2e-4 * CLEAN.std(axis=0))
        assert f"the period is {N + excess:.3f}" in repaired.findings[0].text
        assert counts(repaired.findings) == {"samples resampled": P * N}


@settings(max_examples=10, deadline=None)
@given(seed=st.integers(0, 10**6), noise=st.sampled_from([0.0, 0.01, 0.5]))
def test_clocks_that_agree_are_left_alone(seed: int, noise: float) -> None:
    """Noise alone looks like no drift."""
    signals = wave(np.arange(4 * N), seed)
    signals += noise * np.random.default_rng(seed).normal(size=signals.shape)
    assert resampled(signals, signals[:, :1], N, LOG).findings == ()


def test_a_wrong_period_is_no_drift_of_a_clock() -> None:
    """Half a percent is beyond any clock: left to the check of the period, which names the right one."""
    signals = wave(np.arange(P * N) * N / (N + 2.5))
    assert resampled(signals, signals[:, :1], N, LOG).findings == ()


@pytest.mark.parametrize(("place", "count"), [(1700, 1), (1499, 3), (2101, 2), (1010, 1)])
def test_lost_samples_are_put_back_where_they_were_lost(place: int, count: int) -> None:
    """The rest of the log is in step again, bit for bit; the place is right to a few samples."""
    signals = CLEAN + NOISE
    lost = np.delete(signals, slice(place, place + count), axis=0)
    repaired = realigned(lost, lost[:, :1], N, LOG)
    assert counts(repaired.findings) == {DROPPED: count}
    gap = np.flatnonzero(np.isnan(repaired.signals[:, 0]))
    assert len(gap) == count
    assert abs(gap[0] - place) <= 4
    outside = np.r_[0 : min(gap[0], place), max(gap[-1] + 1, place + count) : len(repaired.signals)]
    np.testing.assert_array_equal(repaired.signals[outside], signals[outside])


def test_doubled_samples_are_taken_out_and_two_faults_are_told_apart() -> None:
    """A sample twice in the second period, two lost in the fifth."""
    signals = np.concatenate([CLEAN, CLEAN])
    spoilt = np.insert(np.delete(signals, [4200, 4201], axis=0), 800, signals[800], axis=0)
    repaired = realigned(spoilt, spoilt[:, :1], N, LOG)
    assert counts(repaired.findings) == {DOUBLED: 1, DROPPED: 2}
    assert len(repaired.signals) == 2 * P * N
    assert np.mean(repaired.signals == signals) > 0.99


@settings(max_examples=15, deadline=None)
@given(seed=st.integers(0, 10**6), noise=st.sampled_from([0.0, 0.1, 1.0]), ramp=st.sampled_from([0.0, 30.0]))
def test_a_log_without_loss_is_left_alone(seed: int, noise: float, ramp: float) -> None:
    """Noise of the signal's own power and a drift make no shift."""
    signals = wave(np.arange(P * N), seed)
    signals += noise * np.random.default_rng(seed).normal(size=signals.shape) + ramp * np.linspace(0, 1, P * N)[:, None]
    assert realigned(signals, signals[:, :1], N, LOG).findings == ()
    wrong = realigned(signals, signals[:, :1], N - 1, LOG)
    assert wrong.findings == ()


def test_clipping_is_counted_and_refused_when_it_is_most_of_a_signal() -> None:
    """At 2 rms a word, at 1 rms refused, unclipped and coarse steps nothing."""
    at_two, at_one = (np.clip(CLEAN, -level * CLEAN.std(axis=0), level * CLEAN.std(axis=0)) for level in (2, 1))
    finding = find_clipping(at_two, N, LOG)[1]
    assert finding.kind == CLIPPED
    assert finding.count == pytest.approx(np.sum(np.abs(CLEAN[:, 1]) > 2 * CLEAN[:, 1].std()), rel=0.5)
    with pytest.raises(DataError, match=r"log.csv: torque: .* are at its limits of -1 and 1: it is clipped"):
        find_clipping(at_one, N, LOG)
    assert find_clipping(CLEAN, N, LOG) == ()
    assert find_clipping(200 * np.round(CLEAN / 200), N, LOG) == ()


def test_the_step_of_an_encoder_and_its_noise_are_told() -> None:
    """360 deg / 4096; without other noise its error repeats with the signal, and that is said."""
    q = 360 / 4096
    fine, coarse = (np.round(scale * CLEAN[:, 1] / q) * q / scale for scale in (1, 1e-3))
    assert step(np.round(CLEAN[:, 1] / 30) * 30) == pytest.approx(30)
    assert step(coarse) == pytest.approx(1e3 * q, rel=1e-6)
    assert step(CLEAN[:, 0]) == 0
    signals = np.stack([CLEAN[:, 0], coarse], axis=1)
    (finding,) = find_steps(signals, N, 1, LOG)
    assert f"angle: steps of {1e3 * q:.4g} make noise of {1e3 * q / np.sqrt(12):.3g}" in finding.text
    assert "repeats with the signal" in finding.text
    noisy = coarse + 1e3 * q * np.round(np.random.default_rng(0).normal(size=P * N))
    (finding,) = find_steps(np.stack([CLEAN[:, 0], noisy], axis=1), N, 1, LOG)
    assert "repeats with the signal" not in finding.text
    assert find_steps(np.stack([CLEAN[:, 0], fine], axis=1), N, 1, LOG) == ()


@settings(max_examples=20, deadline=None)
@given(tau=st.floats(-240, 240), noise=st.sampled_from([0.0, 0.3]))
def test_the_delay_between_two_logs_is_found_to_a_hundredth_of_a_sample(tau: float, noise: float) -> None:
    """Any delay within half a period, with noise on both."""
    rng = np.random.default_rng(1)
    a, b = wave(np.arange(P * N))[:, 0], wave(np.arange(P * N) - tau)[:, 0]
    a, b = (x + noise * rng.normal(size=x.shape) for x in (a, b))
    found, correlation = delay(a, b, N)
    assert found == pytest.approx(tau, abs=0.03 if noise else 1e-6)
    assert correlation > 0.9
    assert delay(a, rng.normal(size=P * N), N)[1] < 0.5


def test_interpolation_is_exact_in_its_band_and_keeps_the_rest_out() -> None:
    """Halved rate: what the lower rate can hold stays to 2e-4, what it cannot is gone to 1e-3."""
    t, half = np.arange(4000.0), np.arange(100, 1900) * 2.0
    low, high = np.cos(2 * np.pi * 0.21 * t), np.cos(2 * np.pi * 0.3 * t)
    result = at_times(np.stack([low, high], axis=1), half, 1000, band=0.5)
    np.testing.assert_allclose(result[:, 0], np.cos(2 * np.pi * 0.21 * half), atol=2e-4)
    np.testing.assert_allclose(result[:, 1], 0.0, atol=1e-3)
    constant = at_times(np.full((4000, 1), 7.0), np.array([-40.3, 17.7, 4010.2]), 1000)
    np.testing.assert_allclose(constant, 7.0, rtol=1e-12)


def test_gaps_in_the_times_become_missing_samples() -> None:
    """Jitter of a tenth and a clock 200 ppm off are none; uneven sampling is refused with the place."""
    t = np.arange(100) / 1000 * (1 + 2e-4) + 1e-4 * np.random.default_rng(0).uniform(-1, 1, 100)
    keep = np.r_[0:20, 23:70, 71:100]
    x = np.arange(100.0)[:, None]
    repaired = on_grid(t[keep], x[keep], 1000.0, LOG)
    assert np.flatnonzero(np.isnan(repaired.signals[:, 0])).tolist() == [20, 21, 22, 70]
    assert counts(repaired.findings) == {GAPS: 4}
    np.testing.assert_array_equal(repaired.signals[keep], x[keep])
    assert on_grid(t, x, 1000.0, LOG).findings == ()
    with pytest.raises(DataError, match=r"log.csv: \d+ of 99 steps in time are no whole samples at 1500 Hz"):
        on_grid(t, x, 1500.0, LOG)
    with pytest.raises(DataError, match=r"1 of 99 steps .* the first after sample 49"):
        on_grid(np.where(np.arange(100) < 50, t, t - 0.01), x, 1000.0, LOG)


def test_flat_removes_offset_and_slope_of_each_period_and_counts_add_up() -> None:
    """What is left is the periodic signal without its own line."""
    x = CLEAN[:, 1] + DRIFT[:, 1]
    np.testing.assert_allclose(flat(x, N), flat(CLEAN[:, 1], N), atol=1e-7)
    assert counts([Finding("a", 1, ""), Finding("b", 2, ""), Finding("a", 3, "")]) == {"a": 4, "b": 2}
