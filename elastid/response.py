"""FrequencyResponse: G(j omega) of one configuration with its covariance and quality, measured and modelled alike.

    Y(k) = G(k) U(k),   G (F, n_y, n_u)

Measurement and model both end in this value. All on the link side, outputs of one quantity (acceleration unless stated
otherwise).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import field, fields, replace
from typing import Literal, TypeAlias

import numpy as np

from elastid.base.arrays import BoolArray, ComplexArray, FloatArray, frozen_value
from elastid.base.note import Note
from elastid.record import MOTION_ORDER, Configuration, HeldTorque, Motion, drive_unit, motion_unit

CovarianceForm: TypeAlias = Literal["diagonal", "kronecker", "full"]
# Arrays of a Quality with the lines of its response.
LINE_ARRAYS = (
    "coherence",
    "multiple_coherence",
    "singular_values",
    "input_singular_values",
    "input_noise",
    "output_noise",
)


@frozen_value
class Levels:
    """RMS amplitudes (K, n_y) of the outputs at freq_hz (K,), in `quantity`, and of the noise (K, n_y) in them.

    amplitude is that of the mean over periods, in the mean square over all experiments; noise is part of it.
    """

    freq_hz: FloatArray
    amplitude: FloatArray
    noise: FloatArray


@frozen_value
class Quality:
    """Quality of a response at its F lines; even and odd have lines of their own.

    coherence (F, n_y, n_u) and multiple_coherence (F, n_y), of single periods.  singular_values (F, min(n_y, n_u)) of
    G, largest first.  input_singular_values (F, n_u) of the experiments' inputs, each input relative to its RMS: their
    ratio is the condition of the input matrix.  input_noise (F, n_u) and output_noise (F, n_y): variance in one period.
    excited: the outputs.  stochastic (F, n_y): RMS amplitude of the stochastic nonlinear distortion in them, or None.
    even, odd: Y - G U at lines that were not excited, from nonlinearities of even and odd order, or None.
    """

    coherence: FloatArray
    multiple_coherence: FloatArray
    singular_values: FloatArray
    input_singular_values: FloatArray
    input_noise: FloatArray
    output_noise: FloatArray
    excited: Levels
    stochastic: FloatArray | None = None
    even: Levels | None = None
    odd: Levels | None = None

    @property
    def condition(self) -> FloatArray:
        """Condition (F,) of the input matrix, each input relative to its RMS; inf where it is singular."""
        largest, smallest = self.input_singular_values[:, 0], self.input_singular_values[:, -1]
        with np.errstate(over="ignore"):
            return np.asarray(np.divide(largest, smallest, out=np.full(len(largest), np.inf), where=smallest > 0))

    def lines(self, keep: BoolArray) -> Quality:
        """The same on some of the response's lines; keep (F,) is True where a line stays."""
        cut = {name: getattr(self, name)[keep] for name in LINE_ARRAYS}
        excited = Levels(*(getattr(self.excited, field.name)[keep] for field in fields(Levels)))
        stochastic = None if self.stochastic is None else self.stochastic[keep]
        return replace(self, **cut, excited=excited, stochastic=stochastic)


@frozen_value
class Covariance:
    """Covariance of vec G per line (column-major vec), in the form that the data support, with its degrees of freedom.

    full:       matrix (F, n_y n_u, n_y n_u) Hermitian
    kronecker:  cov(vec G(k)) = left(k) (x) right(k),   left (F, n_u, n_u) Hermitian, right (F, n_y, n_y) Hermitian
    diagonal:   the others are None; variance (F, n_y, n_u) only.
    variance is E|dG|^2 of the complex number: each real component carries half of it.  dof are complex, too: the
    variance scatters by 1 / sqrt(dof) of itself.
    """

    variance: FloatArray
    dof: float
    left: ComplexArray | None = None
    right: ComplexArray | None = None
    matrix: ComplexArray | None = None

    def __post_init__(self) -> None:
        """Refuse negative or non-finite variances."""
        if not np.all(np.isfinite(self.variance)) or np.any(self.variance < 0):
            raise ValueError("a variance is negative or not finite")

    @property
    def form(self) -> CovarianceForm:
        """The form, by the factors that are known."""
        if self.matrix is not None:
            return "full"
        return "diagonal" if self.left is None else "kronecker"

    def full(self) -> ComplexArray:
        """cov(vec G) (F, n_y n_u, n_y n_u), vec column-major: elements of one input side by side."""
        F, n_y, n_u = self.variance.shape
        if self.matrix is not None:
            return self.matrix
        if self.left is not None and self.right is not None:
            return np.asarray(np.einsum("fab,fcd->facbd", self.left, self.right).reshape(F, n_u * n_y, n_u * n_y))
        diagonal = self.variance.transpose(0, 2, 1).reshape(F, n_u * n_y)
        return (diagonal[:, :, None] * np.eye(n_u * n_y)).astype(np.complex128)

    def lines(self, keep: BoolArray) -> Covariance:
        """The same on some of its lines; keep (F,) is True where a line stays."""
        left, right, matrix = (None if part is None else part[keep] for part in (self.left, self.right, self.matrix))
        return Covariance(self.variance[keep], self.dof, left, right, matrix)


