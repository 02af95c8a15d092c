"""The scatter of periods in C: the numbers of NumPy to rounding, however the spectra lie in memory."""

from collections.abc import Iterator

import numpy as np
import pytest
from plants.three_mass import circular

from elastid.base.arrays import ComplexArray
from elastid.frf import experiment_blocks
from elastid.frf.experiment_blocks import FullSum, PackedSum, add_periods
from elastid.frf.spectra import PeriodSpectra

needs_kernels = pytest.mark.skipif(not experiment_blocks.is_compiled(), reason="the kernels in C are not built")


def groups_of(z: ComplexArray, sizes: tuple[int, ...], scale: ComplexArray) -> Iterator[PeriodSpectra]:
    """Groups of so many periods each."""
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
    expected = plain.collected()
    np.testing.assert_allclose(packed.collected(), expected, rtol=0, atol=1e-13 * np.abs(expected).max())


def test_groups_of_periods_scatter_like_all_at_once() -> None:
    """Chan, Golub and LeVeque: the sum over groups and of their means is that about the mean of all."""
    rng, F, n = np.random.default_rng(0), 20, 3
    z, scale = circular(rng, (9, F, n)) + 5, np.ones((F, n), complex)
    together = FullSum(scale)
    mean = add_periods(together, groups_of(z, (4, 2, 3), scale))
    V = z - z.mean(axis=0)
    np.testing.assert_allclose(mean, z.mean(axis=0), rtol=1e-13)
    np.testing.assert_allclose(together.collected(), np.einsum("pfi,pfj->fij", V, V.conj()), rtol=0, atol=1e-12)
