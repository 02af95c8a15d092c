"""Lost, doubled and missing samples."""

from __future__ import annotations

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from plants.refusals import refused
from plants.waves import CLEAN, DRIFT, LOG, NOISE, N, P

from elastid.recorded.repair import Log, counts
from elastid.recorded.repair.missing import FILLED, filled


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
    with refused("records/missing-samples", holds=("log.csv: angle", "6 of 3000", "sample 40")):
        filled(everywhere, N, 1, LOG)
    with refused("records/missing-samples", holds=("angle", "1500 of 3000")):
        filled(np.where(np.arange(P * N)[:, None] < 1500, np.nan, CLEAN), N, 1, Log("log.csv", ("angle", "torque")))
    two = CLEAN[: 2 * N].copy()
    two[100:200] = np.nan
    with refused("records/missing-samples", place="log.csv", holds=("1 of 2", "10%")):
        filled(two, N, 1, LOG)
