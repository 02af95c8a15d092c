"""Multisines: orthogonal sets, the torques asked for, and their signals."""

import numpy as np
import pytest
from excitation.test_phases import eye
from hypothesis import given, settings
from hypothesis import strategies as st

from elastid.excitation.grids import grid_lines, line_frequencies
from elastid.excitation.multisine import (
    Sweep,
    amplitudes,
    experiments,
    orthogonal_set,
    relative_amplitudes,
    small_multisine,
    sweep_spectrum,
    synthesise,
)
from elastid.excitation.phases import crest_factors
from elastid.excitation.spec import Phases


@pytest.mark.parametrize("spectrum", [(), ((2.0, 10.0), (20.0, 1.0))])
def test_inputs_have_requested_rms_in_every_experiment(spectrum: tuple[tuple[float, float], ...]) -> None:
    """RMS over a period of the sampled signal, for a flat and for a shaped spectrum."""
    lines = grid_lines("odd", (1.0, 40.0), 200.0, 2000)
    rms = np.array([12.0, 3.0, 0.5])
    amplitude = amplitudes(relative_amplitudes(line_frequencies(lines, 200.0, 2000), 0.0, spectrum), rms)
    for U in orthogonal_set(amplitude, np.random.default_rng(0)):
        np.testing.assert_allclose(np.sqrt(np.mean(synthesise(lines, U, 2000) ** 2, axis=0)), rms, rtol=1e-12)


def test_amplitude_table_is_log_linear_and_multiplies_power_law() -> None:
    """Points in any order; a slope of -1 between them; constant beyond the ends."""
    freq_hz = np.array([1.0, 2.0, 4.0, 10.0, 20.0, 40.0])
    table = relative_amplitudes(freq_hz, 0.0, ((20.0, 1.0), (2.0, 10.0)))
    np.testing.assert_allclose(table / table[4], [10, 10, 5, 2, 1, 1])
    np.testing.assert_allclose(relative_amplitudes(freq_hz, -0.5, ((20.0, 1.0), (2.0, 10.0))), table * freq_hz**-0.5)


def test_synthesis_is_the_sum_of_its_cosines() -> None:
    """u(t) = Re sum U exp(j omega t), the phasor convention of model and estimator."""
    lines, U = np.array([2, 5]), np.array([[1 + 1j], [0.5 - 2j]])
    t = np.arange(64) / 64
    expected = sum((u * np.exp(2j * np.pi * k * t)).real for k, u in zip(lines, U[:, 0], strict=True))
    np.testing.assert_allclose(synthesise(lines, U, 64)[:, 0], expected, atol=1e-13)


@given(
    case=st.sampled_from([("dft", 3), ("dft", 6), ("hadamard", 4), ("zippered", 3), ("zippered", 6), ("dft", 1)]),
    phases=st.sampled_from(["random", "schroeder", "newman", "linear-sweep", "log-sweep", "prbs"]),
    odd=st.booleans(),
)
@settings(deadline=None, max_examples=30)
def test_every_set_has_orthogonal_inputs_of_equal_power(case: tuple, phases: Phases, odd: bool) -> None:
    """U U^H is diagonal at every line, and over the lines every input has n_u times the power of its amplitudes."""
    kind, n_u = case
    lines = grid_lines("odd" if odd else "full", (1.0, 40.0), 100.0, 100)
    amplitude = np.random.default_rng(1).uniform(0.5, 2, (len(lines), n_u))
    U = experiments(phases, kind, lines, amplitude, np.random.default_rng(2), eye(len(lines), n_u)).transpose(1, 2, 0)
    product = U @ U.conj().transpose(0, 2, 1)
    off = product - np.einsum("fii->fi", product)[:, :, None] * np.eye(n_u)
    assert np.abs(off).max() < 1e-10
    np.testing.assert_allclose(np.einsum("fii->i", product).real, n_u * np.sum(amplitude**2, axis=0), rtol=1e-10)
    assert np.linalg.cond(U).max() < 100


def test_optimised_phases_lower_the_crest_factor_of_the_compressed_signal() -> None:
    """Of the torque of a lone input: below 1.45, where random phases have more than 2; amplitudes stay."""
    lines, amplitude = np.arange(1, 16), np.ones((15, 1))
    crest = []
    for phases in ("optimised", "random"):
        U = experiments(phases, "dft", lines, amplitude, np.random.default_rng(0), eye(15, 1))
        np.testing.assert_allclose(np.abs(U), 1.0)
        crest.append(crest_factors(lines, U[0, :, 0]))
    assert crest[0] < 1.45
    assert crest[1] > 2


def test_binary_signal_is_flat_and_logarithmic_sweep_decreases() -> None:
    """Lines of a band-limited pseudo-random binary signal are alike to a factor of 2; 1 / f of power by a sweep."""
    lines = np.arange(10, 200)
    magnitude = np.abs(sweep_spectrum("prbs", lines))
    assert magnitude.max() / magnitude.min() < 2
    low, high = np.abs(sweep_spectrum("log-sweep", lines))[[20, 160]]
    assert low / high == pytest.approx(np.sqrt(lines[160] / lines[20]), rel=0.2)


@pytest.mark.parametrize("lines", [np.arange(10, 200), np.arange(11, 400, 2)])
@pytest.mark.parametrize("kind", ["linear-sweep", "log-sweep"])
def test_sweep_passes_lines_from_first_to_last(kind: Sweep, lines: np.ndarray) -> None:
    """Group delay of the middle lines, in the sweep's length: a period, or half of one with odd lines."""
    delay = -np.diff(np.unwrap(np.angle(sweep_spectrum(kind, lines)))) / (2 * np.pi) % 1
    at = (np.log(lines) if kind == "log-sweep" else lines)[:-1]
    np.testing.assert_allclose(delay[40:-40], (np.interp(at, at[[0, -1]], [0.0, 1.0]))[40:-40], atol=0.05)


def test_a_sweep_multiplies_the_amplitudes_that_are_asked_for() -> None:
    """Twice the amplitude at a line is twice that of the sweep there, at the power of the amplitudes."""
    lines, amplitude = np.arange(10, 60), np.ones((50, 1))
    amplitude[20:] = 2.0
    U = experiments("linear-sweep", "dft", lines, amplitude, np.random.default_rng(0), eye(50, 1))[0, :, 0]
    expected = amplitude[:, 0] * np.abs(sweep_spectrum("linear-sweep", lines))
    np.testing.assert_allclose(np.abs(U) / np.linalg.norm(U), expected / np.linalg.norm(expected), rtol=1e-12)
    assert np.linalg.norm(U) == pytest.approx(np.linalg.norm(amplitude), rel=1e-12)


def test_small_multisine_is_odd_with_requested_peak() -> None:
    """Within its band; the second half of its period is the first one reversed."""
    signal = small_multisine(0.3, (2.0, 9.0), 1000, 100.0, np.random.default_rng(1))
    assert np.abs(signal).max() == pytest.approx(0.3, rel=1e-12)
    np.testing.assert_allclose(signal[500:], -signal[:500], atol=1e-12)
    power = np.abs(np.fft.rfft(signal)) ** 2
    assert power[20:91].sum() == pytest.approx(power.sum(), rel=1e-12)
