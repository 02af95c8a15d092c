"""Identification of motor friction from the records of all configurations of a measurement."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial

import numpy as np

from elastid.base.arrays import FloatArray, IntArray, laplace_variable
from elastid.base.errors import Note, Severity
from elastid.base.execution import Execution
from elastid.base.statistics import chi_square_limit
from elastid.frf.checks import check_consistency
from elastid.frf.spec import EstimatorSpec, Friction
from elastid.frf.spectra import RecordSpectra
from elastid.nonlinear.basis_selection import (
    SIGN_ERROR,
    Basis,
    basis_error_covariance,
    candidate_basis,
    delay_spectra,
    median_swing,
    refine_basis,
    select_basis,
    torque_delay,
)
from elastid.nonlinear.compensated_friction import CompensatedFriction
from elastid.nonlinear.friction_basis import BasisFunction
from elastid.nonlinear.motion import VELOCITY_NOISE, motion_of
from elastid.nonlinear.spectra import ConfigurationSpectra, compensation_torque, gather_configuration, unsuited_reason
from elastid.nonlinear.variable_projection import (
    NormalEquations,
    estimate_coefficients,
    inverse,
    normal_equations,
    residual_power_ratios,
)
from elastid.record import MOTION_ORDER, Record

# Basis functions are selected in the first configurations, which have about this number of records; the coefficients
# are estimated in all configurations.
_CHOICE_RECORDS = 24
# Least motion between two reversals over the presliding distance with which F_c is identifiable, and least std over F_c
# for a note otherwise.
FULL_SWING, MIN_UNCERTAIN = 4.0, 0.05
# False-alarm rate of a difference between configurations in one coefficient, for normal coefficients.
DEPENDENCE_BY_CHANCE = 1e-5


class _UnsuitedRecords(ValueError):
    """Reason why friction is not identifiable from the records."""


def identify_motor_friction(
    measured: Sequence[Iterable[Record]], spec: EstimatorSpec, planned: IntArray | None = None,
    execution: Execution | None = None
) -> CompensatedFriction:  # fmt: skip
    """Estimate the motor friction from the records of all configurations; each record is read several times.

    Basis functions are selected along the motion of the samples.  If the motion between the samples changes the
    coefficients, it is used to estimate them.  If friction is not identifiable, nothing is compensated and a note
    states the reason.  execution: of the configurations; it does not change the result; its checkpoint then has their
    spectra along the motion of the samples, if these were used.  Raises DataError and StudyError as `estimate` does.
    """
    records = tuple(measured[0])
    try:
        return _identify(records, measured, spec, planned, execution or Execution())
    except _UnsuitedRecords as reason:
        is_quiet = spec.friction == "auto" and not any(location.startswith("motor ") for location in records[0].inputs)
        return _no_friction(records[0], "" if is_quiet else str(reason), spec.friction)


def _identify(
    records: tuple[Record, ...], measured: Sequence[Iterable[Record]], spec: EstimatorSpec, planned: IntArray | None,
    execution: Execution,
) -> CompensatedFriction:  # fmt: skip
    n_first, locations = -(-_CHOICE_RECORDS // len(records)), records[0].inputs

    def gather(
        chosen: Sequence[Iterable[Record]], shapes: Sequence[BasisFunction], friction: CompensatedFriction | None = None
    ) -> list[ConfigurationSpectra]:
        return execution.ordered(partial(_gather, locations, shapes, spec, planned, friction), chosen)

    if reason := refusal(records):
        raise _UnsuitedRecords(reason)
    check_consistency(records)
    shapes = candidate_basis(records, spec.friction == "coulomb")
    data = gather(measured[:n_first], shapes)
    choice, indices = select_basis(data, shapes, locations, spec.friction == "auto")
    if delay_s := torque_delay(data, shapes, choice, locations):
        late, late_shapes = delay_spectra(data, delay_s), tuple(replace(shape, delay_s=delay_s) for shape in shapes)
        late_choice, late_indices = select_basis(late, late_shapes, locations, spec.friction == "auto")
        # Bristles with large damping act before their deflection, as if the torque were logged early.
        if delay_s > 0 or any(shape.is_memoryless for shape in late_choice.shapes):
            data, shapes, choice, indices = late, late_shapes, late_choice, late_indices
    basis_spectra = [replace(spectra, Phi=spectra.Phi[:, indices]) for spectra in data]
    swings = tuple(median_swing([motion_of(record, motor) for record in records]) for motor in locations)
    first, friction = _FrictionFit(records[0], spec, basis_spectra, choice, swings), None
    if choice.shapes:
        noise = np.sqrt(np.mean([spectra.velocity_noise**2 for spectra in basis_spectra], axis=0))
        refined = refine_basis(choice, first.sums[0], locations, noise)
        between = replace(first, choice=refined, data=gather(measured[:n_first], refined.shapes, first.result))
        pairs = [[fit.result.coulomb_friction(motor)[0] for fit in (between, first)] for motor in locations]
        # With many configurations the motion between the samples is used only if it changes F_c by more than its error.
        is_equal = all(abs(coefficient - sampled) <= SIGN_ERROR * coefficient for coefficient, sampled in pairs)
        if n_first >= len(measured) or not is_equal:
            first, friction = between, first.result
    first = replace(first, data=[*first.data, *gather(measured[n_first:], first.choice.shapes, friction)])
    if friction is None:
        execution.checkpoint.update((spectra.name, spectra) for spectra in first.data)
    return first.with_dependence() if choice.shapes else first.result


def _gather(
    inputs: tuple[str, ...], shapes: Sequence[BasisFunction], spec: EstimatorSpec, planned: IntArray | None,
    friction: CompensatedFriction | None, measured: Iterable[Record],
) -> ConfigurationSpectra:  # fmt: skip
    """Return the spectra of one configuration; raise _UnsuitedRecords if they do not determine the friction."""
    records = tuple(measured)
    check_consistency(records)
    if reason := refusal(records):
        raise _UnsuitedRecords(reason)
    if records[0].inputs != inputs:
        raise _UnsuitedRecords("configurations have different inputs, and so no motors in common")
    data = gather_configuration(records, shapes, spec, planned, friction)
    if not data.is_invertible:
        raise _UnsuitedRecords(
            f"the torques of {', '.join(inputs)}, or the angles of these motors, are not independent in all "
            f"{len(records)} experiments of configuration {data.name}; check for a file listed twice and for a channel "
            "that holds the signal of another motor"
        )
    if data.U.shape[2] <= data.U.shape[1] and data.excited.all():
        raise _UnsuitedRecords(
            f"one realisation ({len(records)} experiment{'s' * (len(records) > 1)}) does not separate nonlinear "
            "distortion from the linear response"
        )
    return data


@dataclass(frozen=True)
class _FrictionFit:
    """Friction fit with the selected basis functions in some configurations; first: any record of them."""

    first: Record
    spec: EstimatorSpec
    data: Sequence[ConfigurationSpectra]
    choice: Basis
    swings: tuple[float, ...] = ()

    @cached_property
    def sums(self) -> tuple[FloatArray, NormalEquations]:
        """Coefficients (n_f,), and the normal equations about them."""
        return estimate_coefficients(self.data, self.choice.motor_of)

    @cached_property
    def result(self) -> CompensatedFriction:
        """Result with a note on each motor."""
        (coefficients, equations), first, choice = self.sums, self.first, self.choice
        ratio = residual_power_ratios(equations, len(first.inputs), choice.motor_of)
        is_compensated = np.isin(np.arange(len(first.inputs)), choice.motor_of)
        result = CompensatedFriction(
            places=first.inputs,
            place_units=first.units_of_inputs,
            shapes=choice.shapes,
            coulomb_torque=coefficients,
            covariance=0.5 * inverse(equations.A.sum(axis=0) * equations.dof_fraction)
            + basis_error_covariance(choice, coefficients),
            configurations=tuple(spectra.name for spectra in self.data),
            before=normal_equations(self.data, 0 * coefficients, choice.motor_of).amplitude,
            after=equations.amplitude,
            residual_power_ratio=np.where(is_compensated, ratio, choice.residual_power_ratio),
            accelerance=self._accelerance(),
            swings=self.swings,
        )
        return replace(result, notes=_notes(result))

    def _accelerance(self) -> FloatArray:
        """Return acceleration per torque (n_m,) of motors at the highest excited lines."""
        accelerances, order = [], 2 - MOTION_ORDER[self.spec.quantity]
        for data in self.data:
            excited = np.flatnonzero(data.excited)
            top = excited[-max(1, len(excited) // 20) :]
            friction = compensation_torque(self.sums[0], data.Phi[top], self.choice.motor_of, data.U.shape[1])
            G = data.Y[top] @ np.linalg.pinv(data.U[top] - friction)
            s = laplace_variable(data.freq_hz[top, None])
            accelerances.append((np.diagonal(G, axis1=1, axis2=2) * np.exp(self.choice.delay_s * s) * s**order).real)
        return np.maximum(np.median(np.concatenate(accelerances), axis=0), 0.0)

    def with_dependence(self) -> CompensatedFriction:
        """Return the result with the variance tau^2 between configurations in its covariance, where it is significant.

        A factor a_c scales the friction of a motor in configuration c, e = a_c X f, with variance s_c^2 by noise:
        tau^2 = (Q - C + 1) / (sum w - sum w^2 / sum w), Q = sum w (a_c - a)^2, w = 1 / s_c^2.  No average reduces
        tau^2, because another configuration is one more sample. (DerSimonian and Laird, Controlled Clinical Trials 7,
        1986.)
        """
        result, motor_of, n = self.result, self.choice.motor_of, len(self.data)
        C, notes = result.covariance.copy(), list[Note]()
        sums = [normal_equations([spectra], self.sums[0], motor_of) for spectra in self.data]
        for i, location in enumerate(result.places):
            f = np.where(motor_of == i, self.sums[0], 0.0)
            power = np.array([max(f @ fold.A.sum(axis=0) @ f, 1e-300) for fold in sums])
            factor = np.array([f @ fold.b.sum(axis=0) for fold in sums]) / power
            weight = 2 * power * [fold.dof_fraction for fold in sums]
            Q = float(weight @ (factor - weight @ factor / weight.sum()) ** 2)
            if n > 1 and f.any() and chi_square_limit(n - 1, DEPENDENCE_BY_CHANCE) < Q:
                C += (Q - n + 1) / (weight.sum() - weight @ weight / weight.sum()) * np.outer(f, f)
                F_c, low, high = result.coulomb_friction(location)[0], int(np.argmin(factor)), int(np.argmax(factor))
                text = (
                    f"{location}: friction varies from {F_c * factor[low]:.4g} {result.place_units[i]} in "
                    f"{result.configurations[low]} to {F_c * factor[high]:.4g} in {result.configurations[high]}. To "
                    "find whether angle, temperature or load is the cause, run a friction study with `loads`"
                )
                notes.append(Note("nonlinear/friction-varies", text))
        result = replace(result, covariance=C)
        return replace(result, notes=(*_notes(result), *notes))


def _notes(result: CompensatedFriction) -> tuple[Note, ...]:
    """Return a note for each motor, and one of the delay; its text names the motor, so that notes are not grouped."""
    notes = []
    if delay_ms := 1e3 * next((shape.delay_s for shape in result.shapes), 0.0):
        text = (
            f"friction acts {delay_ms:+.3g} ms after the motions and is compensated with this delay: the torques are "
            f"late or early. State `delay: {delay_ms:.3g} ms` at the channels of role u, or free `delay_u` in the fit"
        )
        notes.append(Note("nonlinear/torque-delay", text, severity="warning"))
    for motor, unit, percent in zip(result.places, result.place_units, 100 * result.residual_power_ratio, strict=True):
        if motor in result.compensated_motors():
            F_c, std = result.coulomb_friction(motor)
            text = (
                f"{motor}: Coulomb friction of {F_c:.4g} {unit} (std {std:.2g}, link side) is compensated. The power "
                f"of noise and distortion decreases to {percent:.2g} % of its value without compensation"
            )
            notes.append(Note("nonlinear/friction-compensated", text, severity="information"))
            ratio = result.swing_ratio(motor)
            if std > MIN_UNCERTAIN * F_c and ratio < FULL_SWING:
                text = (
                    f"{motor}: the Coulomb torque is {F_c:.3g} {unit} (std {std:.2g}). The motion between two "
                    f"reversals is {ratio:.2g} of the presliding distance (limit {FULL_SWING:g}). Raise the amplitude"
                )
                notes.append(Note("nonlinear/presliding", text, severity="information"))
        else:
            text = (
                f"{motor}: Coulomb friction is not significant and not compensated. In cross-validation, "
                f"{percent:.3g} % of the power of noise and distortion remains with compensation"
            )
            notes.append(Note("nonlinear/friction-not-compensated", text, severity="information"))
    return tuple(notes)


def _no_friction(first: Record, reason: str, friction: Friction) -> CompensatedFriction:
    """Return a result without compensation; its reason is a warning if the study requests a kind of friction."""
    n_m, text = len(first.inputs), f"Coulomb friction is not compensated: {reason}"
    severity: Severity = "information" if friction == "auto" else "warning"
    empty = np.zeros((0, n_m))
    note = Note("nonlinear/friction-not-compensated", text, severity=severity)
    return CompensatedFriction(
        first.inputs, first.units_of_inputs, shapes=(), coulomb_torque=np.zeros(0), covariance=np.zeros((0, 0)),
        configurations=(), before=empty, after=empty, residual_power_ratio=np.ones(n_m), accelerance=np.zeros(n_m),
        notes=(note,) if reason else (),
    )  # fmt: skip


def refusal(records: Sequence[Record]) -> str:
    """Return the reason why friction is not identifiable from the records of a configuration, or ""."""
    first = records[0]
    if reason := unsuited_reason(first):
        return reason
    equal = np.zeros(len(first.inputs)) if first.r is None else np.all(first.u == first.r, axis=0)
    if motors := [motor for motor, is_equal in zip(first.inputs, equal, strict=True) if is_equal]:
        return (
            f"the torque of {', '.join(motors)} equals the reference to the last bit, so it does not contain the "
            "controller's reaction to friction. Log the torque or current that the drive receives"
        )
    if any(RecordSpectra(record).is_large for record in records):
        return "the records are too large to be processed in one piece. Remove periods, or lower their rate"
    n_u, K = len(first.inputs), len(records)
    if n_u > K:
        return f"{K} experiments do not separate {n_u} inputs. Measure at least {n_u}"
    for motor in first.inputs:
        motion = motion_of(first, motor)
        if motion.velocity_noise > VELOCITY_NOISE * motion.speed:
            return (
                f"the velocity of {motor} is {motion.speed:.2g} RMS and its noise {motion.velocity_noise:.2g}, so its "
                "sign is unknown. Use an encoder with a finer resolution, or excite slower or larger motions"
            )
    return ""
