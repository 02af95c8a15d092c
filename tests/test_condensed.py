"""Leaves condensed before the rest is solved for: the same X as of the whole Z."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from elastid.linear.condensed import Leaves

OMEGA = 2 * np.pi * np.linspace(1, 60, 150)


def system(rng, hangs_on, n_rest, damping=1e-3):
    """Random links, with one motor behind a spring for each entry of hangs_on, in a random order of coordinates."""
    n = n_rest + len(hangs_on)
    M, K = np.zeros((n, n)), np.zeros((n, n))
    for matrix, size in ((M, 1.0), (K, 1e4)):
        A = rng.standard_normal((n_rest, n_rest))
        matrix[:n_rest, :n_rest] = size * (A @ A.T + np.eye(n_rest))
    for motor, link in enumerate(hangs_on, start=n_rest):
        k = 1e4 * rng.uniform(0.5, 2)
        K[np.ix_([motor, link], [motor, link])] += k * np.array([[1, -1], [-1, 1]])
        M[motor, motor] = rng.uniform(0.5, 2)
    order = rng.permutation(n)
    M, K = M[np.ix_(order, order)], K[np.ix_(order, order)]
    return M, damping * K, K


def whole(M, D, K, B):
    Z = K + 1j * OMEGA[:, None, None] * D - OMEGA[:, None, None] ** 2 * M
    return np.linalg.solve(Z, B.astype(complex))


@settings(max_examples=40, deadline=None)
@given(st.lists(st.integers(0, 3), max_size=6), st.integers(4, 6), st.integers(0, 99))
def test_the_solution_is_that_of_the_whole_matrix(hangs_on, n_rest, seed):
    """Any number of motors, several on one link too, and right sides that reach all coordinates."""
    rng = np.random.default_rng(seed)
    M, D, K = system(rng, hangs_on, n_rest)
    B = rng.standard_normal((len(M), 3))
    leaves = Leaves.of((M != 0) | (K != 0))
    expected = whole(M, D, K, B)
    scale = np.abs(expected).max(axis=(1, 2), keepdims=True)
    np.testing.assert_allclose(leaves.solve(M, D, K, OMEGA, B) / scale, expected / scale, atol=1e-11)
    assert len(leaves.leaf) >= len(set(hangs_on))
    assert len(set(leaves.on)) == len(leaves.on)
    assert not set(leaves.leaf) & set(leaves.other[leaves.on])


def test_two_masses_have_one_leaf():
    assert len(Leaves.of(np.ones((2, 2), bool)).leaf) == 1


@pytest.mark.parametrize("off", [0.0, 1e-14, 1e-9, 1e-4])
def test_a_line_on_the_resonance_of_an_undamped_motor_costs_no_digits(off):
    """The motor alone resonates at a line, the robot does not."""
    rng = np.random.default_rng(1)
    M, D, K = system(rng, [0, 1], 4, damping=0.0)
    leaves = Leaves.of((M != 0) | (K != 0))
    motor = leaves.leaf[0]
    M[motor, motor] = K[motor, motor] / OMEGA[70] ** 2 * (1 + off)
    B = np.eye(6)[:, :2]
    expected = whole(M, D, K, B)[70]
    found = leaves.solve(M, D, K, OMEGA, B)[70]
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-11 * np.abs(expected).max())
