"""The scatter of periods about their means, summed over experiments: in C (`base/kernels/scatter.c`) or NumPy."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from elastid.base.arrays import ComplexArray, FloatArray
from elastid.base.kernels import call, is_compiled
from elastid.frf.matrices import adjoint
from elastid.frf.spectra import PeriodSpectra

# Of `scatter.c`.
BATCH = 8


class FullSum:
    """S (F, n, n) as it is."""

    # The spectra of so many lines, in all periods of a record, fit into the processor's cache.
    lines_at_once = 256

    def __init__(self, F: int, n: int) -> None:
        self.S: ComplexArray = np.zeros((F, n, n), np.complex128)

    def add(self, part: slice, z: ComplexArray) -> ComplexArray:
        """Adds the scatter of z (P, f, n) at some lines; returns its mean (f, n)."""
        z = np.ascontiguousarray(z)
        mean = z.sum(axis=0) / len(z)
        V = np.moveaxis(z - mean, 0, 2)
        self.S[part] += V @ adjoint(V)
        return np.asarray(mean)

    def power(self) -> FloatArray:
        """The diagonal (F, n)."""
        return np.asarray(np.einsum("fii->fi", self.S).real)

    def collect(self, scale: ComplexArray) -> ComplexArray:
        """scale_i conj(scale_j) S_ij (F, n, n), scale (F, n), in the place of S."""
        self.S *= scale[:, :, None]
        self.S *= scale[:, None, :].conj()
        return self.S


class PackedSum:
    """S of the kernels in C: (batches, n (n + 1) / 2, 2, BATCH), the pairs on and above the diagonal of BATCH lines."""

    lines_at_once = 1 << 14

    def __init__(self, F: int, n: int) -> None:
        self.F, self.n = F, n
        self.S: FloatArray = np.zeros((-(-F // BATCH), n * (n + 1) // 2, 2, BATCH))

    def add(self, part: slice, z: ComplexArray) -> ComplexArray:
        """As `FullSum.add`, from whole batches on."""
        (P, f, n), mean = z.shape, np.empty((z.shape[2], z.shape[1]), np.complex128)
        apart = [stride // z.itemsize for stride in z.strides]
        # By its address: z may be a view.
        call("add_scatter", P, f, n, z.ctypes.data, *apart, mean, self.S[part.start // BATCH :])
        return mean.T

    def power(self) -> FloatArray:
        """As `FullSum.power`."""
        i = np.arange(self.n)
        diagonal = self.S[:, i * self.n - i * (i - 1) // 2, 0]
        return np.asarray(diagonal.transpose(0, 2, 1).reshape(-1, self.n)[: self.F])

    def collect(self, scale: ComplexArray) -> ComplexArray:
        """As `FullSum.collect`."""
        found = np.empty((self.F, self.n, self.n), np.complex128)
        call("collect", self.F, self.n, self.S, scale, found)
        return found


class ScatterSum:
    """The scatter of the periods of one experiment after the other, before its scale (F, n); one array in memory."""

    def __init__(self, scale: ComplexArray) -> None:
        self.scale, self.dof = np.asfortranarray(scale), 0
        self._sum = (PackedSum if is_compiled() else FullSum)(*scale.shape)

    def add(self, groups: Iterable[PeriodSpectra]) -> ComplexArray:
        """Adds the scatter of a record's periods, group by group; returns their mean Z (F, n).

        Scatters about the means of two groups add up with that of the means (Chan, Golub and LeVeque, 1979), which is
        the scatter of two periods, one on either side.
        """
        F, n_channels = self.scale.shape
        mean, n = np.zeros((n_channels, F), np.complex128).T, 0
        for spectra in groups:
            p = len(spectra.periods)
            if not p:
                continue
            for first in range(0, F, self._sum.lines_at_once):
                part = slice(first, first + self._sum.lines_at_once)
                of_group = self._sum.add(part, spectra.z[:, part])
                if n:
                    apart = of_group - mean[part]
                    side = np.sqrt(n * p / (n + p) / 2) * apart
                    self._sum.add(part, np.stack([side, -side]))
                    of_group = mean[part] + p / (n + p) * apart
                mean[part] = of_group
            n += p
        self.dof += n - 1
        return mean * self.scale

    def power(self) -> FloatArray:
        """Sum (F, n) over periods of |Z - mean|^2."""
        return np.asarray(self._sum.power() * np.abs(self.scale) ** 2)

    def collected(self) -> ComplexArray:
        """Sum (F, n, n) over periods of (Z - mean)(Z - mean)^H."""
        return self._sum.collect(self.scale)
