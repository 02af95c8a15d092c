"""The scatter of periods in C: the numbers of NumPy to rounding, however the spectra lie in memory."""

from collections.abc import Iterator

import numpy as np
import pytest
from plants.three_mass import circular

from elastid.base.arrays import ComplexArray
from elastid.frf import experiment_blocks
from elastid.frf.experiment_blocks import Block, FullSum, MeanSpectra, PackedSum, add_periods
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


def mean_spectra(periods: list[list[float]], has_reference: bool = True) -> MeanSpectra:
    """Two inputs and three outputs at seven lines; for each realisation the periods of its experiments."""
    rng, blocks = np.random.default_rng(1), []
    for P in periods:
        U, Y, R = (circular(rng, (7, n, len(P))) for n in (2, 3, 2))
        blocks.append(
            Block(U, Y, R if has_reference else None, np.array(P), np.full((7, 2), len(blocks) + 1.0), len(P))
        )
    return MeanSpectra(tuple(blocks), np.zeros((7, 5, 5), np.complex128), sum(map(len, periods)))


@pytest.mark.parametrize("periods", [[[2.0, 2.0], [2.0, 2.0, 2.0]], [[2.0, 3.0], [4.0, 2.0, 2.0]]])
def test_sums_of_periods_count_each_experiment_by_its_own(periods: list[list[float]]) -> None:
    """Equal and unequal numbers: sum of P X U^H, of |Y|^2 and of P |Y|^2."""
    data = mean_spectra(periods)
    U, Y = (np.concatenate([getattr(block, name) for block in data.blocks], axis=2) for name in "UY")
    P = np.concatenate(periods)
    for stacks, X in ((data.Y, Y), (data.U, U)):
        np.testing.assert_allclose(data.of_periods(stacks), np.einsum("e,fye,fue->fyu", P, X, U.conj()))
    plain, weighted = data.output_powers
    np.testing.assert_allclose(plain, np.sum(np.abs(Y) ** 2, axis=2))
    np.testing.assert_allclose(weighted, np.sum(P * np.abs(Y) ** 2, axis=2))


def test_all_experiments_are_one_block_with_references_where_all_have_them() -> None:
    """Noise of the inputs by degrees of freedom: (2 * 1 + 3 * 2) / 5; and a W of each block with U W = 1."""
    data = mean_spectra([[2.0, 2.0], [3.0, 3.0, 3.0]])
    every = data.every
    assert every.R is not None
    np.testing.assert_array_equal(every.R[:, :, 2:], data.blocks[1].R)
    np.testing.assert_array_equal(every.periods, [2, 2, 3, 3, 3])
    np.testing.assert_allclose(every.input_noise, 1.6)
    assert mean_spectra([[2.0, 2.0], [3.0, 3.0]], has_reference=False).every.R is None
    for block in (*data.blocks, every):
        np.testing.assert_allclose(block.U @ block.W, np.broadcast_to(np.eye(2), (7, 2, 2)), atol=1e-9)
