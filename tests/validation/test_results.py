"""Resonances are found between the lines, where the closed form has them, and not in noise."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from plants.two_mass import FREQ_HZ, circular, two_mass

from elastid.validation.agreement import paired_resonances, resonances


@given(
    stiffness=st.floats(60, 140),
    damping=st.floats(1e-5, 4e-3),
    first_hz=st.floats(10, 12),
    step_hz=st.sampled_from([0.5, 1.0, 2.0]),
)
@settings(deadline=None, max_examples=40)
def test_the_resonances_of_two_masses_are_found_between_the_lines(stiffness, damping, first_hz, step_hz):
    """Within a fifth of the lines' spacing of the closed form, also where the half-power width is far below it."""
    f = np.arange(first_hz, 250, step_hz)
    G, resonance, antiresonance = two_mass(f, stiffness, damping)
    np.testing.assert_allclose(resonances(f, G[:, 0, 0]), [resonance], atol=step_hz / 5)
    np.testing.assert_allclose(resonances(f, G[:, 0, 0], sign=-1), [antiresonance], atol=step_hz / 5)
    assert resonances(f, G[:, 1, 0], sign=-1).size == 0


def test_noise_makes_no_resonances():
    """Neither 20 % of noise on a flat response nor noise alone has a peak or a dip, in 100 draws each."""
    rng = np.random.default_rng(3)
    for level in (1.0, 0.0):
        for _ in range(100):
            G = level + 0.2 * circular(rng, 240)
            std = np.full(240, 0.2)
            assert resonances(FREQ_HZ, G, std).size == resonances(FREQ_HZ, G, std, sign=-1).size == 0


def test_peaks_are_matched_with_their_mutual_nearest_only():
    """A modelled peak serves one measured peak; one more than a quarter away is no partner."""
    partner = paired_resonances(np.array([10.0, 20.0, 21.0, 80.0]), np.array([10.1, 20.9, 40.0]))
    np.testing.assert_array_equal(partner, [10.1, np.nan, 20.9, np.nan])
    assert np.isnan(paired_resonances(np.array([5.0]), np.array([]))).all()


def test_the_resonance_of_a_single_mode_is_exact():
    """1/G is a quadratic in f: the minimum of its magnitude to the last digits, between two lines."""
    f = np.arange(10.0, 60.0)
    G = 1 / (1 - (f / 33.3) ** 2 + 0.1j * f / 33.3)
    # |1/G|^2 = (1 - x)^2 + 0.01 x with x = (f / 33.3)^2 is least at x = 1 - 0.005.
    assert resonances(f, G)[0] == pytest.approx(33.3 * np.sqrt(1 - 0.005), rel=1e-9)


def test_a_peak_above_the_noise_counts_though_its_base_is_below():
    """1/|G| of the base is noise, |G| of the peak is not."""
    f, rng = np.arange(10.0, 60.0, 0.5), np.random.default_rng(5)
    G = 0.05 / (1 - (f / 33.3) ** 2 + 0.02j * f / 33.3) + 0.1 * circular(rng, len(f))
    (found,) = resonances(f, G, np.full(len(f), 0.1))
    assert found == pytest.approx(33.3, rel=0.01)