@frozen_value
class FrequencyResponse:
    """G (F, n_y, n_u) at freq_hz (F,), complex, in `quantity` per Nm on the link side.

    noise: covariance of the disturbing noise (from periods), or None.  total: noise and stochastic nonlinear
    distortion together (from realisations), or None.  distortion: of one realisation by stochastic nonlinear
    distortion alone, or None.  rate_is_known is False where freq_hz is in units of the sampling rate.
    quality: of the measurement, or None.  repairs: counts by the kind of repair in its records.
    sliding: inputs and outputs that translate, in N and m instead of Nm and rad.  input_units: of each input, where one
    is a voltage or a current.  bias (n_b, n_u, F, n_y, n_u): systematic errors of G by dry friction at the motor of
    each input, of which the size is known, each times a factor of unit variance for all lines: some that all
    configurations share, and the last of this configuration by itself; or None.  correlated_lines: lines over which the
    errors of G by noise are correlated, sum of their autocorrelation; 1 where each line is estimated by itself.

    Raises ValueError for shapes that disagree, frequencies that do not increase, or values that are not finite.
    """

    freq_hz: FloatArray
    G: ComplexArray
    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    quantity: Motion
    configuration: Configuration
    noise: Covariance | None = None
    total: Covariance | None = None
    rate_is_known: bool = True
    notes: tuple[Note, ...] = field(default=())
    distortion: Covariance | None = None
    quality: Quality | None = None
    repairs: Mapping[str, int] = field(default_factory=dict)
    sliding: tuple[str, ...] = ()
    input_units: tuple[str, ...] = ()
    bias: ComplexArray | None = None
    correlated_lines: float = 1.0
    hold: HeldTorque | None = None

    def __post_init__(self) -> None:
        """Check the arrays."""
        shape = (len(self.freq_hz), len(self.outputs), len(self.inputs))
        where = f"response of {self.configuration.name}"
        if self.G.shape != shape:
            raise ValueError(f"{where}: G has shape {self.G.shape}, expected (F, n_y, n_u) = {shape}")
        if np.any(np.diff(self.freq_hz) <= 0):
            raise ValueError(f"{where}: the frequencies do not increase")
        bad = np.flatnonzero(~np.isfinite(self.G).all(axis=(1, 2)))
        if bad.size:
            raise ValueError(f"{where}: G is not finite at {bad.size} lines, first {self.freq_hz[bad[0]]:g} Hz")
        for name in ("noise", "total", "distortion"):
            covariance = getattr(self, name)
            if covariance is not None and covariance.variance.shape != shape:
                raise ValueError(f"{where}: {name} variance has shape {covariance.variance.shape}, expected {shape}")
        if self.bias is not None and self.bias.shape[1:] != (len(self.inputs), *shape):
            raise ValueError(f"{where}: bias has shape {self.bias.shape}, expected (n_b, n_u, F, n_y, n_u)")

    @property
    def n_lines(self) -> int:
        """F, the number of lines."""
        return len(self.freq_hz)

    @property
    def unit(self) -> str:
        """Unit of G; several where some places rotate and others slide."""
        return f"({self.output_unit})/({' or '.join(dict.fromkeys(self.units_of_inputs))})"

    @property
    def units_of_inputs(self) -> tuple[str, ...]:
        """The unit of each input."""
        return self.input_units or tuple(drive_unit(place in self.sliding) for place in self.inputs)

    @property
    def output_unit(self) -> str:
        """Unit of the outputs; several where some rotate and others slide."""
        units = dict.fromkeys(motion_unit(self.quantity, place in self.sliding) for place in self.outputs)
        return " or ".join(units)

    @property
    def uncertainty(self) -> Covariance | None:
        """The covariance that gives the weights of a fit: total where realisations gave one, else noise."""
        return self.total if self.total is not None else self.noise

    def lines(self, keep: BoolArray) -> FrequencyResponse:
        """The same response on some of its lines; keep (F,) is True where a line stays."""

        def cut(covariance: Covariance | None) -> Covariance | None:
            return None if covariance is None else covariance.lines(keep)

        return replace(
            self,
            freq_hz=self.freq_hz[keep],
            G=self.G[keep],
            noise=cut(self.noise),
            total=cut(self.total),
            distortion=cut(self.distortion),
            quality=None if self.quality is None else self.quality.lines(keep),
            bias=None if self.bias is None else self.bias[:, :, keep],
        )


def in_quantity(response: FrequencyResponse, quantity: Motion) -> FrequencyResponse:
    r"""The same response in position, velocity or acceleration per torque, its covariance with it.

    .. math:: G' = (j\omega)^k G, \qquad cov(vec\, G') = \omega^{2k} cov(vec\, G)
    """
    k = MOTION_ORDER[quantity] - MOTION_ORDER[response.quantity]
    if k == 0:
        return response
    gain = ((2j * np.pi * response.freq_hz) ** k)[:, None, None]
    power = np.abs(gain) ** 2
    return replace(
        response,
        G=gain * response.G,
        quantity=quantity,
        noise=_scaled(response.noise, power),
        total=_scaled(response.total, power),
        distortion=_scaled(response.distortion, power),
        quality=None,  # it belongs to the outputs as they were measured
        bias=None if response.bias is None else gain * response.bias,
    )


def _scaled(covariance: Covariance | None, power: FloatArray) -> Covariance | None:
    if covariance is None:
        return None
    left, matrix = (None if part is None else part * power for part in (covariance.left, covariance.matrix))
    return replace(covariance, variance=covariance.variance * power, left=left, matrix=matrix)
