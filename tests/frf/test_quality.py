"""Covariance forms, nonlinear levels, coherence and words on inputs: against theory and Monte Carlo."""

from __future__ import annotations

import tracemalloc
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from plants.notes import said

from elastid.app.stages.estimate import estimate_configuration
from elastid.excitation.multisine import orthogonal_set, synthesise
from elastid.frf.checks.quality import coherences
from elastid.frf.covariance import distortion_covariance, positive
from elastid.frf.distortion import detection_lines, interpolated
from elastid.frf.estimate import estimate
from elastid.frf.spec import EstimatorSpec
from elastid.record import Configuration, Record
from elastid.report.figures.response_quality import coherence, levels
from elastid.response import Covariance
from elastid.store import read_configurations, write_records

RATE, N = 1000.0, 1024
ALL_PERIODS = EstimatorSpec(transient_periods=0, outlier_sigma=1e9)
ODD = np.arange(21, 301, 2)


def record_of(u: np.ndarray, y: np.ndarray, m: int = 0, e: int = 0, r: np.ndarray | None = None) -> Record:
    """Signals (n, c) with periods of N samples."""
    inputs = tuple(f"motor {i + 1}" for i in range(u.shape[1]))
    outputs = tuple(f"joint {i + 1}" for i in range(y.shape[1]))
    quantities = ("acceleration",) * len(outputs)
    return Record(f"c-r{m}-e{e}", Configuration("c", [0.0]), m, e, RATE, N, inputs, outputs, quantities, u, y, r)


def nonlinear(
    function: Callable[[np.ndarray], np.ndarray], lines: np.ndarray, M: int, noise: float = 0.0, seed: int = 0
) -> list[Record]:
    """One input of RMS 1 through a static function, M realisations of two periods."""
    rng = np.random.default_rng(seed)
    records = []
    for m in range(M):
        R = orthogonal_set(np.full((len(lines), 1), np.sqrt(2 / len(lines))), rng)[0]
        u = np.tile(synthesise(lines, R, N), (2, 1))
        records.append(record_of(u, function(u) + noise * rng.normal(size=u.shape), m))
    return records


def rms(levels: np.ndarray) -> float:
    return float(np.sqrt(np.mean(levels**2)))


def test_a_square_falls_on_even_lines_and_nowhere_else() -> None:
    """y = u + 0.1 u^2, odd lines: the even level is that of its spectrum, exactly; G is 1 and has no distortion."""
    records = nonlinear(lambda u: u + 0.1 * u**2, ODD, 2)
    response = estimate(records, ALL_PERIODS, ODD)
    quality = response.quality
    assert quality is not None
    assert quality.odd is None
    assert quality.even is not None
    np.testing.assert_allclose(quality.even.freq_hz, np.arange(22, 300, 2) * RATE / N)
    spectra = [np.fft.rfft(0.1 * r.u[:N, 0] ** 2)[22:300:2] * 2 / N for r in records]
    np.testing.assert_allclose(quality.even.amplitude[:, 0], np.sqrt(np.mean(np.abs(spectra) ** 2, axis=0)), rtol=1e-9)
    np.testing.assert_allclose(response.G, 1, atol=1e-12)
    assert quality.stochastic is not None
    assert quality.stochastic.max() < 1e-12


