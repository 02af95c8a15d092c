"""Coherence, notes on inputs, nonlinear levels and forms of covariances: against theory and Monte Carlo."""

import tracemalloc
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from plants.random_plants import ALL_PERIODS, RATE, N, experiments_of, record_of, two_modes

from elastid.app.stages.estimate import estimate_configuration
from elastid.excitation.multisine import orthogonal_set, synthesise
from elastid.frf.estimate import estimate
from elastid.frf.quality import coherences, local_modes, wide_window_notes
from elastid.record import Configuration, Record
from elastid.store.measured import read_configurations, write_records

ODD = np.arange(21, 301, 2)


def nonlinear(
    function: Callable[[np.ndarray], np.ndarray], lines: np.ndarray, M: int, noise: float = 0.0
) -> list[Record]:
    """One input of RMS 1 through a static function, M realisations of two periods."""
    rng = np.random.default_rng(0)
    records = experiments_of(np.ones((len(lines), 1, 1)), lines, M, rng, scale=M * [np.sqrt(2 / len(lines))])
    return [replace(one, y=function(one.u) + noise * rng.normal(size=one.u.shape), r=None) for one in records]


def test_coherence_is_that_of_theory() -> None:
    """One input: 1 / (1 + noise / signal); two independent ones: half each, and all of it together."""
    rng, lines, s = np.random.default_rng(0), np.arange(10, 400), 0.3
    records = experiments_of(np.ones((len(lines), 1, 1)), lines, 12, rng, P=6, noise=(0.0, s * np.sqrt(N) / 2))
    quality = estimate(records, ALL_PERIODS, lines).quality
    expected = 1 / (1 + s**2)
    assert quality.coherence.mean() == pytest.approx(expected, abs=0.005)
    assert quality.output_noise.mean() == pytest.approx(s**2, rel=0.02)
    np.testing.assert_allclose(quality.multiple_coherence, quality.coherence[:, :, 0], rtol=1e-9)
    ordinary, multiple = coherences(np.array([[2.0]]), np.ones((1, 1, 2)) + 0j, np.eye(2)[None] + 0j)
    np.testing.assert_allclose(ordinary, [[[0.5, 0.5]]])
    np.testing.assert_allclose(multiple, 1)


def test_memory_does_not_grow_with_the_number_of_configurations(tmp_path: Path) -> None:
    """Two and six configurations of 1.5 MB of records each: the peak is that of one."""
    rng, lines = np.random.default_rng(0), np.arange(21, 61, 2)

    def peak(Q: int) -> int:
        def records() -> Iterator[Record]:
            for q in range(Q):
                for m in range(4):
                    u = np.tile(synthesise(lines, np.exp(6j * rng.random((20, 1))), N), (24, 1))
                    configuration = Configuration(f"q{q}", [0.0])
                    yield replace(record_of(u, u, m), name=f"q{q}-{m}", configuration=configuration)

        path = tmp_path / f"{Q}.h5"
        write_records(path, records())
        tracemalloc.start()
        for name in read_configurations(path):
            estimate_configuration(path, ALL_PERIODS, lines, None, None, (name, None))
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
    (word,) = wide_window_notes(found, FREQ, span, poles=0)
    assert "2 of 2 modes: 9 Hz at 45 Hz" in word.text
    assert wide_window_notes(found, FREQ, span / 3, poles=0) == []
    assert wide_window_notes(found, FREQ, span, poles=2) == []
    assert len(wide_window_notes(found, FREQ, 10 * span, poles=1)) == 1


def test_covariance_form_follows_degrees_of_freedom() -> None:
    """2 x 2: the full matrix from 9 realisations on, a Kronecker product below, variances alone where one is left."""
    rng, lines = np.random.default_rng(0), np.arange(10, 70)
    records = experiments_of(rng.normal(size=(60, 2, 2)), lines, 9, rng, noise=(0.1, 0.1))

    def forms(M: int) -> tuple[str, float]:
        response = estimate([r for r in records if r.realisation < M], ALL_PERIODS, lines)
        eigenvalues = np.linalg.eigvalsh(response.total.full())
        assert np.all(eigenvalues[:, 0] > 1e-9 * eigenvalues[:, -1])
        return response.total.form, response.total.dof

    assert forms(9) == ("full", 8)
    assert forms(8) == ("kronecker", 14)
    assert forms(2) == ("kronecker", 2)


