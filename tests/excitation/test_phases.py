"""Phases and orthogonal sets."""

from __future__ import annotations

import numpy as np
import pytest

from elastid.base.errors import StudyError
from elastid.excitation.phases import hadamard, orthogonal_basis, random_phases, with_phases


@pytest.mark.parametrize("n", [1, 2, 4, 8, 12, 16, 20, 24])
def test_hadamard_matrices_are_signs_and_orthogonal(n: int) -> None:
    """H^T H = n I, entries +-1."""
    H = hadamard(n)
    np.testing.assert_array_equal(np.abs(H), 1)
    np.testing.assert_array_equal(H.T @ H, n * np.eye(n))


@pytest.mark.parametrize("n", [3, 6, 10, 28])
def test_without_a_hadamard_matrix_the_dft_is_offered(n: int) -> None:
    """The message says for which numbers there is one, and what to take instead."""
    with pytest.raises(StudyError, match=rf"no Hadamard matrix for {n} inputs is known here .* take orthogonal: dft"):
        hadamard(n)


def test_a_zippered_experiment_excites_one_input_at_each_line() -> None:
    """Every input in turn, over the experiments of a set."""
    W = orthogonal_basis("zippered", 10, 3)
    assert np.all((W != 0).sum(axis=2) == 1)
    assert np.all((W != 0).sum(axis=0) == 1)


def test_the_experiments_of_a_set_share_amplitudes_but_not_phases() -> None:
    """U = A e^ja W e^jb."""
    rng = np.random.default_rng(0)
    amplitude = rng.uniform(1, 2, (12, 3))
    U = with_phases(orthogonal_basis("dft", 12, 3), amplitude, *random_phases((2, 12, 3), rng))
    np.testing.assert_allclose(np.abs(U), np.repeat(amplitude[None], 3, axis=0))
