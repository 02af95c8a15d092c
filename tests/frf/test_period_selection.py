"""Spectra period by period: exact derivatives, drift, half waves, transients, outliers, and which lines are excited."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from plants.notes import said

from elastid.base.errors import DataError, StudyError
from elastid.excitation.multisine import synthesise
from elastid.frf.estimate import estimate
from elastid.frf.lines import analysed_lines, find_excited
from elastid.frf.period_selection import trusted
from elastid.frf.spec import EstimatorSpec
from elastid.frf.spectra import PeriodSpectra, RecordSpectra, period_spectra
from elastid.record import MOTION_ORDER, Configuration, Motion, Record

RATE, N = 200.0, 400
LINES = np.arange(5, 80)
AUTO = EstimatorSpec()


def _phases(n: int, seed: int = 0) -> np.ndarray:
    return np.exp(2j * np.pi * np.random.default_rng(seed).random((n, 1)))


def _record(
    periods: int = 4, quantity: Motion = "acceleration", noise: float = 0.0, seed: int = 0, lines: np.ndarray = LINES
) -> Record:
    """u with unit amplitudes, acceleration y = u, given as the quantity asked for; noise on y, relative to y."""
    U = _phases(len(lines), seed)
    j_omega = 2j * np.pi * lines[:, None] * RATE / N
    Y = U / j_omega ** (2 - MOTION_ORDER[quantity])
    u, y = (np.tile(synthesise(lines, X, N), (periods, 1)) for X in (U, Y))
    y = y + noise * y.std() * np.random.default_rng(seed + 1).normal(size=y.shape)
    configuration = Configuration("c", np.zeros(1))
    return Record("c-r0-e0", configuration, 0, 0, RATE, N, ("motor 1",), ("joint 1",), (quantity,), u, y)


def _spectra(record: Record, lines: np.ndarray, quantity: Motion) -> PeriodSpectra:
    return period_spectra(RecordSpectra(record), lines, quantity)


def _kept(record: Record, spec: EstimatorSpec = AUTO) -> tuple[list[int], tuple[str, ...]]:
    found = trusted(_spectra(record, LINES, "acceleration"), spec)
    return found.periods.tolist(), said(found.notes)


@pytest.mark.parametrize("measured", ["position", "velocity", "acceleration"])
@pytest.mark.parametrize("wanted", ["position", "velocity", "acceleration"])
def test_any_motion_becomes_any_other_exactly(measured: Motion, wanted: Motion) -> None:
    """(j omega)^order to rounding, up and down; a finite difference would be 2 % off at the highest line."""
    spectra = _spectra(_record(quantity=measured), LINES, wanted)
    j_omega = 2j * np.pi * LINES * RATE / N
    expected = j_omega ** (MOTION_ORDER[wanted] - 2)
    np.testing.assert_allclose(spectra.Y[:, :, 0] / spectra.U[:, :, 0], np.tile(expected, (4, 1)), rtol=1e-9)


def test_amplitudes_are_those_of_the_sines_whatever_the_period() -> None:
    """|U| is the peak in Nm of each line's cosine."""
    np.testing.assert_allclose(np.abs(_spectra(_record(), LINES, "velocity").U), 1.0, rtol=1e-12)


def test_without_a_rate_a_derivative_is_per_sample() -> None:
    """omega = 2 pi f with f in units of the sampling rate."""
    record = replace(_record(quantity="velocity"), rate_hz=1.0, rate_is_known=False)
    response = estimate([record], AUTO, LINES)
    np.testing.assert_allclose(response.G[:, 0, 0], np.full(75, 1 / RATE), rtol=1e-9)
    np.testing.assert_allclose(response.freq_hz, LINES / N)
    assert not response.rate_is_known


@pytest.mark.parametrize("quantity", ["position", "velocity"])
def test_a_motion_that_drifts_steadily_gives_the_same_spectra(quantity: Motion) -> None:
    """A ramp a thousand times the motion changes nothing: neither amplitude nor, by its scatter, the noise level."""
    record = _record(6, quantity)
    ramp = 1000 * record.y.std() * np.linspace(0, 1, record.n_samples)[:, None]
    still, drifting = (_spectra(r, LINES, quantity).Y for r in (record, replace(record, y=record.y + ramp)))
    np.testing.assert_allclose(drifting, still, rtol=0, atol=1e-9 * np.abs(still).max())


