"""Stacks of matrices and the scatter of periods in C: the numbers of NumPy to rounding, whatever lies in memory."""

from collections.abc import Iterator

import numpy as np
import pytest
from plants.two_mass import circular

from elastid.base import matrices
from elastid.base.arrays import ComplexArray, FloatArray
from elastid.base.kernels import is_compiled
from elastid.frf import experiment_blocks
from elastid.frf.experiment_blocks import FullSum, PackedSum, add_periods
from elastid.frf.spectra import PeriodSpectra

# One line and incomplete batches, odd sizes, and many lines.
SHAPES = [(1, 1, 1), (7, 2, 3), (37, 5, 4), (16, 3, 6), (300, 6, 6), (600, 7, 7)]


def laid_out(A: ComplexArray, lines_are_last: bool) -> ComplexArray:
    """The same stack (F, n, m) with its lines side by side in memory, or its columns."""
    return np.moveaxis(np.moveaxis(A, 0, 2).copy(), 2, 0) if lines_are_last else A


@pytest.fixture(params=["numpy", "c"])
def way(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> None:
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
    assert off(matrices.added_cross_products(Y, U), sum(y @ u.mT.conj() for y, u in pairs)) < 1e-13
    assert off(matrices.added_cross_products(Y, Y), sum(y @ y.mT.conj() for y in Y)) < 1e-13
    plain = matrices.added_products(Y, [u.mT for u in U])
    assert off(plain, sum(y @ u.mT for y, u in pairs)) < 1e-13
    assert off(matrices.added_error_products(Y, G, U), sum(d @ d.mT.conj() for d in D)) < 1e-13


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


def test_the_positive_part_keeps_positive_eigenvalues_alone() -> None:
    Q, value = np.linalg.qr(circular(np.random.default_rng(0), (2, 3, 3)))[0], np.array([3.0, 0.0, -2.0])
    A, expected = ((Q * each) @ Q.mT.conj() for each in (value, np.maximum(value, 0.0)))
    np.testing.assert_allclose(matrices.positive(A), expected, atol=1e-14)


def test_the_kernels_refuse_numbers_of_another_size() -> None:
    """They would be read beyond their end."""
    if not is_compiled():
        pytest.skip("the kernels in C are not built")
    with pytest.raises(TypeError, match="complex128, not float64"):
        matrices.inverse(np.ones((5000, 6, 6)))  # type: ignore[arg-type]


needs_kernels = pytest.mark.skipif(not experiment_blocks.is_compiled(), reason="the kernels in C are not built")


def groups_of(z: ComplexArray, sizes: tuple[int, ...], scale: ComplexArray) -> Iterator[PeriodSpectra]:
    for part in np.split(z, np.cumsum(sizes)[:-1]):
        yield PeriodSpectra(None, np.arange(len(part)), part, scale)  # the record is not asked for


@needs_kernels
@pytest.mark.parametrize("is_channel_first", [True, False])
@pytest.mark.parametrize(("F", "n", "sizes"), [(1, 1, (2,)), (8, 2, (3, 0)), (37, 5, (4, 2, 3)), (300, 12, (8,))])
def test_scatter_in_c_is_that_of_numpy(F: int, n: int, sizes: tuple[int, ...], is_channel_first: bool) -> None:
    """One line and incomplete batches; any number of channels; a record in groups; two records."""
    rng = np.random.default_rng(F)
    shape = (sum(sizes), n, F + 3) if is_channel_first else (sum(sizes), F + 3, n)
    scale, sums, means = circular(rng, (F, n)), [], []
    records = [circular(rng, shape) + 3 for _ in range(2)]
    for kind in (FullSum, PackedSum):
        sums.append(kind(scale))
        z = [(one.swapaxes(1, 2) if is_channel_first else one)[:, 2 : F + 2] for one in records]
        means.append(np.array([add_periods(sums[-1], groups_of(one, sizes, scale)) for one in z]))
    plain, packed = sums
    assert packed.dof == plain.dof == 2 * (sum(sizes) - 1)
    np.testing.assert_allclose(means[1], means[0], rtol=1e-13)
    np.testing.assert_allclose(packed.power(), plain.power(), rtol=1e-12)
    expected = plain.collect()
    np.testing.assert_allclose(packed.collect(), expected, rtol=0, atol=1e-13 * np.abs(expected).max())


def test_groups_of_periods_scatter_like_all_at_once() -> None:
    """Chan, Golub and LeVeque: the sum over groups and of their means is that about the mean of all."""
    rng, F, n = np.random.default_rng(0), 20, 3
    z, scale = circular(rng, (9, F, n)) + 5, np.ones((F, n), complex)
    together = FullSum(scale)
    mean = add_periods(together, groups_of(z, (4, 2, 3), scale))
    V = z - z.mean(axis=0)
    np.testing.assert_allclose(mean, z.mean(axis=0), rtol=1e-13)
    np.testing.assert_allclose(together.collect(), np.einsum("pfi,pfj->fij", V, V.conj()), rtol=0, atol=1e-12)
