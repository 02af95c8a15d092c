"""Coherence, singular values and notes on inputs: against theory; the figures and the memory of an estimate."""

from __future__ import annotations

import tracemalloc
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from plants.random_plants import ALL_PERIODS, N, record_of, two_modes

from elastid.app.stages.estimate import estimate_configuration
from elastid.excitation.multisine import orthogonal_set, synthesise
from elastid.frf.estimate import estimate
from elastid.frf.quality import coherences, local_modes, wide_windows
from elastid.record import Configuration, Record
from elastid.store.measured import read_configurations, write_records


def test_coherence_is_that_of_theory() -> None:
    """One input: 1 / (1 + noise / signal); two independent ones: half each, and all of it together."""
    rng, lines, s = np.random.default_rng(0), np.arange(10, 400), 0.3
    records = []
    for m in range(12):
        U = orthogonal_set(np.ones((len(lines), 1)), rng)[0]
        u = np.tile(synthesise(lines, U, N), (6, 1))
        records.append(record_of(u, u + s * rng.normal(size=u.shape) * np.sqrt(N) / 2, m))
    quality = estimate(records, ALL_PERIODS, lines).quality
    assert quality is not None
    expected = 1 / (1 + s**2)
    assert quality.coherence.mean() == pytest.approx(expected, abs=0.005)
    np.testing.assert_allclose(quality.multiple_coherence, quality.coherence[:, :, 0], rtol=1e-9)
    ordinary, multiple = coherences(np.array([[2.0]]), np.ones((1, 1, 2)) + 0j, np.eye(2)[None] + 0j)
    np.testing.assert_allclose(ordinary, [[[0.5, 0.5]]])
    np.testing.assert_allclose(multiple, 1)


def test_singular_values_and_condition_are_those_of_the_matrices() -> None:
    """Orthogonal experiments have condition 1 whatever the inputs' sizes; G's singular values are NumPy's."""
    rng = np.random.default_rng(0)
    lines, G = np.arange(10, 50), rng.normal(size=(3, 2)) + 0j
    records = []
    for e, U in enumerate(orthogonal_set(np.array([1.0, 100.0]) * np.ones((40, 2)), rng)):
        u, y = (np.tile(synthesise(lines, X, N), (2, 1)) for X in (U, U @ G.T))
        records.append(record_of(u, y, 0, e))
    quality = estimate(records, ALL_PERIODS, lines).quality
    assert quality is not None
    np.testing.assert_allclose(quality.condition, 1, rtol=1e-9)
    np.testing.assert_allclose(quality.singular_values[7], np.linalg.svd(G, compute_uv=False), rtol=1e-9)


def test_memory_does_not_grow_with_the_number_of_configurations(tmp_path: Path) -> None:
    """Two and six configurations of 1.5 MB of records each: the peak is that of one."""
    rng, lines = np.random.default_rng(0), np.arange(21, 61, 2)

    def peak(Q: int) -> int:
        def records() -> Iterator[Record]:
            for q in range(Q):
                for m in range(4):
                    u = np.tile(synthesise(lines, np.exp(2j * np.pi * rng.random((20, 1))), N), (24, 1))
                    configuration = Configuration(f"q{q}", [0.0])
                    yield replace(record_of(u, u, m), name=f"q{q}-{m}", configuration=configuration)

        path = tmp_path / f"{Q}.h5"
        write_records(path, records())
        tracemalloc.start()
        for name in read_configurations(path):
            estimate_configuration(path, ALL_PERIODS, lines, None, None, name)
        most = tracemalloc.get_traced_memory()[1]
        tracemalloc.stop()
        return most

    peak(1)
    assert peak(6) < 1.1 * peak(2)


FREQ = np.arange(10.0, 131.0)


def test_modes_are_found_with_their_bandwidth() -> None:
    """2 zeta f_0 of two modes to 3 %, on a fine grid."""
    freq_hz = np.linspace(20, 120, 4001)
    G = two_modes(freq_hz, np.eye(2))
    f_0, width = local_modes(freq_hz, G, np.zeros(G.shape))
    np.testing.assert_allclose(f_0, [45, 80], rtol=5e-3)
    np.testing.assert_allclose(width, 2 * 0.02 * f_0, rtol=0.03)
    assert len(local_modes(freq_hz, G, np.full(G.shape, np.abs(G).max() ** 2 / 100))[0]) == 0


def test_a_window_wider_than_the_modal_bandwidth_gets_a_word() -> None:
    """With the numbers; a polynomial where one mode is narrower, a rational function where it holds too many modes."""
    G = two_modes(FREQ, np.eye(2), zeta=0.05)
    found = local_modes(FREQ, G, np.zeros(G.shape))
    span = np.full(len(FREQ), 9.0)
    (word,) = wide_windows(found, FREQ, span, poles=0)
    assert "2 of 2 modes: 9 Hz at 45 Hz, where a mode is 4." in word.text
    assert wide_windows(found, FREQ, span / 3, poles=0) == []
    assert wide_windows(found, FREQ, span, poles=2) == []
    assert len(wide_windows(found, FREQ, 10 * span, poles=1)) == 1