def test_a_position_that_wanders_is_cleaned_of_most_of_its_leakage() -> None:
    """A random walk of the velocity under the position: twenty times less scatter than of the plain DFT."""
    record = _record(20, "position")
    rng = np.random.default_rng(2)
    walk = np.cumsum(np.cumsum(rng.normal(size=record.n_samples)))
    y = record.y + 20 * record.y.std() * (walk / walk.std())[:, None]
    cleaned = _spectra(replace(record, y=y), LINES, "position").Y
    plain = _spectra(replace(record, y=y, quantities=("acceleration",)), LINES, "acceleration").Y
    assert 20 * cleaned.std(axis=0).mean() < plain.std(axis=0).mean()


def test_drift_removal_adds_no_noise_to_an_encoder_without_drift() -> None:
    """White noise on the position: the variance at every line from the third on is what the DFT alone would have."""
    lines = np.arange(3, 80)
    record = _record(2, "position")
    rng, s, variance = np.random.default_rng(0), 0.1, []
    for _ in range(300):
        noisy = replace(record, y=s * rng.normal(size=record.y.shape))
        variance.append(np.mean(np.abs(_spectra(noisy, lines, "position").Y[:, :, 0]) ** 2, axis=0))
    np.testing.assert_allclose(np.mean(variance, axis=0)[0], 4 * s**2 / N, rtol=0.4)
    np.testing.assert_allclose(np.mean(variance, axis=0)[10:].mean(), 4 * s**2 / N, rtol=0.02)


def test_half_wave_records_give_two_estimates_of_a_period_and_a_true_noise_level() -> None:
    """Odd lines, one period of 400 samples, an offset on all signals: G exact, and the noise of white noise."""
    lines = np.arange(1, 120, 2)
    whole = _record(2, lines=lines)
    one = replace(whole, u=3 + whole.u[:N], y=5 + whole.y[:N], half_wave=True)
    response = estimate([one], AUTO)
    np.testing.assert_allclose(response.freq_hz, lines * RATE / N)
    np.testing.assert_allclose(response.G[:, 0, 0], 1.0, rtol=1e-11)
    rng, s, estimated, true = np.random.default_rng(0), 0.1, [], []
    for _ in range(60):
        noisy = estimate([replace(one, y=one.y + s * rng.normal(size=one.y.shape))], AUTO, lines)
        assert noisy.noise is not None
        assert noisy.noise.dof == 1
        estimated.append(noisy.noise.variance.mean())
        true.append(np.mean(np.abs(noisy.G - 1) ** 2))
    assert np.mean(estimated) == pytest.approx(4 * s**2 / N, rel=0.06)
    assert np.mean(true) == pytest.approx(4 * s**2 / N, rel=0.06)


def test_half_wave_records_have_no_even_lines() -> None:
    """`full` is refused, and a half-wave position that is off centre and drifts is no trouble."""
    lines = np.arange(1, 120, 2)
    record = replace(_record(2, "position", lines=lines), half_wave=True)
    with pytest.raises(StudyError, match="full does not go with half_wave"):
        estimate([record], replace(AUTO, lines="full"))
    off_centre = replace(record, y=record.y + 7 + np.linspace(0, 1e-3, 2 * N)[:, None])
    np.testing.assert_allclose(estimate([off_centre], AUTO, lines).G[:, 0, 0], 1.0, atol=2e-2)


@pytest.mark.parametrize(("periods", "noise"), [(3, 1e-3), (4, 1e-2), (6, 1e-3), (12, 1e-2)])
def test_a_transient_at_the_start_is_left_out_and_described(periods: int, noise: float) -> None:
    """A decaying oscillation of 30 % in the first period; the word names record, period, size and channel."""
    record = _record(periods, noise=noise)
    t = np.arange(record.n_samples) / N
    decaying = 0.3 * record.y.std() * np.exp(-8 * t) * np.sin(2 * np.pi * 9.3 * t)
    kept, notes = _kept(replace(record, y=record.y + 3 * decaying[:, None]))
    assert kept == list(range(1, periods))
    assert notes[0].startswith(f"record c-r0-e0: period 1 of {periods} (from 0 s) left out as a transient: ")
    assert "in y joint 1" in notes[0]


