"""Spectra of torques and motions of all experiments of one configuration, at lines excited or not; their fine grid."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.fft import irfft, rfft

from elastid.base.arrays import (
    BoolArray,
    ComplexArray,
    FloatArray,
    IntArray,
    interpolate,
    laplace_variable,
    smallest_step,
)
from elastid.base.errors import DataError
from elastid.excitation.grids import line_frequencies
from elastid.frf.lines import analysed_lines
from elastid.frf.period_selection import select_periods, without_transient
from elastid.frf.spec import EstimatorSpec
from elastid.frf.spectra import PeriodSpectra, RecordSpectra, period_spectra, single_logs
from elastid.nonlinear.compensated_friction import CompensatedFriction
from elastid.nonlinear.friction_basis import BasisFunction, amplitudes
from elastid.nonlinear.motion import CELLS, motion_of
from elastid.record import Configuration, Motion, Record

_MIN_SINGULAR = float(np.sqrt(np.finfo(float).eps))  # of the torques, over the largest singular value


@dataclass(frozen=True)
class ConfigurationSpectra:
    """Amplitudes of K experiments at F lines: U (F, n_m, K), Y (F, n_m, K) of the same motors, Phi (F, n_f, K).

    excited (F,): where G = Y / U is found; at the other lines G is interpolated.  realisation (K,): of each experiment.
    freq_hz (F,).  velocity_noise (n_m,): standard deviation of the noise in the motion that the shapes are along.
    name: of the configuration.
    """

    lines: IntArray
    freq_hz: FloatArray
    excited: BoolArray
    U: ComplexArray
    Y: ComplexArray
    Phi: ComplexArray
    realisation: IntArray
    velocity_noise: FloatArray
    name: str = ""

    @property
    def is_invertible(self) -> bool:
        """True if the experiments separate the inputs and G has an inverse, at every line that is excited."""
        if not self.excited.any():
            return True
        for spectra in (self.U[self.excited], self.Y[self.excited]):
            largest = np.maximum(np.abs(spectra).max(axis=(0, 2)), 1e-300)
            values = np.linalg.svd(spectra / largest[:, None], compute_uv=False)
            if not np.all(values[:, -1] > _MIN_SINGULAR * values[:, 0]):
                return False
        return True

    def nonlinear_fraction(self) -> FloatArray:
        """Return the fraction (n_f,) of each function's power that is not linear in the torques: 1 - 2 / pi of a sign.

        From the experiments beyond those that separate the inputs; without any, from lines that are not excited.
        """
        on, (_, n_m, K) = self.excited, self.U.shape
        power = np.sum(np.abs(self.Phi[on]) ** 2, axis=(0, 2))
        if n_m < K:
            X = self.net(np.zeros_like(self.U))[1][on]
            return np.asarray(np.sum(np.abs(X) ** 2, axis=(0, 2)) * K / (K - n_m) / np.maximum(power, 1e-300))
        unexcited_power = np.mean(np.abs(self.Phi[~on]) ** 2, axis=(0, 2))
        return np.asarray(unexcited_power / np.maximum(unexcited_power + power / (on.sum() * K), 1e-300))

    def net(self, friction: ComplexArray) -> tuple[ComplexArray, ComplexArray, BoolArray]:
        """Return e (F, n_m, K) and basis functions X (F, n_f, K) after subtraction of `friction` (F, n_m, K) from U.

        e = (U - G^-1 Y) Q and X = Phi Q, Q being the projector that takes the span of the net torques out of the K
        experiments; at unexcited lines Q = 1.  So e = X f for the coefficients f of the friction in U.  And the lines
        (F,) that constrain f.
        """
        on = self.excited
        net = self.U - friction
        pseudo = np.linalg.pinv(net[on], rcond=_MIN_SINGULAR)
        G = self.Y[on] @ pseudo
        e, X = self.U - np.linalg.solve(interpolate(self.lines, self.lines[on], G), self.Y), self.Phi.copy()
        # The span of the net torques is that of Y, too, as far as G maps one onto the other.
        for signal in (e, X):
            signal[on] -= (signal[on] @ pseudo) @ net[on]
        counts = on & (self.U.shape[2] > self.U.shape[1])
        counts[~on] = _smooth(self.lines[~on], self.lines[on], G)
        return e, X, counts


def gather_configuration(
    measured: Iterable[Record],
    shapes: Sequence[BasisFunction],
    spec: EstimatorSpec,
    planned: IntArray | None,
    friction: CompensatedFriction | None = None,
) -> ConfigurationSpectra:
    """Return the mean spectra over the trusted periods of the records of one configuration, one record at a time.

    friction: under which motors turn back between their samples; None as long as none was found.
    Raises DataError and StudyError as `analysed_lines` does.
    """
    records = tuple(without_transient(log) for record in measured for log in single_logs(record))
    first = records[0]
    spectra = list(map(RecordSpectra, records))
    excited = analysed_lines(spectra, spec, planned)
    everywhere = np.arange(excited[0], excited[-1] + 1, 2 if first.half_wave else 1)
    lines = np.union1d(evenly_spaced(excited, 400), evenly_spaced(np.setdiff1d(everywhere, excited), 400))
    is_excited = np.isin(lines, excited)
    columns = [first.outputs.index(motor) for motor in first.inputs]
    U, Y, Phi = list[ComplexArray](), list[ComplexArray](), list[ComplexArray]()
    velocity_noise = np.zeros((len(spectra), len(first.inputs)))
    motors = tuple(dict.fromkeys(shape.place for shape in shapes))
    for k, spectrum in enumerate(spectra):
        record = spectrum.record
        periods = _periods(spectrum, lines, is_excited, spec, spec.quantity)
        Y.append(periods.Y[..., columns].mean(axis=0))
        U.append(periods.U.mean(axis=0))
        Phi.append(np.zeros((len(lines), len(shapes)), complex))
        # A last half period without its other half is no part of the motion.
        complete = periods.periods[periods.periods < record.n_periods * first.period_samples // first.repeat_samples]
        for motor in motors:
            motion = friction.motion(record, motor) if friction else motion_of(record, motor)
            velocity_noise[k, first.inputs.index(motor)] = motion.velocity_noise
            rows = [i for i, shape in enumerate(shapes) if shape.place == motor]
            Phi[-1][:, rows] = amplitudes(record, motion, [shapes[i] for i in rows], complete, lines).T
    return ConfigurationSpectra(
        lines, line_frequencies(lines, first.rate_hz, first.period_samples), is_excited, np.stack(U, axis=2),
        np.stack(Y, axis=2), np.stack(Phi, axis=2), np.array([record.realisation for record in records]),
        np.sqrt(np.mean(velocity_noise**2, axis=0)), first.configuration.name,
    )  # fmt: skip


@dataclass(frozen=True, eq=False)
class PeriodLines:
    """Amplitudes of M experiments of one configuration at lines 1 to F: torques U (F, n_u, M), angles Y (F, n_u, M).

    Y of the motors that U acts on, in their order, rad on the link side.  mean, load (n_u, M): mean angles and torques,
    of whole periods.  noise (n_u,): variance of the noise of an element of Y that does not fall with frequency.
    scatter (F, n_u): variance of the mean over the periods, of Y.  excited (F,).  samples: of a period.  count (n_u,):
    smallest step of an angle.  sampled (n_u,): whether an angle was logged, and no derivative of it.  arm (F + 1, n_j,
    M): torques of the links, and their mean first, whose motion is subtracted from Y; 0 if none.  cells: of a sample.
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
        """Points of the fine grid."""
        return self.samples * self.cells

    @cached_property
    def freq_hz(self) -> FloatArray:
        """Frequencies (F,)."""
        return line_frequencies(np.arange(1, len(self.U) + 1), self.rate_hz, self.samples)

    @cached_property
    def s(self) -> ComplexArray:
        """j omega (F,)."""
        return laplace_variable(self.freq_hz)

    def fine(self, X: ComplexArray) -> FloatArray:
        """Return the signals (..., n) of amplitudes (..., F) on the fine grid of a period."""
        n = self.points
        padded = np.zeros((*X.shape[:-1], n // 2 + 1), complex)
        padded[..., 1 : X.shape[-1] + 1] = X
        return irfft(padded, n) * (n / 2)

    def amplitudes(self, x: FloatArray) -> ComplexArray:
        """Return amplitudes (..., F) of signals (..., n) on the fine grid."""
        return np.asarray(rfft(x)[..., 1 : len(self.U) + 1] * (2 / x.shape[-1]))

    def folded(self, x: FloatArray) -> tuple[ComplexArray, ComplexArray]:
        """Return amplitudes (..., F) of forces (..., n), and aliases (..., F) of an inertia's motion beyond the lines.

        Over the motion by a force of 1 at the last line: line k + m N is sampled as k, m N - k as its conjugate.
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
    """Return the spectra of one configuration, averaged over the trusted periods of its records.

    Raises DataError and StudyError as `analysed_lines` does; DataError where gears cannot be looked for.
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
    periods = [_periods(record, lines, is_excited, spec, "position") for record in full_records]
    period_spectra = [period.Y[:, :, columns] for period in periods]
    variances = [Y.var(axis=0, ddof=1) / len(Y) for Y in period_spectra if len(Y) > 1]
    # Of a single period the highest lines show noise, where a robot barely moves.
    scatter = np.mean(variances if variances else [np.abs(Y[0]) ** 2 for Y in period_spectra], axis=0)
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


def unsuited_reason(first: Record) -> str:
    """Return the reason why friction and gear effects are not identifiable from these records, else ""."""
    if not first.is_periodic:
        return "the records are not periodic; nonlinear effects are estimated from differences of periodic experiments"
    missing = ", ".join(location for location in first.inputs if location not in first.outputs)
    text = f"the angle of {missing} is not among the outputs. Log the angle of each motor: these effects depend on it"
    return text if missing else ""


def _periods(
    spectra: RecordSpectra, lines: IntArray, excited: BoolArray, spec: EstimatorSpec, quantity: Motion
) -> PeriodSpectra:
    """Return motions and torques of the periods that can be trusted, by their excited lines (F,), at all lines."""
    periods = period_spectra(spectra, lines, quantity)
    return periods.only(select_periods(periods.on(excited), spec).periods) if len(periods.periods) > 1 else periods


def compensation_torque(coefficients: FloatArray, Phi: ComplexArray, motor_of: IntArray, n_m: int) -> ComplexArray:
    """Return friction torque (F, n_m, K) of shapes (F, n_f, K) that act on motors motor_of (n_f,)."""
    torque = np.zeros((Phi.shape[0], n_m, Phi.shape[2]), dtype=np.complex128)
    for f in np.flatnonzero(coefficients):
        torque[:, motor_of[f]] += coefficients[f] * Phi[:, f]
    return torque


def evenly_spaced(lines: IntArray, count: int) -> IntArray:
    """Return at most so many of the lines, evenly spaced, with the first and the last."""
    return lines[np.linspace(0, len(lines) - 1, min(len(lines), count)).round().astype(np.int64)]


def _smooth(targets: IntArray, lines: IntArray, G: ComplexArray) -> BoolArray:
    """Return True where G (F, n_m, n_m) changes by at most 0.3 between the lines (F,) about `targets` (K,)."""
    right = np.clip(np.searchsorted(lines, targets), 1, len(lines) - 1)
    change = np.linalg.norm(G[right] - G[right - 1], axis=(1, 2))
    return np.asarray(change < 0.3 * np.linalg.norm(G[right], axis=(1, 2)))
