"""Spectra of torques and motor angles at all lines of a period, for gear effects, and signals on their fine grid."""

from collections.abc import Iterable
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.fft import irfft, rfft

from elastid.base.arrays import BoolArray, ComplexArray, FloatArray, IntArray, laplace_variable, smallest_step
from elastid.base.errors import DataError
from elastid.excitation.grids import line_frequencies
from elastid.frf.lines import analysed_lines
from elastid.frf.spec import EstimatorSpec
from elastid.frf.spectra import RecordSpectra, single_logs
from elastid.nonlinear.motion import CELLS
from elastid.nonlinear.spectra import selected_periods, unsuited_reason
from elastid.record import Configuration, Record


@dataclass(frozen=True, eq=False)
class PeriodLines:
    """Amplitudes of M experiments of one configuration at lines 1 to F: torques U and motor angles Y (F, n_u, M).

    Link side, Nm and rad.  mean, load (n_u, M): mean angles and torques over whole periods.  noise (n_u,): variance of
    the white noise of Y.  scatter (F, n_u): variance of Y by differences between periods.  samples: of a period.
    count (n_u,): encoder resolution, rad.  sampled (n_u,): True if the angle itself is logged.  arm (F + 1, n_j, M):
    nonlinear torques of the links whose motion is subtracted from Y, their mean first.  cells: in a sample.
    """

    configuration: Configuration
    rate_hz: float
    samples: int
    U: ComplexArray
    Y: ComplexArray
    mean: FloatArray
    load: FloatArray
    noise: FloatArray
    scatter: FloatArray
    excited: BoolArray
    realisation: IntArray
    count: FloatArray
    sampled: BoolArray
    arm: ComplexArray | None = None
    cells: int = CELLS

    @property
    def points(self) -> int:
        """Number of points of the fine grid."""
        return self.samples * self.cells

    @cached_property
    def freq_hz(self) -> FloatArray:
        """Frequencies (F,) of the lines."""
        return line_frequencies(np.arange(1, len(self.U) + 1), self.rate_hz, self.samples)

    @cached_property
    def s(self) -> ComplexArray:
        """j omega (F,)."""
        return laplace_variable(self.freq_hz)

    def fine(self, X: ComplexArray) -> FloatArray:
        """Return the signals (..., n) with amplitudes X (..., F) on the fine grid of a period."""
        n = self.points
        padded = np.zeros((*X.shape[:-1], n // 2 + 1), complex)
        padded[..., 1 : X.shape[-1] + 1] = X
        return irfft(padded, n) * (n / 2)

    def amplitudes(self, x: FloatArray) -> ComplexArray:
        """Return the amplitudes (..., F) of signals x (..., n) on the fine grid."""
        return np.asarray(rfft(x)[..., 1 : len(self.U) + 1] * (2 / x.shape[-1]))

    def folded(self, x: FloatArray) -> tuple[ComplexArray, ComplexArray]:
        """Return amplitudes (..., F) of forces x (..., n), and aliases (..., F) of an inertia's motion above the lines.

        Aliases are relative to the motion by a unit force at the last line.  Sampling folds line k + m N to k, and
        m N - k to the conjugate of k.
        """
        X, F, k = rfft(x) * (2 / x.shape[-1]), len(self.U), np.arange(1, len(self.U) + 1)
        aliases = np.zeros((*X.shape[:-1], F), complex)
        for m in range(1, self.cells // 2 + 1):
            above, below = k + m * self.samples, m * self.samples - k
            if above[-1] < X.shape[-1]:
                aliases += X[..., above] * (F / above) ** 2
            aliases += X[..., below].conj() * (F / below) ** 2
        return X[..., 1 : F + 1], aliases


def gather_lines(measured: Iterable[Record], spec: EstimatorSpec, planned: IntArray | None) -> PeriodLines:
    """Return the spectra of one configuration, averaged over the selected periods of its records.

    Raises DataError and StudyError as `analysed_lines` does, and DataError for records without motor angles.
    """
    records = tuple(log for record in measured for log in single_logs(record))
    first = records[0]
    if reason := unsuited_reason(first):
        raise DataError("gears/records", reason, f"configuration {first.configuration.name}")
    columns = [first.outputs.index(location) for location in first.inputs]
    excited = analysed_lines(list(map(RecordSpectra, records)), spec, planned)
    lines = np.arange(1, (first.period_samples + 1) // 2)
    is_excited = np.isin(lines, excited)
    full_records = (RecordSpectra(replace(record, half_wave=False)) for record in records)
    periods = [selected_periods(record, lines, is_excited, spec, "position") for record in full_records]
    period_spectra = [period.Y[:, :, columns] for period in periods]
    variances = [Y.var(axis=0, ddof=1) / len(Y) for Y in period_spectra if len(Y) > 1]
    # The scatter of a single period is unknown; the highest lines, where a robot barely moves, give its noise.
    scatter = np.mean(variances or [np.abs(Y[0]) ** 2 for Y in period_spectra], axis=0)
    is_position = np.array([first.quantities[i] == "position" for i in columns])
    return PeriodLines(
        first.configuration, first.rate_hz, first.period_samples,
        np.stack([period.U.mean(axis=0) for period in periods], axis=2),
        np.stack([Y.mean(axis=0) for Y in period_spectra], axis=2),
        np.stack([np.where(is_position, record.y[:, columns].mean(axis=0), 0.0) for record in records], axis=1),
        np.stack([record.u[: record.n_periods * record.period_samples].mean(axis=0) for record in records], axis=1),
        np.mean(scatter[int(7 / 8 * len(scatter)) :], axis=0), scatter, is_excited,
        np.array([record.realisation for record in records]),
        np.array([smallest_step(first.y[:, column]) for column in columns]), is_position,
    )  # fmt: skip
