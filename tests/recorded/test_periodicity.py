"""Periods of an excitation: stated ones confirmed, wrong ones corrected, their absence refused."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from plants.lab_logs import N, measured, save_csv, study_of

from elastid.base.errors import DataError
from elastid.excitation.multisine import orthogonal_set, synthesise
from elastid.recorded.periodicity import repetition


@pytest.mark.parametrize(("stated", "found"), [(199, 200), (210, 200), (100, 200), (90, 200)])
def test_a_wrong_period_is_found_and_the_right_one_said(
    stated: int, found: int, tmp_path: Path, log: dict[str, np.ndarray]
) -> None:
    """By autocorrelation of the inputs; a multiple of the period is right too, and the drift of a position is none."""
    save_csv(tmp_path / "log.csv", log)
    with pytest.raises(DataError, match=rf"does not repeat with the period of {stated} .* every {found} samples"):
        measured(tmp_path, study_of("log.csv", period_samples=stated))
    assert measured(tmp_path, study_of("log.csv", period_samples=400)).n_periods == 2


def test_an_excitation_without_a_period_is_refused(tmp_path: Path, log: dict[str, np.ndarray]) -> None:
    """Noise instead of a multisine."""
    rng = np.random.default_rng(0)
    save_csv(tmp_path / "log.csv", {name: rng.normal(size=800) for name in log})
    with pytest.raises(DataError, match=r"nor at any other lag .* needs a periodic excitation"):
        measured(tmp_path, study_of("log.csv"))


def test_repetition_survives_drift_noise_and_an_input_at_rest() -> None:
    """A ramp a hundred times the signal, noise of its own power, a second input that only rustles."""
    rng = np.random.default_rng(1)
    x = np.tile(synthesise(np.arange(1, 40), np.exp(2j * np.pi * rng.random((39, 1))), 300)[:, 0], 6)
    excited = x + x.std() * (0.7 * rng.normal(size=1800) + np.linspace(0, 100, 1800))
    signals = np.stack([excited, 1e-3 * rng.normal(size=1800)], axis=1)
    assert repetition(signals, 300).is_as_stated
    assert not repetition(signals, 280).is_as_stated
    assert repetition(signals, 280).best_samples == pytest.approx(300, abs=0.5)


def _motion(kind: str, rng: np.random.Generator, n: int = 2501) -> np.ndarray:
    """A motion that does not repeat within n samples."""
    t = np.arange(n)
    if kind == "sum of harmonics of the log":
        return np.asarray(sum(rng.normal() * np.cos(2 * np.pi * (k * t / n + rng.random())) for k in range(1, 8)))
    if kind == "sweep":
        low, high = rng.uniform(1, 5), rng.uniform(8, 40)
        return np.asarray(np.sin(2 * np.pi * (low * t / n + (high - low) * (t / n) ** 2 / 2)))
    knots = np.sort(rng.choice(n - 1, int(rng.integers(6, 25)), replace=False))
    window = np.hanning(int(rng.integers(20, 120)))
    return np.asarray(np.convolve(np.interp(t, knots, rng.normal(size=len(knots))), window / window.sum(), "same"))


@pytest.mark.parametrize("kind", ["sum of harmonics of the log", "sweep", "from point to point"])
@pytest.mark.parametrize("noise", [0.0, 0.1, 0.4])
def test_no_period_of_a_motion_that_does_not_repeat_is_accepted_for_noise(kind: str, noise: float) -> None:
    """Below a correlation of 0.95, whatever the stated period: what differs is slow, and noise is not."""
    rng = np.random.default_rng(7)
    for _ in range(4):
        x = _motion(kind, rng)
        x = x + noise * x.std() * rng.normal(size=len(x))
        found = [repetition(x[:, None], stated) for stated in range(60, 1300, 40)]
        assert not [each for each in found if each.is_as_stated and each.correlation < 0.95]


def test_a_clock_that_runs_a_thousandth_wrong_shows_in_the_period() -> None:
    """Logged at a rate 0.1 % off, the period is 500.5 samples: neither 500 nor 501 repeat it."""
    lines, rng = np.arange(2, 120), np.random.default_rng(2)
    U = np.exp(2j * np.pi * rng.random(len(lines)))
    t = np.arange(20000) / 500.5
    x = sum((u * np.exp(2j * np.pi * k * t)).real for k, u in zip(lines, U, strict=True))
    for stated in (500, 501):
        found = repetition(np.asarray(x)[:, None], stated)
        assert not found.is_as_stated
        assert found.best_samples == pytest.approx(500.5, abs=0.02)


def test_half_wave_records_need_one_period_and_say_so(tmp_path: Path) -> None:
    """Odd lines: x(t + T/2) = -x(t). One period gives two repetitions; without the key the message names it."""
    lines = np.arange(1, 60, 2)
    U = orthogonal_set(np.ones((len(lines), 4)), np.random.default_rng(3))[0]
    save_csv(tmp_path / "log.csv", dict(zip(("i1", "i2", "phi", "w2"), synthesise(lines, U, N).T, strict=True)))
    record = measured(tmp_path, study_of("log.csv", half_wave=True, rate_hz="unknown"))
    assert record.half_wave
    assert record.repeat_samples == 100
    assert not record.rate_is_known
    assert record.rate_hz == 1.0
    for stated in (100, 200):
        with pytest.raises(DataError, match="with period_samples: 200 and half_wave: true one period is enough"):
            measured(tmp_path, study_of("log.csv", period_samples=stated))
    with pytest.raises(DataError, match="second half minus first"):
        measured(tmp_path, study_of("log.csv", period_samples=150, half_wave=True))
