"""Windows of bins about the lines of a local method."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from elastid.frf.local.least_squares import windows


@given(count=st.integers(3, 60), n_w=st.integers(1, 40), line=st.integers(0, 200), seed=st.integers(0, 10**6))
@settings(deadline=None, max_examples=50)
def test_a_window_is_of_neighbours_and_holds_its_line_in_the_middle_or_at_an_end_of_the_band(
    count: int, n_w: int, line: int, seed: int
) -> None:
    """On any grid: contiguous, n_w of them, offsets within [-1, 1]; off centre only against an end."""
    available = np.sort(np.random.default_rng(seed).permutation(200)[:count])
    window = windows(available, np.array([line]), n_w)
    index = window.index[0]
    assert len(index) == min(n_w, count)
    assert np.all(np.diff(index) == 1)
    assert np.abs(window.offset).max() <= 1
    below, above = np.sum(available[index] < line), np.sum(available[index] > line)
    if index[0] > 0 and index[-1] < count - 1:
        assert abs(below - above) <= 1
