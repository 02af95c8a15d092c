"""Spikes and channels that hang are missing samples, which periods fill; steps and limits are told, rest is not."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from plants.marks import slow
from plants.refusals import refused
from plants.waves import CLEAN, LINES, LOG, NOISE, N, P, outcome, wave

from elastid.base.arrays import FloatArray
from elastid.logs.repair import Findings, LogReport
from elastid.logs.repair.masks import (
    CLIPPED,
    MASKED,
    report_clipping,
    report_steps,
    step,
    without_dropouts,
    without_standstill,
)
from elastid.logs.repair.missing import FILLED, fill_gaps, repair
from elastid.logs.repair.outliers import without_spikes
from elastid.logs.repair.periodicity import repetition
from elastid.logs.repair.resampling import RESAMPLED


@settings(max_examples=15, deadline=None)
@given(
    seed=st.integers(0, 10**6),
    level=st.sampled_from([0.0, 1e-3, 1.0]),
    q=st.sampled_from([0.0, 0.01, 3.0]),
    transient=st.sampled_from([0.0, 3.0]),
)
@example(seed=4, level=0.01, q=0.0, transient=3.0)
@example(seed=16, level=0.01, q=0.0, transient=3.0)
def test_encoder_steps_and_transient_are_no_spikes(seed: int, level: float, q: float, transient: float) -> None:
    """White noise of any size, coarse steps, a start that rings: not one sample changes."""
    t = np.arange(4 * N)
    signals = wave(t, seed)
    ringing = transient * np.exp(-t / 300) * np.cos(2 * np.pi * t / 40)
    noise = level * np.random.default_rng(seed).normal(size=signals.shape)
    signals += signals.std(axis=0) * (noise + ringing[:, None])
    if q:
        signals[:, 1] = q * np.round(signals[:, 1] / q)
    repaired, findings = outcome(without_spikes, signals, N, 1)
    assert not findings
    np.testing.assert_array_equal(repaired, signals)


def test_what_is_no_single_spike_is_left_with_a_word() -> None:
    """3 % of a channel; a burst of oscillation that only one period has; lone pulses of a kind that mostly crowds."""
    rng = np.random.default_rng(5)
    many = CLEAN + NOISE
    many[rng.choice(P * N, 90, replace=False), 0] += 1.0
    repaired, findings = outcome(without_spikes, many, N, 1)
    np.testing.assert_array_equal(repaired, many)
    assert [*findings] == ["spikes left"]
    burst = CLEAN + NOISE
    burst[1200:1260, 0] += np.sin(np.arange(60) * 2.0)
    assert not outcome(without_spikes, burst, N, 1)[1]
    assert not outcome(without_spikes, many[: 2 * N], N, 1)[1]
    pulses = CLEAN + NOISE
    pulses[[777, 1888], 0] += 0.5
    assert outcome(without_spikes, pulses, N, 1)[1] == {MASKED: 2}
    pulses[(np.arange(0, P * N - 60, 47)[:, None] + rng.choice(12, 3, replace=False)).ravel(), 0] += 0.5
    assert not outcome(without_spikes, pulses, N, 1)[1]


def test_filled_outliers_give_one_note() -> None:
    log, pulses = replace(LOG, findings=Findings()), CLEAN + NOISE
    pulses[[777, 1888], 0] += 0.5
    fill_gaps(without_spikes(pulses, N, 1, log), N, 1, log)
    assert (len(log.findings.notes), log.findings.repairs) == (1, {MASKED: 2, FILLED: 2})


@pytest.mark.parametrize("length", [1, 3, 40])
def test_zeros_between_leaps_are_missing_samples(length: int) -> None:
    """A bus that lost samples of an angle far from 0; those of a torque about 0 stay, and pulses that repeat."""
    signals = 1e-4 * CLEAN + np.array([0.0, 90.0])
    signals[3 * N + 100 : 3 * N + 100 + length] = 0.0
    masked, findings = outcome(without_standstill, signals, N)
    lost = np.isnan(masked)
    assert lost[:, 1].nonzero()[0].tolist() == list(range(3 * N + 100, 3 * N + 100 + length))
    assert not lost[:, 0].any()
    assert findings == {MASKED: length}
    pulses = np.tile(np.where(np.arange(N) % 100 < length, 0.0, 50.0), P)[:, None] + np.zeros(2)
    assert not outcome(without_standstill, pulses, N)[1]
    assert not outcome(without_standstill, CLEAN, N)[1]


def test_zeros_of_a_position_beside_a_noisy_torque_are_missing() -> None:
    """Also where the torque varies only by its noise; an encoder at rest with rare steps is unchanged."""
    t, rest = np.arange(6500) / 500, 1.0 + 1e-4 * (np.arange(6500) % 100 == 7)
    q, u = 2 + 0.5 * np.sin(t), 10 * np.sign(np.cos(t)) + 0.05 * np.random.default_rng(0).standard_normal(len(t))
    is_lost = np.arange(len(t)) % 1300 // 40 == 15
    log = LogReport("log.csv", ("angle", "torque", "other angle"))
    result = without_dropouts(np.stack([np.where(is_lost, 0.0, q), u, rest], axis=1), log)
    assert np.array_equal(np.isnan(result), is_lost[:, None] & [True, False, False])


def test_periodic_or_quantised_standstill_is_no_dropout() -> None:
    """An excitation with a pause, a joint that rests, a coarse encoder, a short hold and a limit."""
    signals = CLEAN + NOISE
    signals[np.arange(P * N) % N > 375] = 0.0
    signals[100:115, 0] = signals[100, 0]
    assert not outcome(without_standstill, signals, N)[1]
    for seed in range(20):
        torque, angle = ((wave(np.arange(P * N), seed) + NOISE) / CLEAN.std(axis=0)).T
        coarse = np.stack([np.round(torque), np.clip(angle, -0.8, 0.8)], axis=1)
        assert not outcome(without_standstill, coarse, N)[1]


def test_clipping_is_counted_and_refused_if_frequent() -> None:
    """At 2 rms a word, at 1 rms refused, unclipped and coarse steps nothing."""
    at_two, at_one = (np.clip(CLEAN, -level * CLEAN.std(axis=0), level * CLEAN.std(axis=0)) for level in (2, 1))
    beyond = np.sum(np.abs(CLEAN[:, 1]) > 2 * CLEAN[:, 1].std())
    counts = outcome(report_clipping, at_two[:, 1:], N, names=("angle",))[1]
    assert counts == {CLIPPED: pytest.approx(beyond, rel=0.5)}
    with refused("records/clipped", place="log.csv", holds=("torque", "-1 and 1")):
        outcome(report_clipping, at_one, N)
    assert not any(outcome(report_clipping, x, N)[1] for x in (CLEAN, 200 * np.round(CLEAN / 200)))
    # Six hits of different heights, exactly 0 between them under a force window; cut at half of the lowest height.
    x, rng = np.zeros(3000), np.random.default_rng(0)
    for hit in range(6):
        x[500 * hit + 50 : 500 * hit + 80] = rng.uniform(0.7, 1.3) * np.sin(np.pi * (np.arange(30) + 0.5) / 30)
    assert not outcome(report_clipping, x[:, None], len(x), names=("force",))[1]
    low = np.minimum(x, 0.35)[:, None]
    assert outcome(report_clipping, low, len(x), names=("force",))[1] == {CLIPPED: np.sum(x > 0.35)}


def test_the_step_of_an_encoder_and_its_noise_are_told() -> None:
    """360 deg / 4096."""
    q = 360 / 4096
    fine, coarse = (np.round(scale * CLEAN[:, 1] / q) * q / scale for scale in (1, 1e-3))
    assert step(np.round(CLEAN[:, 1] / 30) * 30) == pytest.approx(30)
    assert step(coarse) == pytest.approx(1e3 * q, rel=1e-6)
    assert step(CLEAN[:, 0]) == 0
    assert [*outcome(report_steps, np.stack([CLEAN[:, 0], coarse], axis=1), N, 1)[1].values()] == [1]
    assert not outcome(report_steps, np.stack([CLEAN[:, 0], fine], axis=1), N, 1)[1]
    q = 2 * np.pi / 2**17  # at 40 rad, with nine digits in a text
    turns = [float(f"{40 + q * n:.9g}") for n in np.random.default_rng(0).integers(-60000, 60000, 4000)]
    assert step(np.array(turns)) == pytest.approx(q, rel=1e-6)


@settings(max_examples=25, deadline=None)
@given(st.lists(st.tuples(st.integers(0, P * N - 1), st.integers(1, 20)), max_size=12), st.sampled_from([1, -1]))
def test_what_is_filled_never_touches_what_was_measured(gaps: list[tuple[int, int]], sign: int) -> None:
    """Good samples stay bit for bit; the result is finite; also half-wave."""
    signals = CLEAN + NOISE
    for start, length in gaps:
        signals[start : start + length, 0] = np.nan
    good = np.isfinite(signals)
    repaired, findings = outcome(fill_gaps, signals, N, sign)
    np.testing.assert_array_equal(repaired[good], signals[good])
    assert np.isfinite(repaired).all()
    assert findings.get(FILLED, 0) == np.sum(~good)


def test_incomplete_period_is_discarded_or_refused() -> None:
    """A tenth of a period; one sample, and three, that no period has; a third of a channel; one period left."""
    signals = CLEAN.copy()
    signals[2 * N + 50 : 2 * N + 101] = np.nan
    log = replace(LOG, findings=Findings())
    fill_gaps(signals, N, 1, log)
    assert log.findings.discarded_periods == [2]
    everywhere = CLEAN.copy()
    everywhere[np.arange(P * N) % N == 40, 1] = np.nan
    np.testing.assert_allclose(fill_gaps(everywhere, N, 1, LOG), CLEAN, atol=0.05 * CLEAN[:, 1].std())
    everywhere[np.abs(np.arange(P * N) % N - 41) < 2, 1] = np.nan
    with refused("records/missing-samples", holds=("log.csv: angle", "18 of 3000", "sample 40")):
        fill_gaps(everywhere, N, 1, LOG)
    with refused("records/missing-samples", holds=("angle", "1500 of 3000")):
        fill_gaps(np.where(np.arange(P * N)[:, None] < 1500, np.nan, CLEAN), N, 1, LogReport("", ("angle", "torque")))
    two = CLEAN[: 2 * N].copy()
    two[100:200] = np.nan
    with refused("records/missing-samples", place="log.csv", holds="1 of 2"):
        fill_gaps(two, N, 1, LOG)


ROLES = {"r": [], "u": [0], "y": [1]}


@pytest.mark.parametrize(("half_wave", "excess"), [(False, 0.0), (True, 0.0), (False, 0.2), (False, -0.13)])
@pytest.mark.parametrize("scale", [1e-7, slow(1.0), 1e7])
def test_repairs_restore_the_log_in_any_unit(half_wave: bool, excess: float, scale: float) -> None:
    """Missing samples, spikes, a channel that hangs, a clock that differs, half a wave: to noise of a thousandth."""
    lines = LINES[LINES % 2 == 1] if half_wave else LINES
    t = np.arange(round(P * (N + excess))) * N / (N + excess)
    rng, clean = np.random.default_rng(2), wave(t, lines=lines)
    size = clean.std(axis=0)
    spoilt = clean + 1e-3 * size * rng.normal(size=clean.shape)
    spoilt[[700, 1490, 1491], 1] = np.nan
    if not excess:  # resampling smears what is one sample
        spoilt[[1733, 2250], 0] += 8 * size[0]
    spoilt[2600:2640, 1] = spoilt[2600, 1]

    def is_periodic(drivers: FloatArray) -> None:
        assert repetition(scale * drivers, N).matches_stated_period

    log = replace(LOG, findings=Findings())
    repaired = repair(scale * spoilt, ROLES, float(N), half_wave, log, is_periodic)
    exact = wave(np.arange(len(repaired)), lines=lines)
    error = (repaired / scale - exact)[40:-40] / size
    assert np.abs(error).max() < (0.02 if excess else 7e-3)  # resampling leaves 2 % of what bridges a gap
    kinds = log.findings.repairs
    assert (RESAMPLED in kinds) == bool(excess)
    assert excess or (kinds[FILLED], kinds[MASKED]) == (3 + 39 + 2, 39 + 2)
    assert log.findings.discarded_periods == [10] * half_wave
