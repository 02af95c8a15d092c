"""Of the poles of a response those are chosen that are modes, or those that are named."""

import numpy as np
import pytest
from modal.structures import BENCH, FREQ_HZ, NATURAL, ZETA, modal_response

from elastid.modal.estimate import estimate_modes
from elastid.response import Covariance, Response


def test_noise_alone_has_no_mode() -> None:
    """Eight records, white and rising with frequency, one to four outputs, stated and not."""
    for seed in range(8):
        rng = np.random.default_rng(seed)
        shape = (len(FREQ_HZ), 1 + seed % 4, 1)
        std = (FREQ_HZ / 10 if seed % 2 else np.ones(len(FREQ_HZ)))[:, None, None] * np.ones(shape)
        G = std * (rng.normal(size=shape) + 1j * rng.normal(size=shape)) / np.sqrt(2)
        noise = Covariance(std**2, np.inf) if seed < 4 else None
        outputs = tuple(f"y{i}" for i in range(shape[1]))
        assert estimate_modes(Response(FREQ_HZ, G, ("u",), outputs, "velocity", BENCH, noise)).n_modes == 0


@pytest.mark.slow
def test_six_by_six_and_chosen_poles() -> None:
    """Poles that are named are taken: two of five, of 6 x 6; the others are in the residuals of a band."""
    shapes = np.random.default_rng(2).normal(size=(6, 5))
    response = modal_response(FREQ_HZ, NATURAL, ZETA, shapes, 6, 0.01)
    assert estimate_modes(response).n_modes == 5
    modes = estimate_modes(response, band_hz=(20, 50), poles_hz=(25.2, 41))
    np.testing.assert_allclose(modes.freq_hz, [25, 41], rtol=1e-3)
    np.testing.assert_allclose(modes.zeta, ZETA[1:3], rtol=0.02)


def test_a_chosen_frequency_without_a_pole_is_named() -> None:
    """Between two modes there is none: the pole that wanders to a mode is not that at 55 Hz; two may name one mode."""
    shapes = np.random.default_rng(2).normal(size=(3, 5))
    response = modal_response(FREQ_HZ, NATURAL, ZETA, shapes, 1, 0.01)
    modes = estimate_modes(response, poles_hz=(55.0,))
    assert modes.n_modes == 0
    assert [note.code for note in modes.notes] == ["modal/poles"]
    assert "no pole is at 55 Hz" in modes.notes[0].text
    both = estimate_modes(response, band_hz=(20, 33), poles_hz=(25.1, 25.2))
    np.testing.assert_allclose(both.freq_hz, [25], rtol=1e-3)
    with pytest.raises(ValueError, match="above 0 Hz"):
        estimate_modes(response, poles_hz=(-5.0,))
