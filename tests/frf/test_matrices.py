"""Stacks of matrices in C: the numbers of NumPy to rounding, however the stacks lie in memory."""

import numpy as np
import pytest
from plants.three_mass import circular

from elastid.base.arrays import ComplexArray, FloatArray
from elastid.base.kernels import is_compiled
from elastid.frf import matrices
from elastid.frf.matrices import adjoint, transposed

# One line and incomplete batches, odd sizes, and many lines.
SHAPES = [(1, 1, 1), (7, 2, 3), (37, 5, 4), (16, 3, 6), (300, 6, 6), (600, 7, 7)]


def laid_out(A: ComplexArray, lines_are_last: bool) -> ComplexArray:
    """The same stack (F, n, m) with its lines side by side in memory, or its columns."""
    return np.moveaxis(np.moveaxis(A, 0, 2).copy(), 2, 0) if lines_are_last else A


@pytest.fixture(params=["numpy", "c"])
def way(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> None:
    """Both ways to the same numbers."""
    in_c = request.param == "c"
    if in_c and not is_compiled():
        pytest.skip("the kernels in C are not built")
    monkeypatch.setattr(matrices, "is_compiled", lambda: in_c)


def off(result: ComplexArray | FloatArray, expected: ComplexArray | FloatArray) -> float:
    """Largest error over the largest element of its line."""
    assert result.shape == expected.shape
    size = np.abs(expected).reshape(len(expected), -1).max(axis=1)
    error = np.abs(result - expected).reshape(len(expected), -1).max(axis=1)
    return float(np.max(error / np.maximum(size, 1e-300), initial=0.0))


@pytest.mark.usefixtures("way")
@pytest.mark.parametrize("lines_are_last", [True, False])
@pytest.mark.parametrize(("F", "n", "m"), SHAPES)
def test_sums_of_products_are_the_formulas(F: int, n: int, m: int, lines_are_last: bool) -> None:
    """Over blocks with different numbers of columns, also of matrices that are transposed."""
    rng = np.random.default_rng(F)
    Y, U = ([laid_out(circular(rng, (F, rows, k)), lines_are_last) for k in (3, 7)] for rows in (n, m))
    G = laid_out(circular(rng, (F, n, m)), lines_are_last)
    D = [y - G @ u for y, u in zip(Y, U, strict=True)]
    pairs = list(zip(Y, U, strict=True))
    assert off(matrices.added_cross_products(Y, U), sum(y @ adjoint(u) for y, u in pairs)) < 1e-13
    assert off(matrices.added_cross_products(Y, Y), sum(y @ adjoint(y) for y in Y)) < 1e-13
    plain = matrices.added_products(Y, [transposed(u) for u in U])
    assert off(plain, sum(y @ transposed(u) for y, u in pairs)) < 1e-13
    assert off(matrices.added_error_products(Y, G, U), sum(d @ adjoint(d) for d in D)) < 1e-13


@pytest.mark.usefixtures("way")
@pytest.mark.parametrize("lines_are_last", [True, False])
@pytest.mark.parametrize(("F", "n", "m"), SHAPES)
def test_inverses_and_singular_values_are_those_of_lapack(F: int, n: int, m: int, lines_are_last: bool) -> None:
    """A zero where elimination would start asks for another pivot; columns may be many times larger than others."""
    rng = np.random.default_rng(F)
    A = laid_out(circular(rng, (F, n, n)), lines_are_last)
    A[:, 0, 0] = 0.0 if n > 1 else 2.0
    condition = np.linalg.cond(A)[:, None, None]
    assert off(matrices.inverse(A) / condition, np.linalg.inv(A) / condition) < 1e-13 * condition.max()
    assert off(matrices.inverse(A) @ A, np.broadcast_to(np.eye(n), A.shape)) < 1e-13 * condition.max()
    B = laid_out(circular(rng, (F, n, m)) * 10.0 ** np.arange(m), lines_are_last)
    assert off(matrices.singular_values(B), np.asarray(np.linalg.svd(B, compute_uv=False))) < 1e-13


@pytest.mark.usefixtures("way")
@pytest.mark.parametrize("lines_are_last", [True, False])
@pytest.mark.parametrize("n", [1, 2, 5, 6])
def test_the_positive_part_keeps_positive_eigenvalues_alone(n: int, lines_are_last: bool) -> None:
    """Of any size, also where eigenvalues are equal but for their sign, or zero."""
    rng = np.random.default_rng(n)
    Q = np.linalg.qr(circular(rng, (43, n, n)))[0]
    value = rng.normal(size=(43, n)) * 10.0 ** rng.integers(-9, 9, size=(43, 1))
    value[:3] = np.resize([2.0, -2.0], n)
    value[3:5] = 0.0
    value[5] = np.arange(n) > 0
    A, expected = (((Q * each[:, None, :]) @ adjoint(Q)) for each in (value, np.maximum(value, 0.0)))
    found = matrices.positive(laid_out(A, lines_are_last))
    size = np.abs(value).max(axis=1)[:, None, None]
    np.testing.assert_array_less(np.abs(found - expected), 1e-13 * size + 1e-300 + 0 * found.real)


def test_the_kernels_refuse_numbers_of_another_size() -> None:
    """They would be read beyond their end."""
    if not is_compiled():
        pytest.skip("the kernels in C are not built")
    with pytest.raises(TypeError, match="complex128, not float64"):
        matrices.inverse(np.ones((5000, 6, 6)))  # type: ignore[arg-type]