def test_a_cube_falls_on_odd_lines_that_were_left_out() -> None:
    """y = u + 0.05 u^3 on an odd-random grid: nothing even; the odd level is that of the excited lines' scatter."""
    rng = np.random.default_rng(3)
    lines = np.delete(ODD, [4 * i + rng.integers(4) for i in range(1, len(ODD) // 4 - 1)])
    response = estimate(nonlinear(lambda u: u + 0.05 * u**3, lines, 30), ALL_PERIODS, lines)
    quality = response.quality
    assert quality is not None
    assert quality.even is not None
    assert quality.odd is not None
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
    assert response.quality is not None
    assert response.quality.even is not None
    np.testing.assert_allclose(response.quality.even.amplitude, 0.01, rtol=1e-9)


def test_one_realisation_of_an_odd_random_grid_shows_its_total_variance() -> None:
    """The fast method: the predicted variance of one realisation is the scatter of many, within 15 %."""
    rng = np.random.default_rng(3)
    lines = np.delete(ODD, [4 * i + rng.integers(4) for i in range(1, len(ODD) // 4 - 1)])
    records = nonlinear(lambda u: u + 0.05 * u**3, lines, 30, noise=0.02)
    single = [estimate([replace(record, realisation=0)], ALL_PERIODS, lines) for record in records]
    G = np.array([each.G for each in single])
    scatter = np.sum(np.abs(G - G.mean(axis=0)) ** 2, axis=0) / 29
    totals = [each.total for each in single]
    assert all(total is not None for total in totals)
    predicted = np.mean([total.variance for total in totals if total is not None], axis=0)
    assert np.mean(predicted) == pytest.approx(np.mean(scatter), rel=0.15)
    noise = np.mean([each.noise.variance for each in single if each.noise is not None])
    assert noise < 0.5 * np.mean(scatter)


def test_detection_lines_are_those_between_odd_lines() -> None:
    """None where even lines were excited, or in half-wave records."""
    assert detection_lines(np.array([3, 5, 9]), False).tolist() == [4, 6, 7, 8]
    assert detection_lines(np.array([3, 4, 9]), False).size == 0
    assert detection_lines(np.array([3, 5, 9]), True).size == 0
    G = np.array([1.0, 3.0, 5.0])[:, None, None] + 0j
    np.testing.assert_allclose(interpolated(np.array([4, 7]), np.array([3, 5, 9]), G)[:, 0, 0], [2, 4])


def _matrix_records(rng: np.random.Generator, M: int, n: int, P: int, s: float, F: int = 60) -> tuple[list, np.ndarray]:
    """M realisations of n experiments of the same random plant, correlated noise on inputs and outputs; and G."""
    lines, plant = np.arange(10, 10 + F), np.random.default_rng(n)
    G = np.repeat(plant.normal(size=(1, n, n)) + 1j * plant.normal(size=(1, n, n)), F, axis=0)
    records = []
    for m in range(M):
        for e, U in enumerate(orthogonal_set(np.ones((F, n)), rng)):
            u, y = (np.tile(synthesise(lines, X, N), (P, 1)) for X in (U, np.einsum("fyu,fu->fy", G, U)))
            u, y = (x + s * rng.normal(size=x.shape) @ (np.eye(n) + 0.4 * np.tri(n)) for x in (u, y))
            records.append(record_of(u, y, m, e))
    return records, G


def test_six_by_six_variances_are_true_in_monte_carlo() -> None:
    """Noise on all inputs and outputs: each of the 36 variances within 8 %, their mean within 1.5 %.

    scripts/studies/estimator_errors.py has the long run, with every variance within 1 %.
    """
    rng = np.random.default_rng(1)
    error, noise, total = [], [], []
    for _ in range(8):
        records, G = _matrix_records(rng, 3, 6, 2, 0.3, F=400)
        response = estimate(records, ALL_PERIODS, np.arange(10, 410))
        error.append(np.mean(np.abs(response.G - G) ** 2, axis=0))
        assert response.noise is not None
        noise.append(response.noise.variance.mean(axis=0))
        assert response.total is not None
        total.append(response.total.variance.mean(axis=0))
    for found in (noise, total):
        ratio = np.mean(found, axis=0) / np.mean(error, axis=0)
        assert ratio.mean() == pytest.approx(1, abs=0.015)
        np.testing.assert_allclose(ratio, 1, atol=0.08)


def test_the_form_of_a_covariance_follows_from_its_degrees_of_freedom() -> None:
    """2 x 2: the full matrix from 9 realisations on, a Kronecker product below, variances alone where one is left."""
    rng = np.random.default_rng(0)
    records, _ = _matrix_records(rng, 9, 2, 2, 0.1)
    lines = np.arange(10, 70)

    def forms(M: int) -> tuple[str, float]:
        response = estimate([r for r in records if r.realisation < M], ALL_PERIODS, lines)
        assert response.total is not None
        eigenvalues = np.linalg.eigvalsh(response.total.full())
        assert np.all(eigenvalues[:, 0] > 1e-9 * eigenvalues[:, -1])
        return response.total.form, response.total.dof

    assert forms(9) == ("full", 8)
    assert forms(8) == ("kronecker", 14)
    assert forms(2) == ("kronecker", 2)
    full = estimate(records, ALL_PERIODS, lines)
    assert any("full covariance of its 4 elements, from 8 complex degrees" in note for note in said(full.notes))


def test_full_and_kronecker_covariance_agree_where_both_are_right() -> None:
    """Many realisations of one noise: their means over lines, element by element within 10 % of the diagonal."""
    rng = np.random.default_rng(2)
    records, _ = _matrix_records(rng, 24, 2, 2, 0.2, F=150)
    response = estimate(records, ALL_PERIODS, np.arange(10, 160))
    assert response.total is not None
    assert response.noise is not None
    assert (response.total.form, response.noise.form) == ("full", "kronecker")
    a, b = response.total.full().mean(axis=0), response.noise.full().mean(axis=0)
    scale = np.sqrt(np.outer(np.diag(b).real, np.diag(b).real))
    assert np.max(np.abs(a - b) / scale) < 0.1
    np.testing.assert_allclose(
        np.einsum("fii->fi", response.total.full()).real.reshape(-1, 2, 2).transpose(0, 2, 1), response.total.variance
    )


def test_distortion_is_total_less_noise_and_never_negative() -> None:
    """Where noise explains everything, what is left is positive semidefinite and small."""
    rng = np.random.default_rng(0)
    left = np.eye(2)[None] * np.ones((5, 1, 1)) + 0j
    noise = Covariance(np.ones((5, 3, 2)), 50, left, np.eye(3) * np.ones((5, 1, 1)) + 0j)
    extra = rng.normal(size=(5, 3, 1)) + 1j * rng.normal(size=(5, 3, 1))
    right = noise.right + extra @ extra.conj().swapaxes(1, 2)
    total = Covariance(np.einsum("fii->fi", right).real[:, :, None] * np.ones((5, 3, 2)), 20, left, right)
    found = distortion_covariance(noise, total, 4)
    assert found.right is not None
    np.testing.assert_allclose(found.full(), 4 * (total.full() - noise.full()), atol=1e-12)
    less = distortion_covariance(total, noise, 4)
    assert np.linalg.eigvalsh(less.full()).min() > -1e-12
    assert np.all(less.variance < 1e-12)
    A = rng.normal(size=(4, 5, 5))
    A = A + A.swapaxes(1, 2)
    assert np.linalg.eigvalsh(positive(A + 0j)).min() > -1e-12


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


def test_an_input_that_was_hardly_excited_is_named() -> None:
    """Motor 2 ten times weaker than the other and 15 dB above its noise; also inputs that move nearly together."""
    rng, lines = np.random.default_rng(0), np.arange(10, 200)
    records = []
    for e, U in enumerate(orthogonal_set(np.array([1.0, 0.1]) * np.ones((190, 2)), rng)):
        u, y = (np.tile(synthesise(lines, X, N), (8, 1)) for X in (U, U))
        s = 0.1 * np.sqrt(N * 8 / 4) * 10 ** (-15 / 20)
        records.append(record_of(u + s * rng.normal(size=u.shape), y, 0, e))
    notes = said(estimate(records, ALL_PERIODS, lines).notes)
    weak = [note for note in notes if "barely excited" in note]
    assert len(weak) == 1
    assert "input motor 2 was barely excited: less than 20 dB above its noise" in weak[0]
    together = []
    for e in range(2):
        U = np.ones((190, 2)) * np.exp(2j * np.pi * rng.random((190, 1))) * [1, 1 if e else 1.1]
        u = np.tile(synthesise(lines, U, N), (2, 1))
        together.append(record_of(u, u, 0, e))
    notes = said(estimate(together, ALL_PERIODS, lines).notes)
    assert any("the inputs move nearly together" in note for note in notes)


def test_lines_of_a_response_take_their_quality_with_them() -> None:
    """Every array is cut alike; the even levels stay as they are."""
    response = estimate(nonlinear(lambda u: u + 0.1 * u**2, ODD, 2), ALL_PERIODS, ODD)
    keep = np.arange(len(ODD)) % 3 == 0
    cut = response.lines(keep)
    assert cut.quality is not None
    assert response.quality is not None
    assert len(cut.quality.coherence) == len(cut.quality.excited.amplitude) == keep.sum()
    assert cut.quality.even == response.quality.even
    assert cut.distortion is not None
    assert len(cut.distortion.variance) == keep.sum()


@pytest.mark.parametrize("n", [1, 4])
def test_the_figures_show_every_level_and_every_output(n: int) -> None:
    """Levels in dB: excited, noise, stochastic and even; what no input explains of each output."""
    rng = np.random.default_rng(0)
    records = []
    for m in range(2):
        for e, U in enumerate(orthogonal_set(np.full((len(ODD), n), 0.1), rng)):
            u = np.tile(synthesise(ODD, U, N), (2, 1))
            records.append(record_of(u, u + u**2 + 1e-3 * rng.normal(size=u.shape), m, e))
    response = estimate(records, ALL_PERIODS, ODD)
    quality = response.quality
    assert quality is not None
    assert quality.even is not None
    figure = levels(response, quality, "title")
    lines = {line.get_label(): line for line in figure.axes[n - 1].get_lines()}
    assert set(lines) == {"excited lines", "noise", "stochastic nonlinear", "nonlinear, even"}
    even = quality.even.amplitude[:, n - 1] ** 2 - quality.even.noise[:, n - 1] ** 2
    np.testing.assert_allclose(lines["nonlinear, even"].get_ydata(), 10 * np.log10(np.where(even > 0, even, np.nan)))
    lost, gains, inputs = coherence(response, quality, "title").axes
    assert (len(lost.get_lines()), len(gains.get_lines()), len(inputs.get_lines())) == (n, n, n)


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
            estimate_configuration(path, name, ALL_PERIODS, lines)
        most = tracemalloc.get_traced_memory()[1]
        tracemalloc.stop()
        return most

    peak(1)
    assert peak(6) < 1.1 * peak(2)