def test_the_transient_that_is_stated_is_left_out_whether_seen_or_not() -> None:
    """A number in the study; one that leaves less than two periods is refused."""
    assert _kept(_record(6), replace(AUTO, transient_periods=2))[0] == [2, 3, 4, 5]
    with pytest.raises(DataError, match="transient_periods 3 leaves 1 of 4 periods; at least two"):
        _kept(_record(4), replace(AUTO, transient_periods=3))


def test_two_periods_are_never_split() -> None:
    """With two periods nobody can say which is the bad one."""
    record = _record(2)
    kept, notes = _kept(replace(record, y=record.y * np.linspace(2, 1, 2 * N)[:, None]))
    assert (kept, notes) == ([0, 1], ())


@pytest.mark.parametrize("periods", [5, 8, 20])
def test_single_bad_periods_are_left_out_and_described(periods: int) -> None:
    """A burst of 10 % in one period, a lost sample in the encoder of another (from eight periods on)."""
    record = _record(periods, noise=0.01)
    y = record.y.copy()
    y[3 * N : 3 * N + 100] *= 1.2
    bad = [3]
    if periods >= 8:
        y[5 * N + 17] += 20 * y.std()
        bad.append(5)
    kept, notes = _kept(replace(record, y=y))
    assert kept == [p for p in range(periods) if p not in bad]
    assert f"of {periods} (from {' s and '.join(str(2 * p) for p in bad)} s) left out as no repetition" in notes[0]


@pytest.mark.parametrize("n_lines", [4, 20, 75])
def test_good_periods_are_almost_never_left_out(n_lines: int) -> None:
    """Gaussian noise, 3 to 20 periods, few or many lines: less than one record in a hundred loses a period."""
    lost = 0
    for seed in range(400):
        record = _record((3, 4, 5, 7, 20)[seed % 5], noise=0.05, seed=seed)
        found = trusted(_spectra(record, LINES[:n_lines], "acceleration"), AUTO)
        lost += len(found.periods) < record.n_periods
    assert lost <= 4


def test_periods_whose_noise_level_varies_are_kept() -> None:
    """A robot is not equally quiet all the time: levels within a factor of two are no reason to drop a period."""
    lost, lines = 0, np.arange(1, 200)
    for seed in range(100):
        rng = np.random.default_rng(seed)
        record = _record((3, 4, 5, 7)[seed % 4], lines=lines, seed=seed)
        levels = np.repeat(rng.uniform(0.7, 1.4, record.n_periods), N)[:, None]
        noisy = replace(record, y=record.y * (1 + 0.05 * levels * rng.normal(size=record.y.shape)))
        lost += len(trusted(_spectra(noisy, lines, "acceleration"), AUTO).periods) < record.n_periods
    assert lost <= 1


def test_noise_free_periods_that_differ_by_rounding_are_all_kept() -> None:
    """A simulation without noise repeats to 1e-9, which is no outlier."""
    record = _record(8)
    y = record.y.copy()
    y[: 2 * N] *= 1 + 1e-7
    y[4 * N : 5 * N] *= 1 + 1e-6
    assert _kept(replace(record, y=y))[0] == list(range(8))


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


def test_a_1_over_f_record_keeps_all_its_lines_from_start_to_end() -> None:
    """199 of 199 lines of a noisy record, where a threshold at the strongest line keeps one."""
    lines = np.arange(1, 200)
    u = np.tile(synthesise(lines, _phases(199) / lines[:, None], N * 2), (4, 1))
    rng = np.random.default_rng(1)
    record = Record(
        "r", Configuration("c", np.zeros(1)), 0, 0, RATE, 2 * N, ("motor 1",), ("motor 1",), ("acceleration",),
        u + 1e-3 * rng.normal(size=u.shape), u + 1e-3 * rng.normal(size=u.shape),
    )  # fmt: skip
    np.testing.assert_array_equal(analysed_lines([RecordSpectra(record)], AUTO, None), lines)


def test_inputs_of_noise_have_no_excited_line() -> None:
    """And the message says what to look at."""
    record = _record(4)
    rng = np.random.default_rng(0)
    with pytest.raises(DataError, match="no excited line between 0 and 100 Hz; check period"):
        analysed_lines([RecordSpectra(replace(record, u=rng.normal(size=record.u.shape)))], AUTO, None)