def rms(levels: np.ndarray) -> float:
    return float(np.sqrt(np.mean(levels**2)))


def test_a_square_falls_on_even_lines_and_nowhere_else() -> None:
    """y = u + 0.1 u^2, odd lines: the even level is that of its spectrum, exactly; G is 1 and has no distortion."""
    records = nonlinear(lambda u: u + 0.1 * u**2, ODD, 2)
    response = estimate(records, ALL_PERIODS, ODD)
    quality = response.quality
    assert quality.odd is None
    np.testing.assert_allclose(quality.even.freq_hz, np.arange(22, 300, 2) * RATE / N)
    spectra = [np.fft.rfft(0.1 * r.u[:N, 0] ** 2)[22:300:2] * 2 / N for r in records]
    np.testing.assert_allclose(quality.even.amplitude[:, 0], np.sqrt(np.mean(np.abs(spectra) ** 2, axis=0)), rtol=1e-9)
    np.testing.assert_allclose(response.G, 1, atol=1e-12)
    assert quality.stochastic.max() < 1e-12


ODD_RANDOM = np.delete(ODD, 4 * np.arange(1, 34) + np.random.default_rng(3).integers(4, size=33))


def test_a_cube_falls_on_odd_lines_that_were_left_out() -> None:
    """y = u + 0.05 u^3 on an odd-random grid: nothing even; the odd level is that of the excited lines' scatter."""
    response = estimate(nonlinear(lambda u: u + 0.05 * u**3, ODD_RANDOM, 30), ALL_PERIODS, ODD_RANDOM)
    quality = response.quality
    assert quality.stochastic is not None
    assert quality.even.amplitude.max() < 1e-12
    assert rms(quality.odd.amplitude) == pytest.approx(rms(quality.stochastic), rel=0.1)
    # The best linear approximation of a cube is that of a Gaussian signal, 3 sigma^2, to 1 / F.
    assert response.G.mean() == pytest.approx(1 + 0.15, rel=0.01)


def test_levels_are_corrected_for_what_the_feedback_makes_of_them() -> None:
    """u = r - C y: y at an even line holds the loop's share of the distortion v, Y - G U is v itself."""
    rng, C = np.random.default_rng(0), 3.0
    R = orthogonal_set(np.full((len(ODD), 1), 0.1), rng)[0]
    r, v = synthesise(ODD, R, N), np.zeros((N, 1))
    v += synthesise(np.arange(22, 300, 2), np.full((139, 1), 0.01), N)
    y = (0.5 * r + v) / (1 + 0.5 * C)
    response = estimate([record_of(*(np.tile(x, (2, 1)) for x in (r - C * y, y)))], ALL_PERIODS, ODD)
    np.testing.assert_allclose(response.quality.even.amplitude, 0.01, rtol=1e-9)


def test_single_odd_random_realisation_has_total_variance() -> None:
    """The fast method: the predicted variance of one realisation is the scatter of many, within 15 %."""
    records = nonlinear(lambda u: u + 0.05 * u**3, ODD_RANDOM, 30, noise=0.02)
    single = [estimate([replace(record, realisation=0)], ALL_PERIODS, ODD_RANDOM) for record in records]
    G = np.array([each.G for each in single])
    scatter = np.sum(np.abs(G - G.mean(axis=0)) ** 2, axis=0) / 29
    totals = [each.total for each in single]
    assert all(total is not None for total in totals)
    predicted = np.mean([total.variance for total in totals if total is not None], axis=0)
    assert np.mean(predicted) == pytest.approx(np.mean(scatter), rel=0.15)
    noise = np.mean([each.noise.variance for each in single if each.noise is not None])
    assert noise < 0.5 * np.mean(scatter)
