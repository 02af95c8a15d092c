"""One configuration of a fit: its measured response, the kernel of its model, and what its residuals weigh."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from elastid.base.arrays import ComplexArray, FloatArray
from elastid.base.workers import Kept
from elastid.fit.problem.compressed_residuals import CompressedResiduals, NormalEquations
from elastid.fit.problem.least_squares import RESIDUALS, ResidualKind, error_gain
from elastid.fit.problem.weights import Whitening
from elastid.linear.response.derivatives import Columns
from elastid.linear.response.kernel import Kernel
from elastid.parameters import Parameters


@dataclass(frozen=True, eq=False)
class Part(Kept):
    """One configuration: measured G (F, n_y, n_u), the kernel of its model, and what its residuals are divided by.

    gain (F, n_y, n_u): sqrt(2) / sigma of the residual, 0 where an element is left out.  whitening: of
    gain e of a line whose elements err together; None where they count one by one.  compressed: the residuals, where
    they are known of the very same data and weights, from a model linearised elsewhere.
    """

    kernel: Kernel
    measured: ComplexArray
    gain: FloatArray
    criterion: ResidualKind
    whitening: Whitening | None = None
    compressed: CompressedResiduals | None = None

    @property
    def configuration(self) -> str:
        """The name of the configuration."""
        return self.kernel.model.configuration.name

    def theta(self, parameters: Parameters, x: FloatArray) -> FloatArray:
        """theta (n_theta,) in its configuration."""
        return parameters.expand(x, self.configuration)

    def chain(self, parameters: Parameters, x: FloatArray) -> FloatArray:
        """d theta / d x (P, n_x) of the parameters that x moves there: the kernel's order."""
        return parameters.jacobian(x, self.configuration)[self.kernel.places]

    @property
    def error_gain(self) -> ComplexArray:
        """Residual per error of Ghat (F, n_y, n_u), before it is mixed; 0 where an element is left out."""
        with np.errstate(divide="ignore", invalid="ignore"):
            return np.where(self.gain > 0, self.gain * error_gain(self.criterion, self.measured), 0j)

    @property
    def mixing(self) -> ComplexArray | None:
        """(F, n_y n_u, n_y n_u) times gain e of a line, in the order of G, is white; worked out at every call."""
        return None if self.whitening is None else self.whitening.matrix

    @cached_property
    def normal(self) -> NormalEquations:
        """Cost, gradient and normal matrix without the derivatives of every element."""
        columns = Columns(self.kernel)
        form = columns.elements, columns.is_symmetric, self.kernel.takes_compiled
        own = CompressedResiduals(*form, self.measured, self.gain, self.criterion, self.whitening)
        known = self.compressed
        return NormalEquations(columns, known if known is not None and known.has_data_of(own) else own)

    @property
    def n_residuals(self) -> int:
        """Real residuals, two an element."""
        return 2 * int(np.count_nonzero(self.gain))

    @property
    def for_sums(self) -> Part:
        """The part for `normal` alone, without the covariances of its lines, most of its numbers."""
        residuals = self.normal.residuals.worked_out
        return replace(self, whitening=residuals.whitening, compressed=residuals)

    def with_residuals_of(self, other: Part) -> Part:
        """Part with data and weights of another one, and what has been worked out of them."""
        known = other.normal.residuals
        return replace(self, measured=other.measured, gain=other.gain, whitening=other.whitening, compressed=known)

    def residual(self, G: ComplexArray, mixing: ComplexArray | None) -> ComplexArray:
        """r (F, n_y, n_u) at a response G of the model; real and imaginary parts have unit variance each.

        mixing: that of the part.
        """
        e, used = RESIDUALS[self.criterion](self.measured, G)[0], self.gain > 0
        return mixed(mixing, np.where(used, self.gain * np.where(used, e, 0.0), 0.0))

    def slopes(self, G: ComplexArray, dG: ComplexArray, mixing: ComplexArray | None) -> ComplexArray:
        """dr (n, F, n_y, n_u) by changes dG of a response G."""
        # A logarithm of an element that is left out because it is zero has no slope.
        slope = np.where(self.gain > 0, RESIDUALS[self.criterion](self.measured, G)[1], 0.0)
        return mixed(mixing, -self.gain * slope * dG)


def mixed(mixing: ComplexArray | None, values: ComplexArray) -> ComplexArray:
    """mixing, if there is any, applied to the elements of each line of values (..., F, n_y, n_u)."""
    if mixing is None:
        return values
    flat = values.reshape(-1, len(mixing), mixing.shape[1])
    return np.asarray((mixing @ flat.transpose(1, 2, 0)).transpose(2, 0, 1).reshape(values.shape))
