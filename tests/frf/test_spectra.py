"""Spectra period by period: derivatives, amplitudes, drift, half waves; lines found excited, whatever their shape."""

from dataclasses import replace

import numpy as np
import pytest
from plants.refusals import refused
from plants.steady_record import AUTO, LINES, RATE, N, periods_of, steady_record

from elastid.base.arrays import IntArray
from elastid.frf import lines as module
from elastid.frf import spectra
from elastid.frf.estimate import estimate
from elastid.frf.lines import analysed_lines, find_excited
from elastid.frf.spectra import RecordSpectra, single_logs, undivided_logs
from elastid.record import MOTION_ORDER, Motion


@pytest.mark.parametrize("lines", [LINES, np.array([1, 2, 7, N // 8 - 1]), np.array([3, N // 2 - 1])])
def test_amplitudes_are_those_of_the_transform_of_each_period(lines: IntArray) -> None:
    record = steady_record(3)
    record = replace(record, u=np.random.default_rng(0).standard_normal(record.u.shape))
    expected = np.fft.rfft(record.u.reshape(3, N, -1), axis=1)[:, lines] * 2 / N
    np.testing.assert_allclose(RecordSpectra(record).amplitudes("u", lines), expected, rtol=0, atol=1e-12)


@pytest.mark.parametrize("measured", ["position", "velocity", "acceleration"])
@pytest.mark.parametrize("wanted", ["position", "velocity", "acceleration"])
def test_any_motion_becomes_any_other_exactly(measured: Motion, wanted: Motion) -> None:
    """(j omega)^order to rounding, up and down; a finite difference would be 2 % off at the highest line."""
    spectra = periods_of(steady_record(quantity=measured), LINES, wanted)
    j_omega = 2j * np.pi * LINES * RATE / N
    expected = j_omega ** (MOTION_ORDER[wanted] - 2)
    np.testing.assert_allclose(spectra.Y[:, :, 0] / spectra.U[:, :, 0], np.tile(expected, (4, 1)), rtol=1e-9)


def test_without_a_rate_a_derivative_is_per_sample() -> None:
    """omega = 2 pi f with f in units of the sampling rate."""
    record = replace(steady_record(quantity="velocity"), rate_hz=1.0, has_rate=False)
    response = estimate([record], AUTO, LINES)
    np.testing.assert_allclose(response.G[:, 0, 0], np.full(75, 1 / RATE), rtol=1e-9)
    np.testing.assert_allclose(response.freq_hz, LINES / N)
    assert not response.has_rate


@pytest.mark.parametrize("quantity", ["position", "velocity"])
def test_a_motion_that_drifts_steadily_gives_the_same_spectra(quantity: Motion) -> None:
    """A ramp a thousand times the motion changes nothing: neither amplitude nor, by its scatter, the noise level."""
    record = steady_record(6, quantity)
    ramp = 1000 * record.y.std() * np.linspace(0, 1, record.n_samples)[:, None]
    still, drifting = (periods_of(r, LINES, quantity).Y for r in (record, replace(record, y=record.y + ramp)))
    np.testing.assert_allclose(drifting, still, rtol=0, atol=1e-9 * np.abs(still).max())


def test_drift_correction_removes_most_leakage_of_position() -> None:
    """A random walk of the velocity under the position: twenty times less scatter than of the plain DFT."""
    record = steady_record(20, "position")
    rng = np.random.default_rng(2)
    walk = np.cumsum(np.cumsum(rng.normal(size=record.n_samples)))
    y = record.y + 20 * record.y.std() * (walk / walk.std())[:, None]
    cleaned = periods_of(replace(record, y=y), LINES, "position").Y
    plain = periods_of(replace(record, y=y, quantities=("acceleration",)), LINES, "acceleration").Y
    assert 20 * cleaned.std(axis=0).mean() < plain.std(axis=0).mean()


def test_drift_removal_adds_no_noise_to_an_encoder_without_drift() -> None:
    """White noise on the position: the variance at every line from the third on is what the DFT alone would have."""
    lines = np.arange(3, 80)
    record = steady_record(2, "position")
    rng, s, variance = np.random.default_rng(0), 0.1, []
    for _ in range(300):
        noisy = replace(record, y=s * rng.normal(size=record.y.shape))
        variance.append(np.mean(np.abs(periods_of(noisy, lines, "position").Y[:, :, 0]) ** 2, axis=0))
    np.testing.assert_allclose(np.mean(variance, axis=0)[0], 4 * s**2 / N, rtol=0.4)
    np.testing.assert_allclose(np.mean(variance, axis=0)[10:].mean(), 4 * s**2 / N, rtol=0.02)


def test_half_wave_records_give_two_estimates_and_noise() -> None:
    """Odd lines, one period of 400 samples, an offset on all signals: G exact, and the noise of white noise."""
    lines = np.arange(1, 120, 2)
    whole = steady_record(2, lines=lines)
    one = replace(whole, u=3 + whole.u[:N], y=5 + whole.y[:N], half_wave=True)
    response = estimate([one], AUTO)
    np.testing.assert_allclose(response.freq_hz, lines * RATE / N)
    np.testing.assert_allclose(response.G[:, 0, 0], 1.0, rtol=1e-11)
    rng, s, estimated, true = np.random.default_rng(0), 0.1, [], []
    for _ in range(60):
        noisy = estimate([replace(one, y=one.y + s * rng.normal(size=one.y.shape))], AUTO, lines)
        assert noisy.noise.dof == 1
        estimated.append(noisy.noise.variance.mean())
        true.append(np.mean(np.abs(noisy.G - 1) ** 2))
    assert np.mean(estimated) == pytest.approx(4 * s**2 / N, rel=0.06)
    assert np.mean(true) == pytest.approx(4 * s**2 / N, rel=0.06)


def test_half_wave_position_with_drift_keeps_other_spectra() -> None:
    """What moves the mean of the record, and not the ends of the other half periods, is no part of these."""
    lines, half = np.arange(1, 120, 2), N // 2
    record = replace(steady_record(3, "position", lines=lines), half_wave=True)
    moved = record.y.copy()
    moved[2 * half : 3 * half, 0] += record.y.std() * np.hanning(half) ** 8
    still, slow = (periods_of(replace(record, y=y), lines, "position").Y for y in (record.y, moved))
    np.testing.assert_allclose(np.delete(slow, 2, 0), np.delete(still, 2, 0), rtol=0, atol=1e-6 * record.y.std())


def test_half_wave_records_have_no_even_lines() -> None:
    """`full` is refused, and a half-wave position that is off centre and drifts is no trouble."""
    lines = np.arange(1, 120, 2)
    record = replace(steady_record(2, "position", lines=lines), half_wave=True)
    with refused("study/invalid", place="estimator.lines"):
        estimate([record], replace(AUTO, lines="full"))
    off_centre = replace(record, y=record.y + 7 + np.linspace(0, 1e-3, 2 * N)[:, None])
    np.testing.assert_allclose(estimate([off_centre], AUTO, lines).G[:, 0, 0], 1.0, atol=2e-2)


def test_record_of_two_logs_names_log_of_missing_samples() -> None:
    """Samples, references and periods left out are those of each log."""
    record = replace(steady_record(), starts=(1,), discarded_periods=(2,))
    first, second = single_logs(record)
    assert (first.name, second.name) == (f"{record.name}, log 1", f"{record.name}, log 2")
    np.testing.assert_array_equal(first.y, record.y[:N])
    np.testing.assert_array_equal(second.u, record.u[N:])
    assert (first.discarded_periods, second.discarded_periods) == ((), (1,))
    with refused("records/missing-samples", place="record c-r0-e0, log 2"):
        undivided_logs([record])
    y = np.array(record.y)
    y[N + 5] = np.nan
    with refused("records/values", place="record c-r0-e0, log 2"):
        undivided_logs([replace(record, y=y, discarded_periods=())])
    assert len(undivided_logs([replace(record, discarded_periods=()), steady_record()])) == 3


FULL, DENSE = np.arange(1, 200), np.unique(np.round(np.geomspace(1, 200, 40)).astype(int))
ODD = FULL[::2]
SHAPES = {
    "1/f": (FULL, 1.0 / FULL),
    "odd": (ODD, np.ones(100)),
    "odd with detection lines": (np.delete(ODD, 4 * np.arange(25) + np.tile([2, 0, 3, 1, 1], 5)), np.ones(75)),
    "quasi-logarithmic": (DENSE, np.ones(len(DENSE))),
    "quasi-logarithmic 1/f^2": (DENSE, DENSE**-2.0),
    "band": (np.arange(41, 141), np.ones(100)),
    "notch": (FULL, np.abs(FULL**2 - 90**2 + 0.6j * FULL) / 90**2),  # u of a plant held by its support
}


@pytest.mark.parametrize(("lines", "amplitude"), SHAPES.values(), ids=SHAPES)
def test_excited_lines_are_found_in_spectra_of_every_shape(lines: np.ndarray, amplitude: np.ndarray) -> None:
    """Exactly the excited ones, with noise 60 dB and nonlinear distortion 35 dB below the excited lines next to it."""
    rng, candidates = np.random.default_rng(0), np.arange(1, 500)
    noise = 1e-6 * np.min(amplitude) ** 2 * np.ones(len(candidates))
    power = noise * rng.exponential(size=len(noise))
    distortion = 10**-3.5 * np.interp(candidates, lines, amplitude**2) * (candidates < 400)
    power += distortion * rng.exponential(size=len(noise))
    power[lines - 1] = amplitude**2
    found = candidates[find_excited(candidates, power / power.max(), noise / power.max())]
    np.testing.assert_array_equal(found, lines)


def test_inputs_of_noise_have_no_excited_line() -> None:
    """And the message says what to look at."""
    record = steady_record(4)
    rng = np.random.default_rng(0)
    with refused("frf/lines", place="configuration c"):
        analysed_lines([RecordSpectra(replace(record, u=rng.normal(size=record.u.shape)))], AUTO, None)


def test_large_record_has_mean_and_noise_of_all_periods(monkeypatch: pytest.MonkeyPatch) -> None:
    """One period at a time, the first of five left out."""
    record = steady_record(5)
    rng = np.random.default_rng(0)
    u = record.u + 0.1 * rng.normal(size=record.u.shape)
    X = np.fft.rfft(u.reshape(5, N, 1), axis=1)[1:, LINES] * (2 / N)
    monkeypatch.setattr(spectra, "MIN_LARGE_VALUES", 0)
    monkeypatch.setattr(spectra, "PIECE_VALUES", 1)
    mean, noise = module._mean_driver(RecordSpectra(replace(record, u=u)), LINES, 1)
    np.testing.assert_allclose(mean, X.mean(axis=0))
    np.testing.assert_allclose(noise, X.var(axis=0, ddof=1) / 4)
