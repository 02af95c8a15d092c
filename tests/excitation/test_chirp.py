"""Sweeps keep to their band, binary signals have flat spectra."""

from __future__ import annotations

import numpy as np
import pytest

from elastid.excitation.chirp import sweep_spectrum
from elastid.excitation.crest import crest_factors


def test_a_linear_sweep_has_the_low_crest_factor_of_a_sweep_and_a_binary_signal_a_flat_spectrum() -> None:
    """Swept within the band; a pseudo-random binary signal, band-limited, has all its lines alike to a factor of 2."""
    lines = np.arange(10, 200)
    assert crest_factors(lines, sweep_spectrum("linear-sweep", lines)) < 1.9
    magnitude = np.abs(sweep_spectrum("prbs", lines))
    assert magnitude.max() / magnitude.min() < 2
    low, high = np.abs(sweep_spectrum("log-sweep", lines))[[20, 160]]
    assert low / high == pytest.approx(np.sqrt(lines[160] / lines[20]), rel=0.2)
