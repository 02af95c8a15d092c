"""Clipping and quantisation."""

from __future__ import annotations

import numpy as np
import pytest
from plants.refusals import refused
from plants.waves import CLEAN, LOG, N

from elastid.recorded.repair import Log
from elastid.recorded.repair.masks import CLIPPED, find_clipping, find_steps, step


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


@pytest.mark.parametrize("decimals", [1, 2, 3])
@pytest.mark.parametrize("cycles", [1, 5])
def test_a_rounded_sine_that_dwells_at_its_maximum_is_not_clipped(decimals: int, cycles: int) -> None:
    """Four periods of a slow sine, rounded; cut at 90 % of its amplitude it is clipped."""
    t = np.arange(4000)
    x = 3.7 * np.sin(2 * np.pi * cycles * t / 1000 + 0.3)
    log = Log("log", ("x",))
    assert find_clipping(np.round(x, decimals)[:, None], 1000, log) == ()


def test_levels_that_a_torque_was_given_are_no_steps() -> None:
    """A binary sequence, a ternary one and the blows of a hammer; a coarse encoder is one still."""
    rng = np.random.default_rng(0)
    for levels in ((-1.0, 1.0), (-1.0, 0.0, 1.0)):
        given = np.repeat(rng.choice(levels, 600), 5)
        assert find_steps(np.stack([given, CLEAN[:, 1]], axis=1), len(given), 1, LOG) == ()
    blows = np.zeros(3000)
    for first in (100, 900, 2100):
        blows[first : first + 3] = 50.0, 100.0, 50.0
    assert find_steps(np.stack([blows, CLEAN[:, 1]], axis=1), 3000, 1, LOG) == ()
    coarse = 0.7 * CLEAN[:, 1].std() * np.round(CLEAN[:, 1] / (0.7 * CLEAN[:, 1].std()))
    assert len(find_steps(np.stack([blows, coarse], axis=1), 3000, 1, LOG)) == 1
