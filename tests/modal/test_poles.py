"""Poles over model orders are those of the structure."""

import numpy as np
from modal.structures import BENCH, FREQ_HZ, modal_response

from elastid.experiment.simulated.plant import true_modes, true_response
from elastid.modal.estimate import estimate_modes
from elastid.modal.modes import mac, turned
from elastid.response import Response


def test_an_exact_response_gives_its_modes() -> None:
    """Three masses: frequencies, dampings and shapes to rounding."""
    natural, damping, shapes = true_modes()
    freq_hz = np.arange(20, 800) / 8
    response = Response(freq_hz, true_response(freq_hz), ("a", "b"), ("1", "2", "3"), "acceleration", BENCH)
    modes = estimate_modes(response)
    np.testing.assert_allclose(modes.freq_hz, natural / (2 * np.pi), rtol=1e-9)
    np.testing.assert_allclose(modes.zeta, damping, rtol=1e-8)
    np.testing.assert_allclose(np.diag(mac(modes.shapes, shapes)), 1, atol=1e-12)
    np.testing.assert_allclose(modes.collinearity, 1, atol=1e-12)
    np.testing.assert_allclose(modes.synthesis, response.G, atol=1e-9 * np.abs(response.G).max())
    largest = np.take_along_axis(shapes, np.abs(shapes).argmax(axis=0)[None], axis=0)
    np.testing.assert_allclose(turned(modes.shapes).real, shapes / largest, atol=1e-8)


def test_a_double_root_is_two_modes() -> None:
    """Two shapes at 40 Hz, two inputs: both, whose span is that of the true ones."""
    shapes = np.array([[1.0, 0.2, 0.5], [0.3, -1.0, 0.4], [0.6, 0.5, -0.9], [-0.2, 0.8, 0.3]])
    response = modal_response(FREQ_HZ, np.array([40.0, 40.0, 70.0]), np.array([0.01, 0.01, 0.02]), shapes, 2, 0.002)
    modes = estimate_modes(response)
    np.testing.assert_allclose(modes.freq_hz, [40, 40, 70], rtol=1e-4)
    plane, _ = np.linalg.qr(modes.shapes[:, :2])
    outside = shapes[:, :2] - plane @ (plane.conj().T @ shapes[:, :2])
    assert np.abs(outside).max() < 0.01
