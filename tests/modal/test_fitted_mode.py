"""Numbers of a mode within their standard deviations, and notes on poles that are none."""

from dataclasses import replace

import numpy as np
import pytest
from modal.structures import FREQ_HZ, NATURAL, ZETA, modal_response
from plants.marks import slow
from plants.notes import noted
from scipy.ndimage import convolve1d

from elastid.modal.estimate import estimate_modes
from elastid.modal.fitted_mode import FittedMode, without_twins
from elastid.response import Covariance


@pytest.mark.parametrize("kind", [slow("white"), slow("not stated"), slow("correlated"), "of few degrees of freedom"])
def test_the_intervals_of_a_draw_are_its_errors(kind: str) -> None:
    """Mean square of error over std of frequency, damping and shape, 16 draws of five modes: 0.6 to 1.5."""
    shapes = np.outer([1.0, 0.5], np.ones(5))
    errors, exact = [], modal_response(FREQ_HZ, NATURAL, ZETA, shapes)
    for seed in range(16):
        response = modal_response(FREQ_HZ, NATURAL, ZETA, shapes, noise=0.01, seed=seed)
        if kind == "not stated":
            response = replace(response, noise=None)
        elif kind == "correlated":
            mixed = convolve1d(response.G - exact.G, np.ones(3) / np.sqrt(3), axis=0)
            response = replace(response, G=exact.G + mixed, correlated_lines=3.0)
        elif kind != "white":
            drawn = response.noise.variance * np.random.default_rng(seed).chisquare(12, response.G.shape) / 12
            response = replace(response, noise=Covariance(drawn, 6.0))
        modes = estimate_modes(response, None, 16)
        shape = np.abs(modes.shapes[1] - 0.5) / modes.shape_std[1]
        errors.append([(modes.freq_hz - NATURAL) / modes.freq_std, (modes.zeta - ZETA) / modes.zeta_std, shape])
    np.testing.assert_allclose(modes.poles.imag, 2 * np.pi * NATURAL * np.sqrt(1 - ZETA**2), rtol=1e-3)
    np.testing.assert_allclose(np.diff(modes.freq95)[:, 0], 2 * 1.96 * modes.freq_std, rtol=1e-4)
    squares = np.mean(np.square(errors), axis=(0, 2))
    assert np.all(squares > 0.6)
    assert np.all(squares < 1.5)


def test_a_window_that_no_pole_went_through_is_named() -> None:
    """0.05 s takes more damping out than light modes have; 10 s does not, nor 1.326 s, all that one of them has."""
    response = modal_response(FREQ_HZ, NATURAL, ZETA, np.ones((1, 5)), noise=0.01)
    assert "modal/damping" in {note.code for note in estimate_modes(response, exponential_s=0.05).notes}
    for all_of_one in (10.0, 1 / (2 * np.pi * NATURAL[0] * ZETA[0])):
        assert "modal/damping" not in {note.code for note in estimate_modes(response, exponential_s=all_of_one).notes}


def test_short_periods_for_damping_are_named():
    """The half-power width of 50 Hz with a damping of 0.001 is 0.1 Hz: one line of 10 s, four of the 40 s asked for."""
    natural, zeta = np.array([30.0, 50.0]), np.array([0.01, 0.001])
    for period_s, is_short in ((10.0, True), (40.0, False)):
        freq_hz = np.arange(20 * period_s, 60 * period_s) / period_s
        notes = estimate_modes(modal_response(freq_hz, natural, zeta, np.ones((1, 2)), noise=0.003)).notes
        told = [noted(note) for note in notes]
        assert told == [("modal/damping", "bench", pytest.approx([1, 2, 50, 40], rel=0.02))] * is_short


def test_weak_pole_within_resonance_is_no_mode() -> None:
    """Of another shape, farther off or stronger it is a mode."""
    strong = FittedMode(50.0, 0.01, 0.01, 1e-4, np.array([[1.0, 2.0j, -1.0]]), np.full((1, 3), 1e-3))
    log_comparison = replace(strong, freq_hz=50.1, residue=0.01j * strong.residue)
    other = replace(log_comparison, residue=np.array([[0.02, 0.01j, 0.0]]))
    alike = replace(log_comparison, residue=0.01 * np.array([[1.0, 2.0j, -0.3]]))
    for mode in (log_comparison, alike):
        assert without_twins([strong, mode]) == [strong]
    for mode in (other, replace(log_comparison, freq_hz=60.0), replace(log_comparison, residue=0.9 * strong.residue)):
        assert without_twins([strong, mode]) == [strong, mode]


@pytest.mark.parametrize("unit", [1e-4, 1.0, 1e4])
def test_broad_weak_or_unknown_pole_is_background(unit: float) -> None:
    """By its peak R / (2 pi zeta f) over a flat response of size 1, in any unit; a light one is a mode all the same."""
    response = modal_response(FREQ_HZ, NATURAL, ZETA, np.ones((2, 5)))
    flat = replace(response, G=np.full(response.G.shape, unit / np.sqrt(2)))
    residue = 2 * np.pi * 0.05 * 41 * unit * np.array([[0.6], [0.8j]])
    broad = FittedMode(41.0, 0.01, 0.05, 1e-3, residue, 0.1 * np.abs(residue))
    assert not broad.is_background(flat)
    assert not replace(broad, residue=0.12 * residue, residue_std=0.01 * np.abs(residue)).is_background(flat)
    for fault in ({"residue": 0.08 * residue, "residue_std": 0 * broad.residue_std}, {"residue_std": np.abs(residue)}):
        assert replace(broad, **fault).is_background(flat)
        assert not replace(broad, zeta=0.02, **fault).is_background(flat)
