"""Lines found excited in recorded inputs, whatever the shape of the spectrum."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from plants.refusals import refused
from plants.steady_record import AUTO, LINES, N, steady_record

from elastid.frf import lines as module
from elastid.frf import spectra
from elastid.frf.lines import analysed_lines, find_excited, smoothed_noise
from elastid.frf.spectra import RecordSpectra


def _spectrum(kind: str, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Excited lines and their amplitudes."""
    full = np.arange(1, 200)
    if kind == "1/f":
        return full, 1.0 / full
    if kind == "odd":
        return full[::2], np.ones(100)
    if kind == "odd with detection lines":
        odd = full[::2]
        lines = np.delete(odd, [4 * i + int(rng.integers(4)) for i in range(25)])
        return lines, np.ones(len(lines))
    if kind == "quasi-logarithmic":
        lines = np.unique(np.round(np.geomspace(1, 200, 40)).astype(int))
        return lines, np.ones(len(lines))
    if kind == "quasi-logarithmic 1/f^2":
        lines = np.unique(np.round(np.geomspace(1, 200, 40)).astype(int))
        return lines, lines**-2.0
    if kind == "band":
        return np.arange(41, 141), np.ones(100)
    notch = np.abs(full**2 - 90**2 + 0.6j * full) / 90**2  # u of a plant held by its support
    return full, notch


KINDS = ["1/f", "odd", "odd with detection lines", "quasi-logarithmic", "quasi-logarithmic 1/f^2", "band", "notch"]


@pytest.mark.parametrize("kind", KINDS)
def test_excited_lines_are_found_in_spectra_of_every_shape(kind: str) -> None:
    """Exactly the excited ones, with noise 60 dB and nonlinear distortion 35 dB below the excited lines next to it."""
    rng = np.random.default_rng(0)
    lines, amplitude = _spectrum(kind, rng)
    candidates = np.arange(1, 500)
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


def test_a_transient_in_the_first_period_hides_no_line() -> None:
    """An offset of the torque that decays, a hundred times the excitation: all lines of the other periods are found."""
    record = steady_record(6)
    decaying = 100 * record.u.std() * np.exp(-np.arange(record.n_samples) / 20)[:, None]
    found = analysed_lines([RecordSpectra(replace(record, u=record.u + decaying))], AUTO, None)
    np.testing.assert_array_equal(found, LINES)


def test_noise_of_few_degrees_of_freedom_is_averaged_over_its_neighbours() -> None:
    """Five lines for one, three for two, none for four; a constant stays."""
    peak = np.zeros(21)
    peak[10] = 1.0
    for dof, width in ((1, 5), (2, 3), (4, 1)):
        np.testing.assert_allclose(
            smoothed_noise(peak, dof), np.where(np.abs(np.arange(21) - 10) <= width // 2, 1 / width, 0)
        )
        np.testing.assert_allclose(smoothed_noise(np.ones(21), dof), 1.0)


def test_the_driver_of_a_large_record_has_the_mean_and_noise_of_all_its_periods(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
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
