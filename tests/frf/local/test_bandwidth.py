"""Modes of a response by their half-power bandwidth, and windows that are wider."""

import numpy as np

from elastid.frf.local.bandwidth import local_modes, wide_windows

FREQ = np.arange(10.0, 131.0)


def _modes(freq_hz: np.ndarray, Phi: np.ndarray, zeta: float = 0.02) -> np.ndarray:
    """G (F, n, n) of two modes of shapes Phi (2, n): torque to velocity."""
    n = Phi.shape[1]
    s, G = 2j * np.pi * freq_hz[:, None, None], np.zeros((len(freq_hz), n, n), dtype=np.complex128)
    for f, phi in zip((45.0, 80.0), Phi, strict=True):
        omega = 2 * np.pi * f
        G += omega * s / (s**2 + 2 * zeta * omega * s + omega**2) * np.outer(phi, phi)
    return G


def test_modes_are_found_with_their_bandwidth() -> None:
    """2 zeta f_0 of two modes to 3 %, on a fine grid."""
    freq_hz = np.linspace(20, 120, 4001)
    G = _modes(freq_hz, np.eye(2))
    found = local_modes(freq_hz, G, np.zeros(G.shape))
    np.testing.assert_allclose(found.freq_hz, [45, 80], rtol=5e-3)
    np.testing.assert_allclose(found.bandwidth_hz, 2 * 0.02 * found.freq_hz, rtol=0.03)
    assert len(local_modes(freq_hz, G, np.full(G.shape, np.abs(G).max() ** 2 / 100)).freq_hz) == 0


def test_a_window_wider_than_the_modal_bandwidth_gets_a_word() -> None:
    """With the numbers; a polynomial where one mode is narrower, a rational function where it holds too many modes."""
    G = _modes(FREQ, np.eye(2), zeta=0.05)
    found = local_modes(FREQ, G, np.zeros(G.shape))
    span = np.full(len(FREQ), 9.0)
    (word,) = wide_windows(found, FREQ, span, poles=0)
    assert "the bandwidth of 2 of 2 modes: 9 Hz at 45 Hz, where the mode is 4." in word.text
    assert wide_windows(found, FREQ, span / 3, poles=0) == []
    assert wide_windows(found, FREQ, span, poles=2) == []
    assert "2 modes share a window of 90 Hz" in wide_windows(found, FREQ, 10 * span, poles=1)[0].text
