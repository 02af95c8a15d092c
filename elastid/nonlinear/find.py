"""Friction at the motors, from the records of all configurations of a measurement."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial

import numpy as np

from elastid.base.arrays import FloatArray, IntArray
from elastid.base.errors import Note, Severity
from elastid.base.execution import Execution
from elastid.base.statistics import chi_square_limit
from elastid.frf.checks import refuse_mismatch
from elastid.frf.spec import EstimatorSpec, Friction
from elastid.frf.spectra import RecordSpectra
from elastid.nonlinear.choice import (
    LIMITS,
    Choice,
    by_unknown_shapes,
    candidate_shapes,
    choose,
    narrowed,
    refined,
    shares,
)
from elastid.nonlinear.levels import (
    NormalEquations,
    covariance,
    find_levels,
    levels_by_configuration,
    normal_equations,
)
from elastid.nonlinear.motion import motion_of
from elastid.nonlinear.result import FrictionTakenOut
from elastid.nonlinear.shapes import Shape
from elastid.nonlinear.spectra import ConfigurationSpectra, gather_configuration, taken, unsuited
from elastid.record import MOTION_ORDER, Record
from elastid.record import Motion as Quantity

VELOCITY_NOISE = 0.04  # over the RMS of a velocity, above which its sign is noise
# Shapes are chosen in the first configurations, of so many records if all have as many as the first; levels are found
# in all.
_CHOICE_RECORDS = 24


def find_friction(
    measured: Sequence[Iterable[Record]],
    spec: EstimatorSpec,
    planned: IntArray | None = None,
    execution: Execution | None = None,
) -> FrictionTakenOut:
    """Friction in the records of all configurations, each of which is gone through, or read, several times.

    Shapes are chosen along the motion that samples show; levels are found along that between the samples, too, where it
    moves them. Where friction cannot be found nothing is taken out, and a note says why.  execution: of the
    configurations; the result does not depend on it.
    Raises DataError and StudyError as `estimate` does.
    """
    execution = execution or Execution()
    survey = _survey(measured, spec, planned, execution)
    if isinstance(survey, FrictionTakenOut):
        return survey
    gather = partial(gather_configuration, spec=spec, planned=planned)
    found = _along_samples(survey, spec)
    if not survey.choice.shapes:
        return found.result
    few = _few(survey.data[0].U.shape[2])
    if few >= len(measured) or not _is_near(few, survey, spec, gather, measured, execution):
        found = _along_its_motion(found, survey, spec, gather, measured, execution)
    return _with_dependence(found.result, found.data, found.choice.motor_of)


def _is_near(
    few: int,
    survey: _Survey,
    spec: EstimatorSpec,
    gather: Callable[..., ConfigurationSpectra],
    measured: Sequence[Iterable[Record]],
    execution: Execution,
) -> bool:
    """True if in the first configurations F_c by the samples' motion is that between them, to what shapes are known."""
    part = replace(survey, data=survey.data[:few], names=survey.names[:few])
    sampled = _along_samples(part, spec)
    between = _along_its_motion(sampled, part, spec, gather, measured[:few], execution)
    pairs = [[found.result.sliding_level(place)[0] for found in (between, sampled)] for place in sampled.result.places]
    return all(abs(level - other) <= LIMITS.sign_error * level for level, other in pairs)


