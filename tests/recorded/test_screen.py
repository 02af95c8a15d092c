"""A piece of a large log passes the screen only where no repair would change it."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from elastid.base.arrays import FloatArray
from elastid.recorded.repair import Log
from elastid.recorded.repair.spikes import REPLACED, despiked
from elastid.recorded.repair_order import Screen, _has_spike, screen

L, P = 400, 16
MODES = {"period": 1, "half-wave": -1}


def _piece(rng: np.random.Generator, sign: int = 1, noise: float = 0.01) -> list[FloatArray]:
    """A torque and an angle that drifts, P repetitions of them, with noise."""
    lines = np.arange(1, 40, 1 if sign > 0 else 2)
    t = np.arange(P * L) / (L if sign > 0 else 2 * L)
    phases = 2 * np.pi * np.random.default_rng(1).uniform(size=len(lines))
    torque = np.cos(2 * np.pi * np.outer(t, lines) + phases).sum(axis=1)
    angle = np.sin(2 * np.pi * np.outer(t, lines) + phases) @ (1 / lines)
    angle += 0.05 * t if sign > 0 else 0
    return [x + noise * np.std(x) * rng.standard_normal(len(x)) for x in (torque, angle)]


def _screen(sign: int = 1) -> Screen:
    return screen(_piece(np.random.default_rng(0), sign), (L, sign), [0], [0], [np.inf, np.pi])


@pytest.mark.parametrize("sign", MODES.values(), ids=MODES)
def test_clean_pieces_pass(sign: int) -> None:
    """All of forty, so that the repairs of a clean log cost nothing."""
    test = _screen(sign)
    assert all(test.passes(_piece(np.random.default_rng(seed), sign)) for seed in range(1, 41))


def test_the_largest_of_many_samples_is_no_spike() -> None:
    """Four of 240 pieces of 344 000 samples, each of which holds a lone sample beyond 5 sigma."""
    for seed in (63, 141, 232, 242):
        assert not _has_spike(np.random.default_rng(seed).standard_normal((21, 16384)), 1)


def _shifted(x: FloatArray, samples: float) -> FloatArray:
    """The same period by period, each later by so many samples than the one before."""
    turns = np.exp(-2j * np.pi * np.arange(L // 2 + 1) * samples * np.arange(P)[:, None] / L)
    return np.asarray(np.fft.irfft(np.fft.rfft(x.reshape(P, L), axis=1) * turns, L, axis=1).ravel())


def _with(x: FloatArray, index: int | slice, value: float | FloatArray) -> FloatArray:
    result = x.copy()
    result[index] = value
    return result


STOP = slice(6 * L + 100, 6 * L + 160)
FAULTS: dict[str, Callable[[FloatArray, FloatArray], list[FloatArray]]] = {
    "missing sample": lambda u, y: [u, _with(y, 700, np.nan)],
    "infinite sample": lambda u, y: [_with(u, 700, -np.inf), y],
    "constant": lambda u, y: [u, np.full_like(y, 0.3)],
    "spike": lambda u, y: [u, _with(y, 700, y[700] + 0.2 * np.std(y))],
    "spike of two samples": lambda u, y: [u, _with(y, slice(700, 702), y[700:702] + 0.2 * np.std(y))],
    "clipped": lambda u, y: [np.clip(u, -1.5 * np.std(u), 1.5 * np.std(u)), y],
    "angle starts again": lambda u, y: [u, np.mod(y, 1.0) * 2 * np.pi],
    "lost samples": lambda u, y: [np.concatenate([u[:3000], u[3002:], u[:2]]), y],
    "shifted against the first piece": lambda u, y: [np.roll(u, 1), y],
    "another clock": lambda u, y: [_shifted(u, 0.005), y],
    "stop": lambda u, y: [_with(u, STOP, u[STOP.start]), _with(y, STOP, y[STOP.start])],
    "drift": lambda u, y: [u, y + 3 * np.std(y) * np.sin(np.arange(P * L) / (0.3 * L))],
}


@pytest.mark.parametrize("fault", FAULTS)
def test_pieces_with_a_fault_do_not_pass(fault: str) -> None:
    """Each of the faults that a repair, or a finding, is for."""
    test = _screen()
    assert not any(test.passes(FAULTS[fault](*_piece(np.random.default_rng(seed)))) for seed in range(1, 4))


@pytest.mark.parametrize("pole", [0.0, 0.9, -0.6])
def test_spikes_that_the_rule_replaces_do_not_pass(pole: float) -> None:
    """Of any size, in white noise and in noise that lasts or alternates from sample to sample."""
    replaced = passed = 0
    test = screen(_noisy(0, pole), (L, 1), [0], [0], [np.inf, np.inf])
    for seed in range(1, 31):
        u, y = _noisy(seed, pole)
        rng = np.random.default_rng(seed)
        sample, width = int(rng.integers(L, 15 * L)), int(rng.integers(1, 3))
        y[sample : sample + width] += rng.uniform(8, 40) * 0.01 * np.std(y)
        rule = despiked(y[:, None], L, 1, Log("log", ("y",)))
        if any(finding.kind == REPLACED for finding in rule.findings):
            replaced += 1
            passed += test.passes([u, y])
    assert replaced > 10
    assert passed == 0


def _noisy(seed: int, pole: float) -> list[FloatArray]:
    """A piece whose angle has noise of one pole."""
    from scipy.signal import lfilter

    rng = np.random.default_rng(seed)
    u, y = _piece(rng, noise=0.0)
    coloured = lfilter([np.sqrt(1 - pole**2)], [1, -pole], rng.standard_normal(len(y)))
    return [u + 0.01 * np.std(u) * rng.standard_normal(len(u)), y + 0.01 * np.std(y) * coloured]
