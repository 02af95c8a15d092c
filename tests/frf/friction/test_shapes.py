"""Shapes of friction follow the motor's motion, reversals within a sample included."""

import hypothesis.strategies as st
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis.extra.numpy import arrays

from elastid.frf.friction.shapes import Shape, motion_of, reversal_curve, shape_samples, stop
from elastid.record import Configuration, Motion, Record

RATE, N = 200.0, 400


def swinging(line: int, amplitude: float, quantity: Motion = "position", periods: int = 2) -> Record:
    """A motor that swings as a cosine, given as the quantity asked for."""
    omega = 2 * np.pi * line * RATE / N
    order = {"position": 0, "velocity": 1, "acceleration": 2}[quantity]
    phase = omega * np.arange(periods * N) / RATE + order * np.pi / 2
    y = (amplitude * omega**order * np.cos(phase))[:, None]
    configuration = Configuration("c", np.zeros(1))
    return Record("c", configuration, 0, 0, RATE, N, ("motor 1",), ("motor 1",), (quantity,), 0 * y, y)


@settings(max_examples=50)
@given(arrays(np.float64, 40, elements=st.floats(-3, 3)), st.floats(0.1, 4))
def test_a_stop_operator_follows_its_recursion(q: np.ndarray, D: float) -> None:
    """s(k) = clip(s(k - 1) + q(k) - q(k - 1), -D, D), also where q stands still."""
    q = np.round(q, 1)
    expected = [0.0]
    for step in np.diff(q):
        expected.append(min(max(expected[-1] + step, -D), D))
    np.testing.assert_allclose(stop(q, D), expected, atol=1e-12)


@pytest.mark.parametrize("quantity", ["position", "velocity", "acceleration"])
@pytest.mark.parametrize("line", [1, 7, 33])
def test_the_sign_of_a_sinusoid_has_its_fourier_series(quantity: Motion, line: int) -> None:
    """4 / (pi k) at its odd harmonics, against a sine, as exact at 33 lines of 200 as at one."""
    record = swinging(line, 0.1, quantity)
    phi = shape_samples(record, {"motor 1": motion_of(record, "motor 1")}, [Shape("motor 1", "sign")])
    spectrum = np.fft.rfft(phi[:, 0].reshape(2, N), axis=1) * 2 / N
    for k in (k for k in (1, 3, 5) if k * line < N / 2):
        np.testing.assert_allclose(spectrum[:, k * line], 4j / (np.pi * k), atol=2e-3 / k)


def test_a_stop_operator_of_a_sinusoid_has_its_first_harmonic() -> None:
    """At D = A, half of the way from end to end bends it: s = D - (A - q) down to -D, where it slides.

    Its first harmonic over D is that of a cosine clipped on one side, by quadrature here.
    """
    amplitude, D = 0.2, 0.1
    record = swinging(3, amplitude)
    phi = shape_samples(record, {"motor 1": motion_of(record, "motor 1")}, [Shape("motor 1", "stop", D)])
    angle = 2 * np.pi * np.arange(200_000) / 100_000
    s = stop(amplitude * np.cos(angle), D)[100_000:] / D
    expected = np.mean(s * np.exp(-1j * angle[100_000:])) * 2
    np.testing.assert_allclose(np.fft.rfft(phi[:, 0].reshape(2, N), axis=1)[:, 3] * 2 / N, expected, atol=1e-3)


def test_a_stop_operator_of_a_small_threshold_is_the_sign() -> None:
    """Its first harmonics, where the motion is a thousand times larger; it is late by its reversals."""
    record = swinging(3, 0.2)
    motions = {"motor 1": motion_of(record, "motor 1")}
    signs, stops = (
        np.fft.rfft(shape_samples(record, motions, [shape])[:N, 0])[[3, 9, 15]] * 2 / N
        for shape in (Shape("motor 1", "sign"), Shape("motor 1", "stop", 2e-4))
    )
    np.testing.assert_allclose(stops, signs, atol=0.06)


def test_a_reversal_goes_from_one_direction_to_the_other() -> None:
    """Over twice the threshold."""
    curve = reversal_curve(Shape("motor 1", "stop", 0.1), np.array([0.0, 0.1, 0.2, 0.5]))
    np.testing.assert_allclose(curve, [-1, 0, 1, 1])
    np.testing.assert_allclose(reversal_curve(Shape("motor 1", "sign"), np.array([0.0, 1e-9])), [-1, 1])
