"""Covariance of a frequency response at each line, in the form that the data support."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Literal, TypeAlias

import numpy as np

from elastid.base.arrays import BoolArray, ComplexArray, FloatArray, frozen_value, labelled
from elastid.base.display import Display, as_html, as_text
from elastid.base.large_arrays import release
from elastid.base.messages import WorkerConstant

CovarianceForm: TypeAlias = Literal["diagonal", "kronecker", "full"]


@frozen_value
class Covariance(WorkerConstant):
    """Covariance of vec G per line (column-major vec), in the form that the data support, with its degrees of freedom.

    full:       matrix (F, n_y n_u, n_y n_u) Hermitian
    kronecker:  cov(vec G(k)) = left(k) (x) right(k),   left (F, n_u, n_u) Hermitian, right (F, n_y, n_y) Hermitian
    diagonal:   the others are None; variance (F, n_y, n_u) only.
    variance is E|dG|^2 of the complex number: each real component carries half of it.  dof are complex, too: the
    variance scatters by 1 / sqrt(dof) of itself.  averaging_lines: lines over which errors have one level by chance, so
    that the sum of their squares over all lines has so many times the variance; 1 where each has its own.
    """

    variance: FloatArray = labelled("variance of G", "({unit})^2", "freq_hz outputs inputs")
    dof: float = labelled("complex: the variance scatters by 1 / sqrt(dof) of itself")
    left: ComplexArray | None = labelled("cov vec G = left (x) right", "", "freq_hz inputs inputs", default=None)
    right: ComplexArray | None = labelled("cov vec G = left (x) right", "", "freq_hz outputs outputs", default=None)
    matrix: ComplexArray | None = labelled("covariance of vec G", "({unit})^2", "freq_hz element element", default=None)
    averaging_lines: float = 1.0

    def __post_init__(self) -> None:
        """Refuse negative or non-finite variances."""
        if not np.all(np.isfinite(self.variance)) or np.any(self.variance < 0):
            raise ValueError("a variance is negative or not finite")

    __repr__, _repr_html_ = as_text, as_html

    @property
    def display(self) -> Display:
        """Form, size and degrees of freedom."""
        lines, n_y, n_u = self.variance.shape
        return Display(f"Covariance of {n_y} x {n_u} at {lines} lines: {self.form}, {self.dof:.4g} degrees of freedom")

    @property
    def form(self) -> CovarianceForm:
        """The form, by the factors that are known."""
        if self.matrix is not None:
            return "full"
        return "diagonal" if self.left is None else "kronecker"

    def full(self) -> ComplexArray:
        """Return cov(vec G) (F, n_y n_u, n_y n_u), vec column-major: elements of one input side by side."""
        F, n_y, n_u = self.variance.shape
        if self.matrix is not None:
            return self.matrix
        if self.left is not None and self.right is not None:
            return kronecker(self.left, self.right)
        diagonal = self.variance.transpose(0, 2, 1).reshape(F, n_u * n_y)
        return (diagonal[:, :, None] * np.eye(n_u * n_y)).astype(np.complex128)

    def lines(self, keep: BoolArray) -> "Covariance":
        """Select lines; keep (F,) is True for a line that stays."""
        matrices = (self.left, self.right, self.matrix)
        left, right, matrix = (None if A is None else np.asarray(A)[keep] for A in matrices)
        return replace(self, variance=self.variance[keep], left=left, right=right, matrix=matrix)

    def release(self) -> None:
        """Release the memory of mapped values; they are read again on demand."""
        for matrix in (self.left, self.right, self.matrix):
            release(matrix)

    @property
    def in_file(self) -> ComplexArray | None:
        """Matrix in a file, if any: `base.large_arrays.move_beside` uses its folder."""
        return next((matrix for matrix in (self.matrix, self.right) if matrix is not None), None)

    def elements(self, rows: Sequence[int], columns: Sequence[int]) -> "Covariance":
        """Select outputs and inputs by their indices."""
        n_y = self.variance.shape[1]
        of_vec = [i + n_y * j for j in columns for i in rows]

        def block(A: ComplexArray | None, indices: Sequence[int]) -> ComplexArray | None:
            return None if A is None else np.asarray(A)[:, indices][:, :, indices]

        left, right = block(self.left, columns), block(self.right, rows)
        variance, matrix = self.variance[:, rows][:, :, columns], block(self.matrix, of_vec)
        return replace(self, variance=variance, left=left, right=right, matrix=matrix)


def kronecker(left: ComplexArray, right: ComplexArray) -> ComplexArray:
    """Return left (x) right (F, n m, n m) of stacks (F, n, n) and (F, m, m)."""
    size = left.shape[1] * right.shape[1]
    return np.asarray(np.einsum("fab,fcd->facbd", left, right).reshape(-1, size, size))


def scale_covariance(covariance: Covariance | None, power: FloatArray) -> Covariance | None:
    """Scale the covariance by power (F, 1, 1) = |gain|^2, for a response times a gain."""
    if covariance is None:
        return None
    left, matrix = (None if A is None else A * power for A in (covariance.left, covariance.matrix))
    return replace(covariance, variance=covariance.variance * power, left=left, matrix=matrix)
