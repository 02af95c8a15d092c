"""Forms of covariances and their values: against Monte Carlo and each other."""

from __future__ import annotations

import numpy as np
import pytest
from plants.random_plants import ALL_PERIODS, N, record_of
from plants.two_mass import circular

from elastid.excitation.multisine import orthogonal_set, synthesise
from elastid.frf.estimate import estimate
from elastid.frf.estimators import level_lines


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


def test_errors_with_one_level_at_all_lines_count_as_few() -> None:
    """Leakage of a torque that wanders: one amplitude at 60 lines; white errors have a level each.

    The sum of squares of 2000 draws has 1 / 60 and all of the degrees of freedom, whatever the phases of G.
    """
    rng = np.random.default_rng(0)
    G = circular(rng, (60, 1, 1))
    amplitude = circular(rng, (2000, 1, 1))
    leaked = amplitude * G[:, :, 0] / (1 - np.exp(-2j * np.pi * np.arange(5, 65) / 400))[:, None]
    white = circular(rng, (2000, 60, 1)) * G[:, :, 0]
    for V, lines in ((leaked, 60), (white, 1)):
        power = np.sum(np.abs(V / G[:, :, 0] / np.std(V / G[:, :, 0], axis=0)) ** 2, axis=(1, 2))
        assert 60 * np.var(power) / np.mean(power) ** 2 == pytest.approx(lines, rel=0.2)
        assert level_lines(V[:3], G) == pytest.approx(lines, rel=0.3)
