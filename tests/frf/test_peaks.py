"""Peaks of a measured response: their frequency and damping are those of the structure, within their intervals."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import lfilter

from elastid.experiment.simulated.structure import shake, true_modes, true_response
from elastid.frf.estimate import estimate
from elastid.frf.peaks import peaks
from elastid.frf.spec import EstimatorSpec
from elastid.record import Configuration, Record
from elastid.response import Covariance, FrequencyResponse

BENCH = Configuration("bench", np.zeros(0))
PLACES = ("1", "2", "3")


def exact(freq_hz: np.ndarray, std: float | None = None) -> FrequencyResponse:
    """The true response of the three masses, with noise of `std` times its median magnitude."""
    G = true_response(freq_hz)
    if std is None:
        return FrequencyResponse(freq_hz, G, ("a", "b"), PLACES, "acceleration", BENCH)
    random, sigma = np.random.default_rng(3), std * float(np.median(np.abs(G)))
    noise = sigma * (random.standard_normal(G.shape) + 1j * random.standard_normal(G.shape)) / np.sqrt(2)
    covariance = Covariance(np.full(G.shape, sigma**2), np.inf)
    return FrequencyResponse(freq_hz, G + noise, ("a", "b"), PLACES, "acceleration", BENCH, noise=covariance)


def test_an_exact_response_gives_frequency_and_damping() -> None:
    """To the error of a local polynomial for the other modes: frequency to 1e-5, damping to 1e-3 of itself."""
    natural, damping, _ = true_modes()
    found = peaks(exact(np.arange(20, 800) / 8))
    np.testing.assert_allclose([peak.freq_hz for peak in found], natural / (2 * np.pi), rtol=1e-5)
    np.testing.assert_allclose([peak.damping for peak in found], damping, rtol=1e-3)


@pytest.mark.parametrize("std", [0.01, 0.1])
def test_noise_is_no_peak(std: float) -> None:
    """Three masses have three peaks; those in the noise show no damping that differs from zero."""
    assert len(peaks(exact(np.arange(20, 800) / 8, std))) == 3


def test_a_response_without_peaks_has_none() -> None:
    freq_hz = np.arange(1, 50) / 10
    assert peaks(exact(freq_hz)) == ()
    flat = exact(freq_hz)
    assert peaks(replace(flat, G=np.zeros_like(flat.G))) == ()


def test_the_intervals_hold_the_truth() -> None:
    """Mean square of error over std of frequency and damping, 40 draws of the noise of whole records: at most 2."""
    natural, damping, _ = true_modes()
    errors = []
    for draw in range(40):
        logs = [log for m in range(2) for log in shake(256.0, 2048, 3, 100 + 2 * draw + m)]
        records = [
            Record(f"{i}", BENCH, i // 2, i % 2, 256.0, 2048, ("a", "b"), PLACES, ("acceleration",) * 3, *parts)
            for i, parts in enumerate((log.force, log.acceleration) for log in logs)
        ]
        found = peaks(estimate(tuple(records), EstimatorSpec(method="arithmetic"), None))
        errors.append(
            [
                ((peak.freq_hz - omega / (2 * np.pi)) / peak.freq_std, (peak.damping - zeta) / peak.damping_std)
                for peak, omega, zeta in zip(found, natural, damping, strict=True)
            ]
        )
    assert np.all(np.mean(np.square(errors), axis=0) < 2)


def test_errors_that_neighbouring_lines_share_widen_the_intervals() -> None:
    """Noise averaged over eight lines, 20 draws: rms errors are at most those stated, and would not be without them."""
    freq_hz, c = np.arange(20, 800) / 8, 8
    true, errors, stated = exact(freq_hz), [], []
    natural = true_modes()[0] / (2 * np.pi)
    sigma = 0.01 * float(np.median(np.abs(true.G)))
    covariance = Covariance(np.full(true.G.shape, sigma**2), np.inf)
    for seed in range(20):
        random = np.random.default_rng(seed)
        white = [random.standard_normal((len(freq_hz) + c - 1, *true.G.shape[1:])) for _ in range(2)]
        noise = np.sum([(white[0] + 1j * white[1])[k : k + len(freq_hz)] for k in range(c)], axis=0)
        G = true.G + sigma * noise / np.sqrt(2 * c)
        found = peaks(replace(true, G=G, noise=covariance, correlated_lines=float(c)))
        errors.append([found[0].freq_hz - natural[0], found[2].freq_hz - natural[2]])
        stated.append([found[0].freq_std, found[2].freq_std])
    ratio = np.sqrt(np.mean(np.square(errors), axis=0) / np.mean(np.square(stated), axis=0))
    assert np.all(ratio < 1.15), ratio
    assert np.any(ratio * np.sqrt(c) > 1.3), ratio


def test_a_pole_that_leaves_its_lines_is_no_peak() -> None:
    """A step without bound, from a bump between the peaks of this draw, ends the search; the three peaks are found."""
    logs = [log for m in range(2) for log in shake(256.0, 2048, 3, 2472 + m)]
    records = [
        Record(f"{i}", BENCH, i // 2, i % 2, 256.0, 2048, ("a", "b"), PLACES, ("acceleration",) * 3, *parts)
        for i, parts in enumerate((log.force, log.acceleration) for log in logs)
    ]
    assert len(peaks(estimate(records, EstimatorSpec(method="arithmetic")))) == 3


def test_bumps_of_correlated_noise_are_no_peaks() -> None:
    """Windows of a local method overlap, so that neighbouring lines share their noise."""
    response = exact(np.arange(20, 800) / 8, 0.1)
    random = np.random.default_rng(5)
    white = random.standard_normal((response.n_lines + 10, 6)) + 1j * random.standard_normal((response.n_lines + 10, 6))
    smooth = np.stack([np.convolve(column, np.ones(11), "valid") for column in white.T], axis=1).reshape(-1, 3, 2)
    assert response.noise is not None
    bumps = smooth * np.sqrt(response.noise.variance / np.mean(np.abs(smooth) ** 2))
    assert peaks(replace(response, G=bumps)) == ()


MODES = ((8.0, 0.02), (17.0, 0.015), (31.0, 0.012), (48.0, 0.01), (70.0, 0.01))


def shaken(seed: int) -> Record:
    """A minute of random force on five modes at 200 Hz, and 1 % of noise on their motion."""
    rng = np.random.default_rng(seed)
    u, y = rng.normal(size=14_000), np.zeros(14_000)
    for freq_hz, damping in MODES:
        pole = np.exp(2 * np.pi * freq_hz / 200 * (1j * np.sqrt(1 - damping**2) - damping))
        y += freq_hz * lfilter([0, pole.imag], [1, -2 * pole.real, abs(pole) ** 2], u)
    u, y = u[2000:, None], y[2000:, None]
    y += 0.01 * y.std() * rng.normal(size=y.shape)
    return Record("a", BENCH, 0, 0, 200.0, len(u), ("1",), ("1",), ("velocity",), u, y, is_periodic=False)


def test_dampings_by_segments_are_within_their_intervals() -> None:
    """Five modes of a random shaker by H1, too large by leakage: all of 20, but for a few, with it and few without."""
    held, without = [], []
    for seed in range(4):
        response = estimate([shaken(seed)], EstimatorSpec(method="h1", quantity="velocity"))
        for inside, each in ((held, response), (without, replace(response, leakage=None, total=response.noise))):
            dampings = {round(peak.freq_hz): peak for peak in peaks(each)}
            for freq_hz, damping in MODES:
                peak = next(peak for f, peak in dampings.items() if abs(f - freq_hz) <= 1)
                inside.append(abs(peak.damping - damping) < 1.96 * peak.damping_std)
    assert np.mean(held) >= 0.9
    assert np.mean(without) < 0.4
