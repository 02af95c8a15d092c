"""Records without a period: Welch's H1 against SciPy, closed forms and Monte Carlo."""

from dataclasses import replace

import numpy as np
import pytest
from plants.noise_record import AXIS, H1, MIX, RATE, SWEPT_HZ, Resonances, noise_record, sweeps
from plants.notes import noted
from plants.refusals import advised, refused
from scipy.signal import coherence, csd, lfilter

from elastid.frf.estimate import estimate
from elastid.frf.spec import EstimatorSpec, Method
from elastid.frf.welch import Segments, make_segments
from elastid.record import Configuration, Record


@pytest.mark.parametrize("window", ["hann", "hamming", "boxcar"])
def test_h1_and_coherence_are_those_of_scipy(window: str) -> None:
    """One input and one output, to rounding, at all lines of the segment but the first and the last."""
    record = noise_record(5000, 0, n=1, noise=0.3)
    spec = replace(H1, window=window)
    how = {"fs": RATE, "window": window, "nperseg": 256, "noverlap": 128}
    freq_hz, uy = csd(record.u[:, 0], record.y[:, 0], **how)
    uu = csd(record.u[:, 0], record.u[:, 0], **how)[1]
    inside = slice(1, 128)
    h1 = estimate([record], spec)
    np.testing.assert_allclose(h1.freq_hz, freq_hz[inside])
    np.testing.assert_allclose(h1.G[:, 0, 0], (uy / uu)[inside], rtol=1e-11)
    gamma2 = coherence(record.u[:, 0], record.y[:, 0], **how)[1][inside]
    np.testing.assert_allclose(h1.quality.coherence[:, 0, 0], gamma2, rtol=1e-11)
    np.testing.assert_allclose(h1.quality.multiple_coherence[:, 0], gamma2, rtol=1e-11)


def test_several_records_and_inputs_are_pooled_like_scipys_cross_spectra() -> None:
    """Two inputs, two outputs, records of different length: one inverse of the sum of all segments at every line."""
    records = [noise_record(n, seed, noise=0.2, realisation=seed) for seed, n in enumerate((4000, 2700))]
    S = {"yu": np.zeros((127, 2, 2), complex), "uu": np.zeros((127, 2, 2), complex)}
    for record in records:
        count = 1 + (record.n_samples - 256) // 128
        for name, x in (("yu", record.y), ("uu", record.u)):
            each = csd(record.u.T[None], x.T[:, None], fs=RATE, nperseg=256)[1]
            S[name] += count * np.moveaxis(each, 2, 0)[1:128]
    response = estimate(records, H1)
    np.testing.assert_allclose(response.G, S["yu"] @ np.linalg.inv(S["uu"]), rtol=1e-10)


def test_leakage_is_in_the_total_covariance() -> None:
    """A resonance of 1 % at 30 Hz, four lines wide, from rest without noise: mean square over variance of its lines."""
    plant, squares = Resonances((30.0,)), []
    for seed in range(20):
        record = noise_record(60_000, seed, n=1)
        response = estimate([replace(record, y=plant.driven(record.u))], replace(H1, segment=6.4))
        near = np.abs(response.freq_hz - 30) < 0.3
        error = np.abs(response.G[near, 0, 0] - plant.G(response.freq_hz[near])) ** 2
        stated = (response.noise.variance[near, 0, 0], response.total.variance[near, 0, 0])
        squares.append((float(np.mean(error / stated[0])), float(np.mean(error / stated[1]))))
    of_noise, of_total = np.mean(squares, axis=0)
    assert of_noise > 5
    assert 0.5 < of_total < 2


@pytest.mark.parametrize("repeats", [1, 3])
def test_sine_in_few_segments_leaks_within_intervals(repeats: int) -> None:
    """More than 95 % of the regions hold the truth, by coherence and leakage of a window alone some 86 %."""
    for snr_db in (30.0, 50.0):
        records = [replace(each, is_periodic=False) for each in sweeps(repeats, snr_db, np.random.default_rng(0))]
        response = estimate(records, EstimatorSpec(method="h1", quantity="velocity", band_hz=SWEPT_HZ))
        square = np.abs(response.G[:, 0, 0] - AXIS.G(response.freq_hz)) ** 2
        assert np.mean(square < -np.log(0.05) * response.total.variance[:, 0, 0]) > 0.95


def test_sweep_ending_with_record_is_smoothed_by_window() -> None:
    """w^2 of segments over all samples are one constant; lines beyond the sweep's last frequency, 80 Hz, are left out.

    Two resonances, one passed 2 s before the end: the response is the truth smoothed by |W|^2 within 1 %, where
    segments of half overlap are 14 % off.
    """
    t = np.arange(int(60 * RATE)) / RATE
    u = np.sin(2 * np.pi * (4 * t + 76 / 120 * t**2))[:, None]
    plant = Resonances((30.0, 77.0))
    record = replace(noise_record(len(u), 0, n=1), u=u, y=plant.driven(u))
    response = estimate([record], replace(H1, segment=512 / RATE))
    assert 77.5 < response.freq_hz[-1] < 82
    fine = np.arange(0, RATE / 2, RATE / 512 / 16)
    kernel = np.abs(np.fft.fft(make_segments([record], replace(H1, segment=512 / RATE)).window, 512 * 16)) ** 2
    smooth = np.convolve(plant.G(fine), np.fft.fftshift(kernel)[4096 - 64 : 4096 + 65] / kernel.sum(), "same")
    at = (response.freq_hz > 6) & (response.freq_hz < 78)
    truth_there = np.interp(response.freq_hz[at], fine, smooth)
    assert np.linalg.norm(response.G[at, 0, 0] - truth_there) < 0.01 * np.linalg.norm(truth_there)


