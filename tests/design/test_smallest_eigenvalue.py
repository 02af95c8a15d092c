"""E-optimal design by a semidefinite program: its certificate, and its independence of units."""

from __future__ import annotations

import numpy as np
import pytest

from elastid.design import smallest_eigenvalue
from elastid.design.optimal import DesignCriterion, Over, relaxed_design
from elastid.design.smallest_eigenvalue import bounded_shares, pack, unpack
from tests.design.test_optimal import random_information


def test_packed_matrices_have_the_product_of_the_trace() -> None:
    """Tr(A B), and back."""
    A, B = random_information(7, Q=2)[0]
    assert pack(A) @ pack(B) == pytest.approx(np.trace(A @ B), rel=1e-12)
    np.testing.assert_allclose(unpack(pack(A)), A, rtol=1e-15)


@pytest.mark.parametrize("over", ["mean", "worst"])
def test_bound_is_reached_whatever_the_units_of_the_parameters(over: Over) -> None:
    """Parameters in units from 1e-4 to 1e4: shares and bound agree to a millionth of the logarithm."""
    H, scale = random_information(3, S=2), np.diag([1e-4, 1.0, 1e4, 10.0])
    K = np.eye(4)
    for D in (np.eye(4), scale):
        packed = pack(D @ H @ D)
        shares = bounded_shares(packed, D @ K, over == "worst", 1e-3)
        assert shares is not None
        weights, bound = shares
        assert bound - DesignCriterion("E", D @ K, over).value(unpack(weights @ packed)) == pytest.approx(0, abs=1e-5)


@pytest.mark.parametrize("wanted", [1, 4, 12])
def test_smallest_eigenvalue_of_the_published_study_is_certified_to_a_thousandth(wanted: int) -> None:
    """7920 candidates, all parameters or a few of interest; the value is that of the covariance matrix."""
    H, K = random_information(0, Q=7920, d=12, rank=12), np.eye(12)[:, :wanted]
    found = relaxed_design(H, DesignCriterion("E", K))
    assert found.gap <= 1e-3
    M = np.einsum("q,qij->ij", found.weights, H[0])
    assert found.value == pytest.approx(-np.log(np.linalg.eigvalsh(np.linalg.inv(M)[:wanted, :wanted])[-1]), abs=1e-9)


@pytest.mark.parametrize("over", ["mean", "worst"])
def test_smallest_eigenvalue_over_guesses_is_certified_to_a_thousandth(over: Over) -> None:
    """Three guesses, of which one is poor in two of the parameters."""
    H = random_information(2, S=3, Q=300, d=6)
    H[1, :, :2] *= 0.3
    H[1, :, :, :2] *= 0.3
    assert relaxed_design(H, DesignCriterion("E", np.eye(6), over)).gap <= 1e-3


def test_smallest_eigenvalue_of_a_program_too_large_is_softened(monkeypatch: pytest.MonkeyPatch) -> None:
    """The climb's bound holds too: it is never below the best value."""
    H, criterion = random_information(4), DesignCriterion("E", np.eye(4))
    best = relaxed_design(H, criterion, tolerance=1e-6)
    monkeypatch.setattr(smallest_eigenvalue, "MAX_UNKNOWNS", 1)
    climbed = relaxed_design(H, criterion)
    assert climbed.value <= best.bound
    assert climbed.bound >= best.value
    assert 1e-3 < climbed.gap < 0.08
