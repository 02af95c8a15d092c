"""Segments of records without a period, and how many of them are independent."""

import numpy as np
import pytest

from elastid.frf.segments import Segments


def test_independent_segments_without_overlap_are_all_and_with_it_those_of_welch() -> None:
    """Hann: 50 % overlap correlates neighbours by 1/6, so that their power by 1/36 (Welch, 1967); boxcar by 1/4."""
    hann = np.sin(np.pi * np.arange(256) / 256) ** 2
    assert Segments(hann, 256).independent(2560) == pytest.approx(10)
    assert Segments(hann, 128).independent(1280) == pytest.approx(9 / (1 + 2 * (8 / 9) / 36), rel=1e-6)
    assert Segments(np.ones(256), 128).independent(1280) == pytest.approx(9 / (1 + 2 * (8 / 9) / 4), rel=1e-9)
    assert Segments(hann, 128).count(255) == 0
