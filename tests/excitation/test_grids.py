"""Grids excite the lines that they name, and no others."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from plants.refusals import refused

from elastid.excitation.grids import grid_lines, line_frequencies, with_detection, zippered_grid
from elastid.excitation.spec import MultisineSpec, planned_lines


def test_full_grid_has_all_lines_of_band_with_edges() -> None:
    """1 to 40 Hz in a period of 10 s at 2 kHz: lines 10 to 400, though 0.1 Hz is no binary number."""
    lines = grid_lines("full", (1.0, 40.0), 2000.0, 20000)
    assert lines.tolist() == list(range(10, 401))
    np.testing.assert_allclose(line_frequencies(lines, 2000.0, 20000)[[0, -1]], [1.0, 40.0])


@given(first=st.integers(1, 60), width=st.integers(2, 60), n=st.integers(250, 400))
@settings(deadline=None, max_examples=40)
def test_odd_grid_is_odd_wherever_the_band_begins(first: int, width: int, n: int) -> None:
    """Odd lines only, all of those in the band, also where the band begins on an even line."""
    lines = grid_lines("odd", (first / n, (first + width) / n), 1.0, n)
    assert lines.tolist() == [k for k in range(first, first + width + 1) if k % 2]


def test_odd_odd_grid_leaves_lines_for_odd_distortion() -> None:
    """1, 5, 9 ...: the sum of three such lines is 3 (mod 4), where none is excited."""
    lines = grid_lines("odd-odd", (2.0, 20.0), 100.0, 100)
    assert lines.tolist() == [5, 9, 13, 17]
    assert {(a + b + c) % 4 for a in lines for b in lines for c in lines} == {3}


@given(group=st.integers(3, 5), n=st.integers(3, 80), seed=st.integers(0, 1000))
@settings(deadline=None, max_examples=40)
def test_of_every_group_of_lines_one_is_left_for_detection(group: int, n: int, seed: int) -> None:
    """Excited and detection lines together are the grid; each whole group has exactly one detection line."""
    odd = np.arange(n) * 2 + 7
    lines = with_detection(odd, group, np.random.default_rng(seed))
    assert sorted([*lines.excited, *lines.detection]) == odd.tolist()
    groups = [odd[i : i + group] for i in range(0, n - group + 1, group)]
    assert [np.isin(one, lines.detection).sum() for one in groups] == [1] * len(groups)


def test_planned_lines_follow_grid_and_seed():
    """Any line of a group may be the one for detection; phases without chance have one realisation."""
    spec = MultisineSpec(100.0, 1.0, (2.0, 40.0), 1.0)
    odd, own = planned_lines(spec, 0), planned_lines(replace(spec, grid="lines", lines=(3, 8)), 0)
    assert (odd.excited.tolist(), odd.detection.tolist()) == (list(range(3, 41, 2)), [])
    assert (own.excited.tolist(), own.detection.tolist()) == ([3, 8], [])
    drawn = [planned_lines(replace(spec, grid="odd-random"), seed).detection for seed in (0, 0, *range(1, 20))]
    np.testing.assert_array_equal(drawn[0], drawn[1])
    assert {first for first, *_ in drawn} == {3, 5, 7, 9}
    swept = replace(spec, phases="schroeder")
    assert [bool(each.realisation_refusal(n)) for each in (spec, swept) for n in (1, 2)] == [False, False, False, True]


@pytest.mark.parametrize("lines", [(1, 3), (3, 41), (3, 8, 3)])
def test_band_without_lines_is_refused_with_its_lines(lines):
    spec = MultisineSpec(100.0, 1.0, (2.0, 40.0), 1.0, grid="lines", lines=lines)
    with refused("excitation/lines", place="excitation.lines", holds="allow lines 2 to 40, each once"):
        planned_lines(spec, 0)


@given(ratio=st.floats(1.02, 1.6), last=st.integers(50, 900), odd=st.booleans())
@settings(deadline=None, max_examples=40)
def test_quasi_logarithmic_lines_keep_their_ratio_where_lines_are_dense(ratio: float, last: int, odd: bool) -> None:
    """Strictly rising, odd where asked for, and within half a grid step of the ratio or else the next line."""
    step = 2 if odd else 1
    lines = grid_lines("odd-quasi-log" if odd else "quasi-log", (1.0, last), 2000.0, 2000, ratio)
    gaps = np.diff(lines)
    assert np.all(gaps >= step)
    assert np.all(lines % step == 1 % step)
    assert np.all((np.abs(lines[1:] - ratio * lines[:-1]) <= step / 2 + 1e-9) | (gaps == step))
    assert lines[-1] * ratio > last - step


def test_zippered_grid_interleaves_lines_of_inputs() -> None:
    """Seven lines for three inputs; fewer lines than inputs are refused."""
    assert zippered_grid(7, 3).tolist() == [0, 1, 2, 0, 1, 2, 0]
    with refused("excitation/lines", place="excitation.orthogonal"):
        zippered_grid(2, 3)
