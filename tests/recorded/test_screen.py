"""A piece of a large log passes the screen only where no repair would change it."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from scipy.signal import lfilter

from elastid.base.arrays import FloatArray
from elastid.recorded.pieces import _Screen
from elastid.recorded.repair import Log
from elastid.recorded.repair.masks import without_spikes

L, P, NOISE = 400, 16, 0.01


def _shape(samples: float = 0.0) -> FloatArray:
    """An angle that drifts, P periods of it, each later by so many samples than the one before."""
    t = np.arange(P * L) / L - np.repeat(np.arange(P), L) * samples / L
    phases = np.random.default_rng(1).uniform(0, 2 * np.pi, 39)
    x = np.sin(2 * np.pi * np.outer(t, np.arange(1, 40)) + phases) @ (1 / np.arange(1, 40)) + 0.05 * t
    return np.asarray(x / np.std(x))


def _noise(seed: int, pole: float = 0.0) -> FloatArray:
    white = np.random.default_rng(seed).standard_normal(P * L)
    return np.asarray(NOISE * lfilter([np.sqrt(1 - pole**2)], [1, -pole], white))


@pytest.mark.parametrize("pole", [0.0, 0.9, -0.6])
def test_clean_pieces_pass(pole: float) -> None:
    """All but one of forty, so that the repairs of a clean log cost nothing; of steps of a converter likewise."""
    for step in (1e-9, 0.05):
        first, *others = (step * np.round((_shape() + _noise(seed, pole)) / step) for seed in range(41))
        test = _Screen(first, L)
        assert sum(test.passes(x) for x in others) >= 39


def _with(x: FloatArray, index: int | slice, value: float | FloatArray) -> FloatArray:
    result = x.copy()
    result[index] = value
    return result


FAULTS: dict[str, Callable[[FloatArray], FloatArray]] = {
    "missing sample": lambda x: _with(x, 700, np.nan),
    "infinite sample": lambda x: _with(x, 700, -np.inf),
    "constant": lambda x: np.full_like(x, 0.3),
    "spike": lambda x: _with(x, 700, x[700] + 0.2),
    "spike of two samples": lambda x: _with(x, slice(700, 702), x[700:702] + 0.2),
    "dropout": lambda x: _with(x, 720, 0.0),
    "clipped": lambda x: np.clip(x, -1.5, 1.5),
    "angle starts again": lambda x: np.mod(x, 1.0),
    "lost samples": lambda x: np.concatenate([x[:3000], x[3002:], x[:2]]),
    "shifted": lambda x: np.roll(x, 1),
    "another clock": lambda x: x + _shape(0.02) - _shape(),
    "stop": lambda x: _with(x, slice(2500, 2560), x[2500]),
    "hangs": lambda x: _with(x, slice(2500, 2520), x[2500]),
    "drift": lambda x: x + 3 * np.sin(np.arange(P * L) / (0.3 * L)),
}


@pytest.mark.parametrize("fault", FAULTS)
def test_pieces_with_a_fault_do_not_pass(fault: str) -> None:
    """Each of the faults that a repair, or a finding, is for."""
    test = _Screen(_shape() + _noise(0), L)
    assert not any(test.passes(FAULTS[fault](_shape() + _noise(seed))) for seed in range(1, 6))


@pytest.mark.parametrize("pole", [0.0, 0.9, -0.6])
def test_spikes_that_the_rule_finds_do_not_pass(pole: float) -> None:
    """Of any size, in white noise and in noise that lasts or alternates from sample to sample."""
    test, found, passed = _Screen(_shape() + _noise(0, pole), L), 0, 0
    for seed in range(1, 61):
        rng, y = np.random.default_rng(seed), _shape() + _noise(seed, pole)
        sample, width = int(rng.integers(L, 15 * L)), int(rng.integers(1, 3))
        y[sample : sample + width] += rng.uniform(6, 40) * NOISE
        if without_spikes(y[:, None], L, 1, Log("log", ("y",))).findings:
            found += 1
            passed += test.passes(y)
    assert found > 20
    assert passed == 0
