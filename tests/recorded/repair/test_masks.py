"""Spikes and channels that hang are missing samples, which periods fill; steps and limits are told, rest is not."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from plants.refusals import refused
from plants.waves import CLEAN, DRIFT, LOG, NOISE, N, P, wave

from elastid.base.arrays import FloatArray
from elastid.recorded.repair import Log, counts
from elastid.recorded.repair.masks import (
    CLIPPED,
    MASKED,
    find_clipping,
    find_steps,
    step,
    without_spikes,
    without_standstill,
)
from elastid.recorded.repair.missing import FILLED, filled


def test_spikes_are_found_and_nothing_else_is_touched() -> None:
    """Five spikes of 30 sigma of the noise, on a drift and a decaying transient; noise, not truth, is what is left."""
    ring = np.exp(-np.arange(P * N) / 80) * np.cos(2 * np.pi * np.arange(P * N) / 12.5)
    signals = CLEAN + DRIFT + NOISE + ring[:, None] * np.array([0.1, 300.0])
    spoilt, where = signals.copy(), [640, 1033, 1034, 2222, 2990]
    spoilt[where, 1] += np.array([40, -40, -40, 30, 50.0])
    repaired = without_spikes(spoilt, N, 1, LOG)
    untouched = np.ones(signals.shape, dtype=bool)
    untouched[where, 1] = False
    np.testing.assert_array_equal(repaired.signals[untouched], signals[untouched])
    assert counts(repaired.findings) == {MASKED: 5}
    assert np.flatnonzero(np.isnan(repaired.signals[:, 1])).tolist() == where
    assert (
        "angle: 5 of 3000 samples differ from the other periods, the first is sample 640 (0.64 s)"
        in repaired.findings[0].text
    )


@settings(max_examples=15, deadline=None)
@given(seed=st.integers(0, 10**6), level=st.sampled_from([0.0, 1e-3, 1.0]), q=st.sampled_from([0.0, 0.01, 3.0]))
def test_noise_and_steps_of_an_encoder_are_no_spikes(seed: int, level: float, q: float) -> None:
    """White noise of any size, coarse steps, or both: not one sample changes."""
    signals = wave(np.arange(4 * N), seed)
    signals += level * signals.std(axis=0) * np.random.default_rng(seed).normal(size=signals.shape)
    if q:
        signals[:, 1] = q * np.round(signals[:, 1] / q)
    repaired = without_spikes(signals, N, 1, LOG)
    assert repaired.findings == ()
    np.testing.assert_array_equal(repaired.signals, signals)


@pytest.mark.parametrize("seed", [4, 16, 17])
def test_a_transient_in_the_first_period_makes_no_spikes_of_noise(seed: int) -> None:
    """Twelve periods; in these draws a sample stands out of its neighbours, but not of the bend that they lie on."""
    t = np.arange(12 * N)
    signals, rng = wave(t, seed), np.random.default_rng(seed)
    transient = 3.0 * np.exp(-t / 300) * np.cos(2 * np.pi * t / 40)
    signals += signals.std(axis=0) * (0.01 * rng.normal(size=signals.shape) + transient[:, None])
    assert without_spikes(signals, N, 1, LOG).findings == ()


def test_what_is_no_single_spike_is_left_with_a_word() -> None:
    """2 % of a channel; a burst of oscillation that only one period has."""
    rng = np.random.default_rng(5)
    many = CLEAN + NOISE
    many[rng.choice(P * N, 60, replace=False), 0] += 1.0
    repaired = without_spikes(many, N, 1, LOG)
    np.testing.assert_array_equal(repaired.signals, many)
    assert "differ from the other periods: too many for spikes, left unchanged" in repaired.findings[0].text
    burst = CLEAN + NOISE
    burst[1200:1260, 0] += np.sin(np.arange(60) * 2.0)
    assert without_spikes(burst, N, 1, LOG).findings == ()
    assert without_spikes(many[: 2 * N], N, 1, LOG).findings == ()


@pytest.mark.parametrize("length", [1, 3, 40])
def test_zeros_that_a_channel_leaps_to_and_back_from_are_missing_samples(length: int) -> None:
    """A bus that lost samples of an angle far from 0; those of a torque about 0 stay, and pulses that repeat."""
    signals = 1e-4 * CLEAN + np.array([0.0, 90.0])
    signals[3 * N + 100 : 3 * N + 100 + length] = 0.0
    found = without_standstill(signals, N, LOG)
    lost = np.isnan(found.signals)
    assert lost[:, 1].nonzero()[0].tolist() == list(range(3 * N + 100, 3 * N + 100 + length))
    assert not lost[:, 0].any()
    assert counts(found.findings) == {MASKED: length}
    pulses = np.tile(np.where(np.arange(N) % 100 < length, 0.0, 50.0), P)[:, None] + np.zeros(2)
    assert without_standstill(pulses, N, LOG).findings == ()
    assert without_standstill(CLEAN, N, LOG).findings == ()


M = 400


def sines(seed: int = 0) -> FloatArray:
    """Two periodic signals with noise of a thousandth."""
    rng = np.random.default_rng(seed)
    t = 2 * np.pi * np.arange(4 * M) / M
    parts = [np.cos(k * t[:, None] + rng.uniform(0, 6, 2)) for k in range(2, 30)]
    return np.asarray(sum(parts) + 1e-3 * rng.normal(size=(4 * M, 2)))


def test_a_channel_that_hangs_lacks_these_samples() -> None:
    """From the second sample of one value on, the first of which was measured; the other channel is as it was."""
    signals = sines()
    signals[530:590, 1] = signals[530, 1]
    repaired = without_standstill(signals, M, LOG)
    assert np.flatnonzero(np.isnan(repaired.signals[:, 1])).tolist() == list(range(531, 590))
    np.testing.assert_array_equal(repaired.signals[:, 0], signals[:, 0])
    assert counts(repaired.findings) == {MASKED: 59}
    assert "angle stands still or at 0 for 59 samples from sample 531 (0.531 s) on" in repaired.findings[0].text


def test_what_stands_in_every_period_or_within_a_count_does_not_hang() -> None:
    """An excitation with a pause, a joint that rests, a coarse encoder, a short hold and a limit."""
    signals = sines()
    signals[np.arange(4 * M) % M > 300] = 0.0
    signals[100:115, 0] = signals[100, 0]
    assert without_standstill(signals, M, LOG).findings == ()
    for seed in range(20):
        coarse = np.stack([np.round(sines(seed)[:, 0] / 4) * 4, np.clip(sines(seed)[:, 1], -3, 3)], axis=1)
        assert without_standstill(coarse, M, LOG).findings == ()


def test_clipping_is_counted_and_refused_when_it_is_most_of_a_signal() -> None:
    """At 2 rms a word, at 1 rms refused, unclipped and coarse steps nothing."""
    at_two, at_one = (np.clip(CLEAN, -level * CLEAN.std(axis=0), level * CLEAN.std(axis=0)) for level in (2, 1))
    finding = find_clipping(at_two, N, LOG)[1]
    assert finding.kind == CLIPPED
    assert finding.count == pytest.approx(np.sum(np.abs(CLEAN[:, 1]) > 2 * CLEAN[:, 1].std()), rel=0.5)
    with refused("records/clipped", place="log.csv", holds=("torque", "-1 and 1")):
        find_clipping(at_one, N, LOG)
    assert find_clipping(CLEAN, N, LOG) == ()
    assert find_clipping(200 * np.round(CLEAN / 200), N, LOG) == ()


def test_a_force_at_rest_under_its_window_is_not_clipped() -> None:
    """Six hits of other heights, exactly 0 between them; cut at half of the lowest they are."""
    x, rng = np.zeros(3000), np.random.default_rng(0)
    for hit in range(6):
        x[500 * hit + 50 : 500 * hit + 80] = rng.uniform(0.7, 1.3) * np.sin(np.pi * (np.arange(30) + 0.5) / 30)
    log = Log("log", ("force",))
    assert find_clipping(x[:, None], len(x), log) == ()
    (finding,) = find_clipping(np.minimum(x, 0.35)[:, None], len(x), log)
    assert finding.count == np.sum(x > 0.35)


def test_the_step_of_an_encoder_and_its_noise_are_told() -> None:
    """360 deg / 4096."""
    q = 360 / 4096
    fine, coarse = (np.round(scale * CLEAN[:, 1] / q) * q / scale for scale in (1, 1e-3))
    assert step(np.round(CLEAN[:, 1] / 30) * 30) == pytest.approx(30)
    assert step(coarse) == pytest.approx(1e3 * q, rel=1e-6)
    assert step(CLEAN[:, 0]) == 0
    signals = np.stack([CLEAN[:, 0], coarse], axis=1)
    (finding,) = find_steps(signals, N, 1, LOG)
    assert f"angle: steps of {1e3 * q:.4g} make noise of {1e3 * q / np.sqrt(12):.3g}" in finding.text
    assert find_steps(np.stack([CLEAN[:, 0], fine], axis=1), N, 1, LOG) == ()


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
        "angle: 34 of 3000 samples are missing, the first is sample 0 (0 s)"
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


def test_a_period_that_lacks_too_much_is_left_out_and_too_little_is_refused() -> None:
    """A tenth of a period; a phase that no period has; a third of a channel; one period left."""
    signals = CLEAN.copy()
    signals[2 * N + 50 : 2 * N + 101] = np.nan
    repaired = filled(signals, N, 1, LOG)
    assert repaired.left_out == (2,)
    assert "repetitions 3 of 6 lack more than 10%" in repaired.findings[-1].text
    everywhere = CLEAN.copy()
    everywhere[40::N, 1] = np.nan
    with refused("records/missing-samples", holds=("log.csv: angle", "6 of 3000", "sample 40")):
        filled(everywhere, N, 1, LOG)
    with refused("records/missing-samples", holds=("angle", "1500 of 3000")):
        filled(np.where(np.arange(P * N)[:, None] < 1500, np.nan, CLEAN), N, 1, Log("log.csv", ("angle", "torque")))
    two = CLEAN[: 2 * N].copy()
    two[100:200] = np.nan
    with refused("records/missing-samples", place="log.csv", holds=("1 of 2", "10%")):
        filled(two, N, 1, LOG)
