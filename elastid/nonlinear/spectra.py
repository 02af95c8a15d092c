"""Spectra of torques, motions and friction basis functions of one configuration, at lines with and without excitation.

Net torques U - Phi f of the experiments give G at the excited lines; G is interpolated at the other lines.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from elastid.base.arrays import BoolArray, ComplexArray, FloatArray, IntArray, interpolate
from elastid.excitation.grids import line_frequencies
from elastid.frf.lines import analysed_lines
from elastid.frf.period_selection import select_periods, without_transient
from elastid.frf.spec import EstimatorSpec
from elastid.frf.spectra import PeriodSpectra, RecordSpectra, period_spectra, single_logs
from elastid.nonlinear.compensated_friction import CompensatedFriction
from elastid.nonlinear.friction_basis import BasisFunction, amplitudes
from elastid.nonlinear.motion import motion_of
from elastid.record import Motion, Record

_MIN_SINGULAR = float(np.sqrt(np.finfo(float).eps))  # least singular value of the torques over the largest


@dataclass(frozen=True)
class ConfigurationSpectra:
    """Amplitudes of K experiments at F lines: torques U and motions Y (F, n_m, K), basis functions Phi (F, n_f, K).

    lines, freq_hz, excited (F,).  realisation (K,): number of each experiment's realisation.  velocity_noise (n_m,):
    standard deviation of the velocity noise.  name: of the configuration.
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
        """True if the experiments separate the inputs and G is invertible at every excited line."""
        if not self.excited.any():
            return True
        for spectra in (self.U[self.excited], self.Y[self.excited]):
            largest = np.maximum(np.abs(spectra).max(axis=(0, 2)), 1e-300)
            values = np.linalg.svd(spectra / largest[:, None], compute_uv=False)
            if not np.all(values[:, -1] > _MIN_SINGULAR * values[:, 0]):
                return False
        return True

    def nonlinear_fraction(self) -> FloatArray:
        """Return the fraction (n_f,) of each function's power that is not linear in the torques: 1 - 2 / pi for a sign.

        It is measured by experiments beyond those that separate the inputs; without any, at unexcited lines.
        """
        on, (_, n_m, K) = self.excited, self.U.shape
        power = np.sum(np.abs(self.Phi[on]) ** 2, axis=(0, 2))
        if n_m < K:
            X = self.net(np.zeros_like(self.U))[1][on]
            return np.asarray(np.sum(np.abs(X) ** 2, axis=(0, 2)) * K / (K - n_m) / np.maximum(power, 1e-300))
        unexcited_power = np.mean(np.abs(self.Phi[~on]) ** 2, axis=(0, 2))
        return np.asarray(unexcited_power / np.maximum(unexcited_power + power / (on.sum() * K), 1e-300))

    def net(self, friction: ComplexArray) -> tuple[ComplexArray, ComplexArray, BoolArray]:
        """Return e (F, n_m, K), X (F, n_f, K) of e = X f, and flags (F,) of the lines that constrain f.

        e = (U - G^-1 Y) Q and X = Phi Q.  The projector Q removes the span of the net torques U - friction from the K
        experiments; Q = 1 at unexcited lines.  friction (F, n_m, K).
        """
        on = self.excited
        net = self.U - friction
        pseudo = np.linalg.pinv(net[on], rcond=_MIN_SINGULAR)
        G = self.Y[on] @ pseudo
        e, X = self.U - np.linalg.solve(interpolate(self.lines, self.lines[on], G), self.Y), self.Phi.copy()
        # The net torques and Y have the same span, because G maps one onto the other.
        for signal in (e, X):
            signal[on] -= (signal[on] @ pseudo) @ net[on]
        counts = on & (self.U.shape[2] > self.U.shape[1])
        counts[~on] = _smooth(self.lines[~on], self.lines[on], G)
        return e, X, counts


def gather_configuration(
    measured: Iterable[Record], shapes: Sequence[BasisFunction], spec: EstimatorSpec, planned: IntArray | None,
    friction: CompensatedFriction | None = None,
) -> ConfigurationSpectra:  # fmt: skip
    """Return the mean spectra over the selected periods of the records of one configuration, one record at a time.

    friction: estimate that gives the motion between the samples; None for the motion of the samples.
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
        periods = selected_periods(spectrum, lines, is_excited, spec, spec.quantity)
        Y.append(periods.Y[..., columns].mean(axis=0))
        U.append(periods.U.mean(axis=0))
        Phi.append(np.zeros((len(lines), len(shapes)), complex))
        # The motion ends with the last whole period.
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


def unsuited_reason(first: Record) -> str:
    """Return the reason why friction and gear effects are not identifiable from these records, else ""."""
    if not first.is_periodic:
        return "the records are not periodic; nonlinear effects are estimated from differences of periodic experiments"
    missing = ", ".join(location for location in first.inputs if location not in first.outputs)
    text = f"the angle of {missing} is not among the outputs. Log the angle of each motor: these effects depend on it"
    return text if missing else ""


def selected_periods(
    spectra: RecordSpectra, lines: IntArray, excited: BoolArray, spec: EstimatorSpec, quantity: Motion
) -> PeriodSpectra:
    """Return motions and torques at `lines` (F,) of the periods that `select_periods` selects by the excited lines."""
    periods = period_spectra(spectra, lines, quantity)
    return periods.only(select_periods(periods.on(excited), spec).periods) if len(periods.periods) > 1 else periods


def compensation_torque(coefficients: FloatArray, Phi: ComplexArray, motor_of: IntArray, n_m: int) -> ComplexArray:
    """Return the friction torque (F, n_m, K) of basis functions Phi (F, n_f, K) at motors motor_of (n_f,)."""
    torque = np.zeros((Phi.shape[0], n_m, Phi.shape[2]), np.complex128)
    for f in np.flatnonzero(coefficients):
        torque[:, motor_of[f]] += coefficients[f] * Phi[:, f]
    return torque


def evenly_spaced(lines: IntArray, count: int) -> IntArray:
    """Return at most `count` lines, evenly spaced, including the first and the last."""
    return lines[np.linspace(0, len(lines) - 1, min(len(lines), count)).round().astype(np.int64)]


def _smooth(targets: IntArray, lines: IntArray, G: ComplexArray) -> BoolArray:
    """Return flags (K,): G (F, n_m, n_m) changes by less than 0.3 between the lines (F,) next to `targets` (K,)."""
    right = np.clip(np.searchsorted(lines, targets), 1, len(lines) - 1)
    change = np.linalg.norm(G[right] - G[right - 1], axis=(1, 2))
    return np.asarray(change < 0.3 * np.linalg.norm(G[right], axis=(1, 2)))