def _few(records: int) -> int:
    """Configurations, of so many records, in which shapes are chosen."""
    return -(-_CHOICE_RECORDS // records)


def _along_samples(survey: _Survey, spec: EstimatorSpec) -> _Found:
    """Friction along the motion that the samples show."""
    levels, equations = find_levels(survey.data, survey.choice.motor_of)
    accelerance = upper_accelerance(survey.data, levels, survey.choice.motor_of, spec.quantity)
    result = _result(survey, survey.choice, levels, accelerance, equations)
    return _Found(result, survey.choice, levels, survey.data)


@dataclass(frozen=True)
class _Found:
    """Friction with the choice of its shapes, their levels (n_f,), and the spectra that these were found in."""

    result: FrictionTakenOut
    choice: Choice
    levels: FloatArray
    data: Sequence[ConfigurationSpectra]


def _along_its_motion(
    found: _Found,
    survey: _Survey,
    spec: EstimatorSpec,
    gather: Callable[..., ConfigurationSpectra],
    measured: Sequence[Iterable[Record]],
    execution: Execution,
) -> _Found:
    """Friction along the motion under friction as it was found before; without the notes on its dependence.

    gather: `gather_configuration`, of each configuration.
    """
    choice = refined(found.choice, found.levels, survey.first.inputs)
    data = execution.ordered(partial(gather, shapes=choice.shapes, friction=found.result), measured)
    levels, _ = find_levels(data, choice.motor_of)
    noise = np.sqrt(np.mean([spectra.velocity_noise**2 for spectra in data], axis=0))
    choice, kept = narrowed(choice, levels, noise)
    data = [spectra.with_shapes(kept) for spectra in data]
    levels, equations = find_levels(data, choice.motor_of)
    accelerance = upper_accelerance(data, levels, choice.motor_of, spec.quantity)
    accelerance = np.where(accelerance > 0, accelerance, found.result.accelerance)
    return _Found(_result(survey, choice, levels, accelerance, equations), choice, levels, data)


def upper_accelerance(
    data: Sequence[ConfigurationSpectra], levels: FloatArray, motor_of: IntArray, quantity: Quantity
) -> FloatArray:
    """Acceleration per torque (n_m,) of motors at the highest excited lines, friction being `levels`."""
    tops = []
    for configuration in data:
        on = np.flatnonzero(configuration.excited)
        on = on[-max(1, len(on) // 20) :]
        friction = taken(levels, configuration.Phi[on], motor_of, configuration.U.shape[1])
        G = configuration.Y[on] @ np.linalg.pinv(configuration.U[on] - friction)
        s = 2j * np.pi * configuration.freq_hz[on]
        tops.append((np.diagonal(G, axis1=1, axis2=2) * s[:, None] ** (2 - MOTION_ORDER[quantity])).real)
    return np.asarray(np.maximum(np.median(np.concatenate(tops), axis=0), 0.0))


@dataclass(frozen=True)
class _Survey:
    """Choice by the sampled motion: spectra of each configuration and the shapes that were chosen.

    first: a record.
    """

    first: Record
    names: tuple[str, ...]
    data: Sequence[ConfigurationSpectra]
    choice: Choice

    @cached_property
    def before(self) -> FloatArray:
        """Amplitude (C, n_m) of the torque that no response explains, with friction in it."""
        return normal_equations(self.data, np.zeros(len(self.choice.shapes)), self.choice.motor_of).level


@dataclass(frozen=True)
class _Configuration:
    """One configuration by its sampled motion; refusal: why friction cannot be found in it, empty where it can."""

    name: str
    refusal: str
    data: ConfigurationSpectra | None = None


def _survey(
    measured: Sequence[Iterable[Record]], spec: EstimatorSpec, planned: IntArray | None, execution: Execution
) -> _Survey | FrictionTakenOut:
    """The shapes of friction of all configurations; or no friction, with the reason."""
    records = tuple(measured[0])
    first = records[0]
    refuse_mismatch(records)
    if refused := refusal(records):
        of_motors = any(place.startswith("motor ") for place in first.inputs)
        return _nothing(first, refused if of_motors or spec.friction != "auto" else "", spec.friction)
    shapes = candidate_shapes(records, spec.friction == "coulomb")
    few = _few(len(records))
    surveyed = execution.ordered(partial(_surveyed, shapes, first.inputs, spec, planned), measured[:few])
    if refused := next(filter(None, (configuration.refusal for configuration in surveyed)), ""):
        return _nothing(first, refused, spec.friction)
    spectra = [configuration.data for configuration in surveyed if configuration.data is not None]
    choice, picked = choose(spectra, shapes, first.inputs, spec.friction == "auto")
    data = [configuration.with_shapes(picked) for configuration in spectra]
    later = execution.ordered(partial(_surveyed, choice.shapes, first.inputs, spec, planned), measured[few:])
    if refused := next(filter(None, (configuration.refusal for configuration in later)), ""):
        return _nothing(first, refused, spec.friction)
    data += [configuration.data for configuration in later if configuration.data is not None]
    names = tuple(configuration.name for configuration in (*surveyed, *later))
    return _Survey(first, names, data, choice)


def _surveyed(
    shapes: Sequence[Shape],
    inputs: tuple[str, ...],
    spec: EstimatorSpec,
    planned: IntArray | None,
    measured: Iterable[Record],
) -> _Configuration:
    """A configuration whose records must have the inputs of the first one."""
    records = tuple(measured)
    refuse_mismatch(records)
    name, refused = records[0].configuration.name, refusal(records)
    if not refused and records[0].inputs != inputs:
        refused = "configurations have different inputs, and so no motors in common"
    if refused:
        return _Configuration(name, refused)
    data = gather_configuration(records, shapes, spec, planned)
    if not data.is_invertible:
        refused = (
            f"the torques of {', '.join(inputs)}, or the angles of these motors, are not independent in all "
            f"{len(records)} experiments of configuration {name}; check for a file listed twice and for a channel that "
            "holds the signal of another motor"
        )
        return _Configuration(name, refused)
    if not data.shows_friction:
        refused = (
            f"{len(records)} experiments of {len(inputs)} inputs without lines that are not excited agree with one "
            "response whatever friction is; measure a further realisation with other phases"
        )
    return _Configuration(name, refused, data)


def _result(
    survey: _Survey,
    choice: Choice,
    levels: FloatArray,
    accelerance: FloatArray,
    equations: NormalEquations,
) -> FrictionTakenOut:
    first = survey.first
    left = shares(equations, len(first.inputs), choice.motor_of)
    result = FrictionTakenOut(
        places=first.inputs,
        place_units=first.units_of_inputs,
        shapes=choice.shapes,
        levels=levels,
        covariance=covariance(equations) + by_unknown_shapes(choice, levels),
        configurations=survey.names,
        before=survey.before,
        after=equations.level,
        kept_share=np.where(np.isin(np.arange(len(first.inputs)), choice.motor_of), left, choice.kept_share),
        accelerance=accelerance,
        highest_hz=np.array([spectra.freq_hz[spectra.excited][-1] for spectra in survey.data]),
    )
    return replace(result, notes=_notes(result))


def _notes(result: FrictionTakenOut) -> tuple[Note, ...]:
    """One for each motor; the place is in the text, so that notes of several motors are not grouped into one."""
    notes = []
    for place, unit, share in zip(result.places, result.place_units, 100 * result.kept_share, strict=True):
        if place in result.taken_places():
            level, std = result.sliding_level(place)
            text = (
                f"{place}: friction of {level:.4g} +- {std:.2g} {unit} in sliding "
                "(link side, at the loads and temperatures of these records) was found in them and taken out of the "
                f"torque; {share:.2g} % of the power of distortion and noise is left"
            )
            notes.append(Note("nonlinear/friction-taken-out", text, severity="information"))
        else:
            text = (
                f"{place}: no friction was taken out of the torque, since levels found in some realisations leave "
                f"{share:.3g} % of the power of distortion and noise in the others; it may be small, or no friction "
                "of this motor"
            )
            notes.append(Note("nonlinear/friction-left", text, severity="information"))
    return tuple(notes)


def _with_dependence(
    result: FrictionTakenOut, data: Sequence[ConfigurationSpectra], motor_of: IntArray
) -> FrictionTakenOut:
    """The same with levels that are uncertain by their scatter over configurations, where it is more than chance's.

    The scatter tau of the factors a_c between configurations counts whole, since a level of another posture is one
    more draw of it: tau^2 = (Q - C + 1) / (sum w - sum w^2 / sum w), Q = sum w (a_c - a)^2, w = 1 / s_c^2.
    (DerSimonian and Laird, Controlled Clinical Trials 7, 1986.)
    """
    factors, stds = levels_by_configuration(data, result.levels, motor_of)
    C = result.covariance.copy()
    notes = list[Note]()
    for i, place in enumerate(result.places):
        if len(data) < 2 or place not in result.taken_places():
            continue
        factor, weight = factors[:, i], stds[:, i] ** -2
        Q = float(weight @ (factor - weight @ factor / weight.sum()) ** 2)
        if chi_square_limit(len(data) - 1, LIMITS.dependence_by_chance) < Q:
            own = np.where(motor_of == i, result.levels, 0.0)
            C += (Q - len(data) + 1) / (weight.sum() - weight @ weight / weight.sum()) * np.outer(own, own)
            level, low, high = result.sliding_level(place)[0], int(np.argmin(factor)), int(np.argmax(factor))
            text = (
                f"{place}: friction is {level * factor[high]:.4g} {result.place_units[i]} in "
                f"{result.configurations[high]} and {level * factor[low]:.4g} in {result.configurations[low]}, and "
                f"{level:.4g} was taken out of all: it depends on the angle, the temperature or the gear's load, and "
                "this level holds for these postures alone; a study of friction with `loads` says on which"
            )
            notes.append(Note("nonlinear/friction-differs", text))
    result = replace(result, covariance=C)
    return replace(result, notes=(*_notes(result), *notes))


def _nothing(first: Record, why: str, wanted: Friction) -> FrictionTakenOut:
    """No friction; the reason, where it is not empty, is a warning if the study asks for friction by name."""
    n_m = len(first.inputs)
    severity: Severity = "information" if wanted == "auto" else "warning"
    note = Note("nonlinear/friction-left", f"friction is not taken out of the torque: {why}", severity=severity)
    return FrictionTakenOut(
        places=first.inputs,
        place_units=first.units_of_inputs,
        shapes=(),
        levels=np.zeros(0),
        covariance=np.zeros((0, 0)),
        configurations=(),
        before=np.zeros((0, n_m)),
        after=np.zeros((0, n_m)),
        kept_share=np.ones(n_m),
        accelerance=np.zeros(n_m),
        highest_hz=np.zeros(0),
        notes=(note,) if why else (),
    )


def refusal(records: Sequence[Record]) -> str:
    """Why friction cannot be found in the records of a configuration; empty where it can."""
    first = records[0]
    if reason := unsuited(first):
        return reason
    equal = np.zeros(len(first.inputs)) if first.r is None else np.all(first.u == first.r, axis=0)
    if same := [place for place, is_equal in zip(first.inputs, equal, strict=True) if is_equal]:
        return (
            f"the torque of {', '.join(same)} equals the reference to the last bit, so that the controller's part "
            "against friction is not in it and friction cannot be found; log the torque, or the current, that the "
            "drive is given"
        )
    if any(RecordSpectra(record).is_large for record in records):
        return "the records are worked on in pieces, since they are large; leave periods out, or lower their rate"
    n_u, K = len(first.inputs), len(records)
    if n_u > K:
        return f"{K} experiments do not separate {n_u} inputs; measure more, since friction is what responses leave"
    for place in first.inputs:
        motion = motion_of(first, place)
        if motion.velocity_noise > VELOCITY_NOISE * motion.speed:
            return (
                f"the velocity of {place} is {motion.speed:.2g} RMS and its noise {motion.velocity_noise:.2g}, so that "
                "its sign is not known; use an encoder of more counts, or excite slower or larger motions"
            )
    return ""
