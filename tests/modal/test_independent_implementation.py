"""Modes agree with those of sdypy-EMA, another least-squares complex frequency estimator with LSFD."""

import numpy as np
import pytest
from modal.structures import modal_response

from elastid.modal.estimate import estimate_modes
from elastid.modal.modes import mac


@pytest.mark.filterwarnings("ignore:.*outside the frequency range")  # its own upper limit, which it cuts off
def test_poles_and_shapes_agree_with_sdypy_ema() -> None:
    """Four modes seen at five places under one force, noise of 0.05 %: frequencies to 0.02 %, dampings to 5 %.

    Its estimator minimises an equation error, in which noise raises dampings by some per cent.
    """
    EMA = pytest.importorskip("sdypy.EMA")
    freq_hz = np.arange(1, 800) / 8
    natural, zeta = np.array([18.0, 34.0, 52.0, 77.0]), np.array([0.012, 0.02, 0.01, 0.015])
    shapes = np.random.default_rng(3).normal(size=(5, 4))
    response = modal_response(freq_hz, natural, zeta, shapes, noise=0.0005)
    modes = estimate_modes(response)
    peer = EMA.Model(response.G[:, :, 0].T, freq_hz, lower=5, upper=98, pol_order_high=40)
    peer.get_poles(show_progress=False)
    peer.select_closest_poles(list(natural), f_window=5)
    _, constants = peer.get_constants(whose_poles="own")
    np.testing.assert_allclose(modes.freq_hz, peer.nat_freq, rtol=2e-4)
    np.testing.assert_allclose(modes.zeta, peer.nat_xi, rtol=0.05)
    np.testing.assert_allclose(np.diag(mac(modes.shapes, constants)), 1, atol=1e-3)
    # The truth is nearer to these modes than to the equation error's.
    assert np.all(np.abs(modes.freq_hz - natural) < 4 * modes.freq_std)
    assert np.all(np.abs(modes.zeta - zeta) < 4 * modes.zeta_std)