def test_hann_leakage_is_second_difference_and_boxcar_has_none() -> None:
    """Kernel |W|^2: 1/6, 2/3, 1/6; noise makes of it what correlated lines make of a second difference."""
    hann = np.sin(np.pi * np.arange(256) / 256) ** 2
    weights, noise = Segments(hann, 128).leakage
    np.testing.assert_allclose(weights, np.array([1, -2, 1]) / 6, atol=1e-12)
    assert noise == pytest.approx((6 - 8 * 4 / 9 + 2 / 36) / 36)
    weights, noise = Segments(np.ones(256), 128).leakage
    assert not weights.any()
    assert noise == 0


@pytest.mark.parametrize("window", ["hann", "boxcar"])
def test_the_error_has_the_variance_that_is_stated(window: str) -> None:
    """Mean squared error over mean variance of 60 records of two inputs: 1 within 10 %."""
    squares, variances = [], []
    for seed in range(60):
        # A plant without memory has no leakage: noise alone is left.
        record = noise_record(4000, seed, noise=0.0)
        y = record.u @ MIX.T + np.random.default_rng(seed + 1000).normal(size=record.u.shape)
        spec = replace(H1, window=window, segment=0.64)
        response = estimate([replace(record, y=y)], spec)
        squares.append(np.abs(response.G - MIX) ** 2)
        variances.append(response.total.variance)
    assert np.mean(squares) / np.mean(variances) == pytest.approx(1.0, abs=0.1)


def test_proportional_inputs_are_refused_and_narrow_resonance_reported() -> None:
    """One signal on both inputs; a segment shorter than the decay of a resonance."""
    record = noise_record(3000, 0)
    with refused("frf/inputs-not-separable", place="configuration c"):
        estimate([replace(record, u=record.u[:, [0, 0]])], H1)
    rng = np.random.default_rng(0)
    u = rng.normal(size=(20_000, 1))
    y = Resonances((30.0,), 1e-3).driven(u)
    notes = estimate([replace(noise_record(20_000, 0, n=1), u=u, y=y)], H1).notes
    (note,) = (note for note in notes if note.severity == "warning")
    assert noted(note) == ("frf/segment", "configuration c", pytest.approx([1.28, 1, 1, 29.69, 7.24], rel=0.01))


@pytest.mark.parametrize(("segment", "says"), [(0.01, "Give at least"), (9.0, "to at most")])
def test_the_segment_that_a_refusal_gives_is_taken(segment, says):
    """Two inputs in 10 s at 200 Hz: of four samples at least, and of a sixth of the record at most."""
    record = noise_record(2000, 0)
    with refused("frf/segment", holds="configuration c: ") as caught:
        estimate([record], replace(H1, segment=segment))
    assert advised(caught, says) == pytest.approx(0.02 if segment < 1 else 10 / 6, rel=0.01)
    assert len(estimate([record], replace(H1, segment=advised(caught, says))).freq_hz)


def test_independent_segments_equal_welch() -> None:
    """Hann: 50 % overlap correlates neighbours by 1/6, so that their power by 1/36 (Welch, 1967); boxcar by 1/4."""
    hann = np.sin(np.pi * np.arange(256) / 256) ** 2
    assert Segments(hann, 256).independent(2560) == pytest.approx(10)
    assert Segments(hann, 128).independent(1280) == pytest.approx(9 / (1 + 2 * (8 / 9) / 36), rel=1e-6)
    assert Segments(np.ones(256), 128).independent(1280) == pytest.approx(9 / (1 + 2 * (8 / 9) / 4), rel=1e-9)
    assert Segments(hann, 128).count(255) == 0


def low_passed_record(seed: int) -> Record:
    """White torque through a first-order low pass, output noise of a tenth; no period."""
    rng = np.random.default_rng(seed)
    u = rng.standard_normal((4096, 1))
    y = lfilter([0.5], [1, -0.5], u, axis=0) + 0.1 * rng.standard_normal((4096, 1))
    return Record(
        "noise", Configuration("c", [0.0]), 0, 0, 100.0, 4096, ("motor 1",), ("motor 1",), ("position",), u, y,
        is_periodic=False,
    )  # fmt: skip


@pytest.mark.parametrize("method", ["h1", "local_polynomial"])
@pytest.mark.slow
def test_line_count_is_sum_of_error_autocorrelation(method: Method) -> None:
    """12 records; errors relative to their scatter, lags up to a hundred lines."""
    spec = EstimatorSpec(method=method, quantity="position", lines="full", band_hz=(2.0, 45.0))
    found = [estimate([low_passed_record(seed)], spec) for seed in range(12)]
    G = np.stack([response.G[:, 0, 0] for response in found])
    errors = (G - G.mean(axis=0)) / G.std(axis=0)
    rho = [float(np.mean((errors[:, : -lag or None].conj() * errors[:, lag:]).real)) for lag in range(60)]
    assert found[0].correlated_lines == pytest.approx(1 + 2 * sum(rho[1:]) / rho[0], rel=0.35)
