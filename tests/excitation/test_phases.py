"""Phases and orthogonal sets."""

import numpy as np
import pytest
from plants.refusals import refused
from plants.two_mass import circular
from scipy.optimize import approx_fprime

from elastid.excitation.grids import grid_lines, with_detection
from elastid.excitation.phases import (
    Signals,
    _norm,
    crest_factors,
    hadamard,
    minimise_peaks,
    newman,
    orthogonal_basis,
    peaks,
    random_phases,
    schroeder,
)


@pytest.mark.parametrize("n", [1, 2, 4, 8, 12, 16, 20, 24])
def test_hadamard_matrices_are_signs_and_orthogonal(n: int) -> None:
    """H^T H = n I, entries +-1."""
    H = hadamard(n)
    np.testing.assert_array_equal(np.abs(H), 1)
    np.testing.assert_array_equal(H.T @ H, n * np.eye(n))


@pytest.mark.parametrize("n", [3, 6, 10, 28])
def test_without_a_hadamard_matrix_the_dft_is_offered(n: int) -> None:
    """The message says for which numbers there is one, and what to take instead."""
    with refused("excitation/lines"):
        hadamard(n)


def test_a_zippered_experiment_excites_one_input_at_each_line() -> None:
    """Every input in turn, over the experiments of a set."""
    W = orthogonal_basis("zippered", 10, 3)
    assert np.all((W != 0).sum(axis=2) == 1)
    assert np.all((W != 0).sum(axis=0) == 1)


def one_signal(lines: np.ndarray, amplitude: np.ndarray) -> Signals:
    F = len(lines)
    rms = np.array([np.sqrt(np.sum(amplitude**2) / 2)])
    return Signals(lines, amplitude[None, :, None].astype(complex), np.ones((F, 1, 1), complex), rms)


def eye(F: int, n_u: int) -> np.ndarray:
    return np.repeat(np.eye(n_u)[None], F, axis=0).astype(complex)


def test_crest_factor_is_sqrt_2_for_sine_high_for_pulses() -> None:
    """One line: peak / RMS = sqrt 2. F lines in phase: F / sqrt(F / 2)."""
    assert crest_factors(np.array([3]), np.array([2j])) == pytest.approx(np.sqrt(2), rel=1e-2)
    assert crest_factors(np.arange(1, 33), np.ones(32, complex)) == pytest.approx(np.sqrt(2 * 32), rel=1e-2)


def test_known_crest_factors_of_random_schroeder_and_newman_phases() -> None:
    """Full grid of 31 lines: 2.86 is the median of random phases, 1.78 Schroeder's; Newman's are near those."""
    rng, lines = np.random.default_rng(0), np.arange(1, 32)
    crest = crest_factors(lines, np.exp(1j * random_phases((400, 31), rng)))
    assert np.median(crest) == pytest.approx(2.858, rel=0.02)
    assert crest_factors(lines, np.exp(1j * schroeder(np.ones(31)))) == pytest.approx(1.781, abs=2e-3)
    assert crest_factors(lines, np.exp(1j * newman(31))) < 1.9


@pytest.mark.parametrize("p", [4, 64])
def test_gradient_of_the_norm_is_its_derivative(p: int) -> None:
    """Against finite differences, for a set of two inputs seen through a response to three outputs."""
    rng, lines = np.random.default_rng(3), np.array([1, 2, 4, 7, 8])
    response = circular(rng, (5, 3, 2))
    signals = Signals(lines, orthogonal_basis("dft", 5, 2), response, np.array([1.0, 2.0, 0.5]))
    phases = rng.uniform(0, 6, 20)
    _, gradient = _norm(phases, signals, p, 64)
    numeric = approx_fprime(phases, lambda x: _norm(x, signals, p, 64)[0], 1e-7)
    np.testing.assert_allclose(gradient, numeric, atol=1e-5)


@pytest.mark.parametrize(
    ("lines", "power", "goal"),
    [
        pytest.param(np.arange(1, 32), 0, 1.41, id="full 31"),
        pytest.param(grid_lines("quasi-log", (1, 400), 2000, 2000, 1.11), 0, 1.87, id="quasi-log"),
        pytest.param(np.arange(1, 65), 0, 1.41, id="full 64"),
        pytest.param(np.arange(1, 62, 2), 0, 1.41, id="odd 31"),
        pytest.param(np.arange(41, 141), 0, 1.48, id="band"),
        pytest.param(
            with_detection(np.arange(1, 400, 2), 4, np.random.default_rng(0)).excited, *(0, 1.46), id="odd-random"
        ),
        pytest.param(np.arange(1, 32), -1, 1.20, id="1/f"),
    ],
)
def test_optimised_phases_reach_the_crest_factors_of_long_searches(
    lines: np.ndarray, power: float, goal: float
) -> None:
    """True peaks; what peers reach at best, in a fraction of a second."""
    signals = one_signal(lines, lines.astype(float) ** power)
    _, S = signals.spectra(*minimise_peaks(signals, np.random.default_rng(0)))
    assert crest_factors(lines, S).max() <= goal


@pytest.mark.slow
def test_all_signals_of_an_orthogonal_set_are_compressed_together() -> None:
    """Worst of the 36 signals of six inputs: at most 1.51, where random phases have 4 and Schroeder's 1.9."""
    lines = np.arange(1, 41)
    signals = Signals(lines, orthogonal_basis("dft", 40, 6), eye(40, 6), np.full(6, np.sqrt(20)))
    a, b = minimise_peaks(signals, np.random.default_rng(0))
    U, S = signals.spectra(a, b)
    assert crest_factors(lines, S).max() <= 1.51
    product = U.transpose(1, 2, 0) @ U.transpose(1, 0, 2).conj()
    np.testing.assert_allclose(product, 6 * eye(40, 6), atol=1e-10)


def test_torque_and_velocity_are_compressed_together() -> None:
    """Behind a resonance a flat torque of crest 1.4 has a peaky velocity; both in one cost come out below 1.75."""
    lines = np.arange(1, 61)
    s = 1j * lines / 20.0
    velocity = s / (s**2 + 0.1 * s + 1)
    both = np.stack([np.ones(60), velocity], axis=1)[:, :, None].astype(complex)
    scale = np.sqrt(np.sum(np.abs(both[:, :, 0]) ** 2, axis=0) / 2)
    signals = Signals(lines, np.ones((1, 60, 1), complex), both, scale)
    _, S = signals.spectra(*minimise_peaks(signals, np.random.default_rng(0)))
    assert crest_factors(lines, S).max() < 1.75
    a, b = minimise_peaks(one_signal(lines, np.ones(60)), np.random.default_rng(0))
    assert crest_factors(lines, signals.spectra(a, b)[1])[0, 1] > 2


def test_peaks_are_found_between_the_samples() -> None:
    """The true peak of two cosines in phase is at 0, wherever the samples are."""
    S = np.exp(-1j * np.array([5, 6]) * 0.01)
    assert peaks(np.array([5, 6]), S) == pytest.approx(2.0, rel=5e-3)
