"""A stop within a period."""

from pathlib import Path

import numpy as np
import pytest
from plants.lab_logs import N, Signals, multisines, record_of
from plants.notes import noted, said
from plants.waves import outcome

from elastid.logs.repair.masks import without_stops


def _log(periods: int) -> Signals:
    rng = np.random.default_rng(1)
    signals = multisines(np.arange(2, 60), N, periods * N)
    return {name: x + 1e-3 * x.std() * rng.normal(size=len(x)) for name, x in signals.items()}


def _stopped(log: Signals, first: int, last: int) -> Signals:
    """The drives are off: no current but noise, and no motion."""
    noise = 1e-3 * np.random.default_rng(2).normal(size=last - first)
    rest = {"i1": noise, "i2": noise, "phi": np.full(last - first, log["phi"][first]), "w2": noise}
    return {name: np.r_[x[:first], rest[name], x[last:]] for name, x in log.items()}


def test_stop_within_period_is_named_and_discarded(tmp_path: Path) -> None:
    """The third of six periods stops after 60 samples; the others are as they were logged."""
    whole = _log(6)
    record = record_of(tmp_path, _stopped(whole, 460, 600))
    assert record.discarded_periods == (2,)
    (note,) = (text for text in said(record.notes) if "as at a stop" in text)
    assert "repetitions 3 of 6" in note
    kept = np.r_[0:400, 600:1200]
    np.testing.assert_allclose(record.u[kept, 1], whole["i1"][kept] * 0.5e-3 * -50.0, rtol=1e-12)


@pytest.mark.parametrize("friction", [0.0, 0.3, 0.8])
def test_a_multisine_stops_nowhere_whatever_friction_noise_and_rounding_do(friction: float) -> None:
    """Fifty logs of a controlled motor, whose Coulomb friction is that part of the rms of the torque that is sent."""
    L = 1000
    for i, signals in enumerate(_with_friction(friction, 50, L)):
        noise = np.random.default_rng(i).standard_normal(signals.shape)
        for step, std in ((0.0, 1e-3), (0.02, 1e-3), (0.1, 0.0), (0.0, 0.1)):
            x = signals + std * noise
            x = step * np.round(x / step) if step else x
            assert not outcome(without_stops, x, [0], L)[1]


def _with_friction(friction: float, count: int, L: int) -> np.ndarray:
    """Torque and angle (count, 4 L, 2) of motors under position control, each of unit rms."""
    lines, per_sample = np.arange(2, 80), 4
    spectra = np.zeros((L * per_sample // 2 + 1, count), complex)
    spectra[lines] = np.exp(2j * np.pi * np.random.default_rng(4).random((len(lines), count)))
    sent = np.fft.irfft(spectra, axis=0)
    sent /= sent.std(axis=0)
    q, v, dt, inertia = np.zeros(count), np.zeros(count), 1 / (500 * per_sample), 0.01
    signals = np.empty((4 * L, 2, count))
    for k in range(4 * L * per_sample):
        u = sent[k % len(sent)] - 2.0 * q - 0.1 * v
        if k % per_sample == 0:
            signals[k // per_sample] = u, q
        free = v + dt * (u - 0.02 * v) / inertia
        v = np.sign(free) * np.maximum(0.0, np.abs(free) - dt * friction / inertia)
        q = q + dt * v
    return np.moveaxis(signals / signals.std(axis=0), 2, 0)


@pytest.mark.parametrize("periods", [6, 20])
def test_what_follows_a_stop_for_good_is_cut_off(periods: int, tmp_path: Path) -> None:
    """Stopped in the fourth period, for up to most of the log."""
    record = record_of(tmp_path, _stopped(_log(periods), 700, periods * N))
    assert (record.n_periods, record.discarded_periods) == (3, ())
    assert noted(*record.notes) == ("records/corrected", "record home-r0-e0", [*range(4, periods + 1), periods])


@pytest.mark.parametrize("periods", [3, 6])
def test_log_from_before_excitation_keeps_all_periods(periods: int, tmp_path: Path) -> None:
    """Rest during 0.7 of the first period is a start, no stop, and later periods show that the period is right."""
    log = {name: np.where(np.arange(periods * N) < 140, 0.0, x) for name, x in _log(periods).items()}
    record = record_of(tmp_path, log)
    assert (record.n_periods, record.discarded_periods) == (periods, ())
    assert not any("stop" in text for text in said(record.notes))


@pytest.mark.parametrize("rest", [2 * N, 5 * N + 90])
def test_rest_before_the_excitation_is_left_out(rest: int, tmp_path: Path) -> None:
    """In whole periods, of which the log has as many as it holds of motion, or more; part of one is a transient."""
    log = _log(4)
    noise = 1e-3 * np.random.default_rng(4).normal(size=(rest, 4))
    before = dict(zip(log, noise.T, strict=True))
    record = record_of(tmp_path, {name: np.r_[before[name], x] for name, x in log.items()})
    assert record.n_periods == (4 * N + rest % N) // N
    code, place, (start, _, discarded) = noted(record.notes[0])
    assert (code, place, discarded) == ("records/corrected", "record home-r0-e0", rest // N)
    assert abs(start - rest) <= 1
    kept = log["i1"][: 4 * N - rest % N]
    np.testing.assert_allclose(record.u[rest % N :, 1], kept * 0.5e-3 * -50.0, rtol=1e-12)
