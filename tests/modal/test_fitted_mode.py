"""Numbers of a mode within their standard deviations, and notes on poles that are none."""

import numpy as np
import pytest
from modal.structures import FREQ_HZ, NATURAL, ZETA, modal_response

from elastid.modal.estimate import estimate_modes


@pytest.mark.parametrize("stated", [True, False])
def test_noise_hides_no_mode_and_makes_none(stated: bool) -> None:
    """Five modes of 3 x 1 with noise of 2 % of the rms: each within five standard deviations, stated or not."""
    shapes = np.random.default_rng(1).normal(size=(3, 5))
    modes = estimate_modes(modal_response(FREQ_HZ, NATURAL, ZETA, shapes, noise=0.02, stated=stated))
    assert modes.n_modes == 5
    assert np.all(np.abs(modes.freq_hz - NATURAL) < 5 * modes.freq_std)
    assert np.all(np.abs(modes.zeta - ZETA) < 5 * modes.zeta_std)
    assert np.all(modes.zeta_std < 0.05 * ZETA)
    deviation = np.abs(modes.shapes - shapes / shapes[np.abs(shapes).argmax(axis=0), np.arange(5)])
    assert np.all(deviation < 5 * modes.shape_std + 1e-12)


def test_the_intervals_of_a_draw_are_its_errors() -> None:
    """Mean square of error over std of frequency and damping, 25 draws of five modes: 0.6 to 1.5."""
    errors = []
    for seed in range(25):
        modes = estimate_modes(modal_response(FREQ_HZ, NATURAL, ZETA, np.ones((1, 5)), noise=0.01, seed=seed), None, 16)
        errors.append([(modes.freq_hz - NATURAL) / modes.freq_std, (modes.zeta - ZETA) / modes.zeta_std])
    squares = np.mean(np.square(errors), axis=(0, 2))
    assert np.all(squares > 0.6)
    assert np.all(squares < 1.5)


def test_a_window_that_no_pole_went_through_is_named() -> None:
    """0.05 s takes more damping out than light modes have; 10 s does not."""
    response = modal_response(FREQ_HZ, NATURAL, ZETA, np.ones((1, 5)), noise=0.01)
    assert "modal/damping" in {note.code for note in estimate_modes(response, exponential_s=0.05).notes}
    assert "modal/damping" not in {note.code for note in estimate_modes(response, exponential_s=10.0).notes}
