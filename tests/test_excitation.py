"""Grids and orthogonal random-phase multisines."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from elastid.errors import StudyError
from elastid.excitation.grids import grid_lines, line_frequencies
from elastid.excitation.multisine import amplitudes, crest_factor, orthogonal_set, synthesise


def test_full_grid_holds_every_line_of_the_band_and_its_edges() -> None:
    """1 to 40 Hz in a period of 10 s at 2 kHz: lines 10 to 400, though 0.1 Hz is no binary number."""
    lines = grid_lines("full", (1.0, 40.0), 2000.0, 20000)
    assert lines.tolist() == list(range(10, 401))
    np.testing.assert_allclose(line_frequencies(lines, 2000.0, 20000)[[0, -1]], [1.0, 40.0])


@given(first=st.integers(1, 60), width=st.integers(2, 60), n=st.integers(250, 400))
@settings(deadline=None, max_examples=40)
def test_odd_grid_is_odd_wherever_the_band_begins(first: int, width: int, n: int) -> None:
    """Odd lines only, all of those in the band, also where the band begins on an even line."""
    lines = grid_lines("odd", (first / n, (first + width) / n), 1.0, n)
    assert lines.tolist() == [k for k in range(first, first + width + 1) if k % 2]


def test_grid_keeps_clear_of_zero_and_of_half_the_rate() -> None:
    """Neither DC nor the line at half the rate carries a phase."""
    assert grid_lines("full", (0.0, 50.0), 100.0, 10).tolist() == [1, 2, 3, 4]
    assert grid_lines("full", (0.0, 50.0), 100.0, 11).tolist() == [1, 2, 3, 4, 5]


def test_a_band_without_lines_is_refused_with_the_spacing() -> None:
    """The message says how far apart the lines are and what to change."""
    with pytest.raises(StudyError, match=r"band_hz \[2.1, 2.9\] holds no line.*odd multiples of 1 Hz.*longer period"):
        grid_lines("odd", (2.1, 2.9), 100.0, 100)


@given(n_u=st.integers(1, 7), F=st.integers(1, 12), seed=st.integers(0, 2**32))
@settings(deadline=None, max_examples=40)
def test_experiments_of_a_set_are_orthogonal_at_every_line(n_u: int, F: int, seed: int) -> None:
    """U U^H = n_u diag(a^2) to 1e-12, for any number of inputs, six included."""
    amplitude = np.random.default_rng(seed).uniform(0.1, 3, (F, n_u))
    U = orthogonal_set(amplitude, np.random.default_rng(seed)).transpose(1, 2, 0)
    product = U @ U.conj().transpose(0, 2, 1)
    expected = n_u * amplitude[:, :, None] ** 2 * np.eye(n_u)
    np.testing.assert_allclose(product, expected, atol=1e-12 * n_u * 9)


def test_the_same_generator_gives_the_same_set_and_the_next_one_fresh_phases() -> None:
    """Deterministic from the seed; a second realisation is another one."""
    amplitude = np.ones((20, 3))
    rng = np.random.default_rng(5)
    first, second = orthogonal_set(amplitude, rng), orthogonal_set(amplitude, rng)
    np.testing.assert_array_equal(first, orthogonal_set(amplitude, np.random.default_rng(5)))
    assert np.abs(np.mean(second / first)) < 0.5


def test_inputs_of_one_experiment_move_independently_of_each_other() -> None:
    """Random phases between the inputs too: without them the first experiment would move all motors alike."""
    for U in orthogonal_set(np.ones((400, 3)), np.random.default_rng(1)):
        correlation = np.abs(U.conj().T @ U) / 400
        assert np.max(correlation - np.eye(3)) < 0.2


@pytest.mark.parametrize("spectrum", [(), ((2.0, 10.0), (20.0, 1.0))])
def test_every_input_has_the_torque_rms_asked_for_in_every_experiment(
    spectrum: tuple[tuple[float, float], ...],
) -> None:
    """RMS over a period of the sampled signal, for a flat and for a shaped spectrum."""
    lines = grid_lines("odd", (1.0, 40.0), 200.0, 2000)
    rms = np.array([12.0, 3.0, 0.5])
    amplitude = amplitudes(line_frequencies(lines, 200.0, 2000), spectrum, rms)
    for U in orthogonal_set(amplitude, np.random.default_rng(0)):
        torque = synthesise(lines, U, 2000)
        np.testing.assert_allclose(np.sqrt(np.mean(torque**2, axis=0)), rms, rtol=1e-12)


def test_amplitude_table_is_straight_on_log_log_axes() -> None:
    """Points in any order; a slope of -1 between them; constant beyond the ends."""
    freq_hz = np.array([1.0, 2.0, 4.0, 10.0, 20.0, 40.0])
    amplitude = amplitudes(freq_hz, ((20.0, 1.0), (2.0, 10.0)), np.array([1.0]))[:, 0]
    np.testing.assert_allclose(amplitude / amplitude[4], [10, 10, 5, 2, 1, 1])


def test_synthesis_is_the_sum_of_its_cosines() -> None:
    """u(t) = Re sum U exp(j omega t), the phasor convention of model and estimator."""
    lines, U = np.array([2, 5]), np.array([[1 + 1j], [0.5 - 2j]])
    t = np.arange(64) / 64
    expected = sum((u * np.exp(2j * np.pi * k * t)).real for k, u in zip(lines, U[:, 0], strict=True))
    np.testing.assert_allclose(synthesise(lines, U, 64)[:, 0], expected, atol=1e-13)


def test_crest_factor_of_a_sine_is_sqrt_two_and_of_a_pulse_train_is_high() -> None:
    """One line: peak / RMS = sqrt 2. F lines in phase: F / sqrt(F / 2)."""
    assert crest_factor(np.array([3]), np.array([[2j]])) == pytest.approx(np.sqrt(2), rel=1e-2)
    in_phase = crest_factor(np.arange(1, 33), np.ones((32, 1), dtype=np.complex128))
    assert in_phase == pytest.approx(np.sqrt(2 * 32), rel=1e-2)


def test_median_crest_factor_of_random_phases_is_the_known_one() -> None:
    """Full grid of 31 lines: 2.86 is the median of random phases (identification.md 9.3)."""
    rng = np.random.default_rng(0)
    crest = [crest_factor(np.arange(1, 32), np.exp(2j * np.pi * rng.random((31, 1))))[0] for _ in range(400)]
    assert np.median(crest) == pytest.approx(2.858, rel=0.02)
