"""Moments of a torque in each sample give its spectrum, and the samples of its integrals with all their images."""

import numpy as np
import pytest

from elastid.nonlinear.moments import Moments

N, CELLS = 40, 32


def switching(edge: float) -> tuple[np.ndarray, Moments]:
    """Times of jumps of 2, up and down in turn, at cells' edges; and moments of a signal of 1 and -1 that jumps."""
    times = np.array([3.25, 11.5, 17.75, 30.0 + edge])
    t = (np.arange(N * CELLS) + 0.5) / CELLS
    signal = np.where(np.searchsorted(times, t) % 2 == 0, -1.0, 1.0)
    return times, Moments.of_means(signal.reshape(N, CELLS))


def lines_of(times: np.ndarray, lines: np.ndarray) -> np.ndarray:
    """Transform of jumps of 2 and -2 in turn over j omega."""
    s = 2j * np.pi * lines / N
    return np.exp(-np.outer(s, times)) @ (2.0 * (-1.0) ** np.arange(len(times))) / s


@pytest.mark.parametrize("edge", [0.0, 0.375])
def test_the_spectrum_is_that_of_the_jumps(edge: float) -> None:
    """Below half the rate to 1e-3 of the largest line, by which cells round a jump; exact for one constant in cells."""
    times, moments = switching(edge)
    lines = np.arange(1, N // 2 + 1)
    expected = lines_of(times, lines)
    np.testing.assert_allclose(moments.of_cells[1:], expected, atol=2e-5 * np.abs(expected).max())
    np.testing.assert_allclose(moments.spectrum(N // 2 + 1)[1:], expected, atol=1e-3 * np.abs(expected).max())


@pytest.mark.parametrize("order", [2, 3, 4])
@pytest.mark.parametrize("line", [N - 3, N + 3])
def test_a_wave_above_half_the_rate_is_an_image(order: int, line: int) -> None:
    """Its integral appears below half the rate, to 1e-3 of its amplitude, and at no other line."""
    t, width = (np.arange(N * CELLS) + 0.5) / CELLS, 2 * np.pi * line / (N * CELLS)
    means = np.cos(2 * np.pi * line / N * t + 0.4) * np.sin(width / 2) / (width / 2)
    found = Moments.of_means(means.reshape(N, CELLS)).images(order)
    of_line = N / 2 * np.exp(0.4j) / (2j * np.pi * line / N) ** order
    expected = np.zeros(N // 2 + 1, complex)
    expected[3] = of_line if line > N else np.conj(of_line)
    np.testing.assert_allclose(found, expected, atol=1e-3 * abs(of_line))


def test_a_held_torque_moves_a_mass_as_steps_of_velocity_do() -> None:
    """Samples of the second integral by recursion over samples, but for the start, the mean velocity and no mean."""
    torque = np.random.default_rng(0).standard_normal(N)
    torque -= torque.mean()
    velocity = np.append(0.0, np.cumsum(torque)[:-1])
    velocity -= np.mean(velocity + torque / 2)
    angle = np.append(0.0, np.cumsum(velocity + torque / 2)[:-1])
    found = np.fft.irfft(Moments.held(torque).integral(2), N)
    np.testing.assert_allclose(found - found[0], angle, atol=1e-12 * np.abs(angle).max() + 1e-12)


def test_a_sum_of_steady_and_changing_samples_is_that_of_all_cells() -> None:
    """To rounding."""
    rng = np.random.default_rng(1)
    steady, changing, means = rng.standard_normal(N), np.array([2, 7, 31]), rng.standard_normal((3, CELLS))
    every = np.repeat(steady[:, None], CELLS, axis=1)
    every[changing] = means
    found, expected = Moments.of_steady(steady, changing, means), Moments.of_means(every)
    np.testing.assert_allclose(found.mu, expected.mu, atol=1e-14)
