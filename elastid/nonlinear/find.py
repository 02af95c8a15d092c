"""Friction at the motors, from the records of all configurations of a measurement."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from elastid.base.arrays import ComplexArray, FloatArray, IntArray
from elastid.base.execution import Execution
from elastid.base.note import Note, Severity
from elastid.frf.checks import refuse_mismatch
from elastid.frf.spec import EstimatorSpec, Friction
from elastid.nonlinear.choice import Choice, Kept, candidate_shapes, choose, refined, shares
from elastid.nonlinear.levels import NormalEquations, covariance, find_levels, normal_equations
from elastid.nonlinear.places import limits_of, refusal
from elastid.nonlinear.reconstruct import with_inertial_accelerance
from elastid.nonlinear.result import FrictionTakenOut
from elastid.nonlinear.shapes import Shape
from elastid.nonlinear.spectra import ConfigurationSpectra, gather_configuration, taken
from elastid.record import MOTION_ORDER, Record
from elastid.record import Motion as Quantity

# The highest of the excited lines, where a motor moves as an inertia.
_HIGHEST = 1 / 8


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

    Shapes are chosen along the motion that samples show, levels are found along that between the samples. Where it
    cannot be found nothing is taken out, and a note says why.  execution: of the configurations; the result does not
    depend on it.
    Raises DataError and StudyError as `estimate` does.
    """
    execution = execution or Execution()
    look = _first_look(measured, spec, planned, execution)
    if isinstance(look, FrictionTakenOut):
        return look
    raw = normal_equations(look.data, np.zeros(len(look.choice.shapes)), look.choice.motor_of)
    levels, found = find_levels(look.data, look.choice.motor_of, look.choice.taken)
    frictions = [taken(levels, each.Phi, look.choice.motor_of, len(look.first.inputs)) for each in look.data]
    accelerance = accelerance_of_lines(look.data, frictions, spec.quantity)
    result = _result(look, look.choice, levels, accelerance, raw, found)
    result = with_inertial_accelerance(result, look.last, look.highest_hz, execution)
    if len(look.choice.taken):
        choice = refined(look.choice, levels, look.first.inputs)
        data = execution.ordered(partial(_gathered, choice.shapes, spec, planned, result), measured)
        levels, found = find_levels(data, choice.motor_of, choice.taken)
        result = _result(look, choice, levels, result.accelerance, raw, found)
        result = with_inertial_accelerance(result, look.last, look.highest_hz, execution)
    return replace(result, notes=(*result.notes, *look.limits))


@dataclass(frozen=True)
class _Look:
    """Choice by the motion that samples show: spectra of each configuration and the shapes that were chosen.

    first: a record.  last: those of the last configuration.  limits: notes of what cannot be distinguished.
    """

    first: Record
    last: Sequence[Record]
    names: tuple[str, ...]
    data: Sequence[ConfigurationSpectra]
    choice: Choice
    limits: tuple[Note, ...]

    @property
    def highest_hz(self) -> float:
        """The highest excited line."""
        return float(self.data[-1].freq_hz[self.data[-1].excited][-1])


@dataclass(frozen=True)
class _Seen:
    """One configuration as its samples show it.

    refusal: why friction cannot be found in it, and data None; empty where it can.
    limits: what cannot be distinguished.
    """

    name: str
    refusal: str
    limits: tuple[Note, ...] = ()
    data: ConfigurationSpectra | None = None


def _first_look(
    measured: Sequence[Iterable[Record]], spec: EstimatorSpec, planned: IntArray | None, execution: Execution
) -> _Look | FrictionTakenOut:
    """The shapes of friction of all configurations; or no friction, with the reason."""
    records = tuple(measured[0])
    first = records[0]
    refuse_mismatch(records)
    if refused := refusal(records):
        of_motors = any(place.startswith("motor ") for place in first.inputs)
        return _nothing(first, refused if of_motors or spec.friction != "auto" else "", spec.friction)
    shapes = candidate_shapes(records, spec.friction == "coulomb")
    few = -(-_CHOICE_RECORDS // len(records))
    seen = execution.ordered(partial(_seen, shapes, first.inputs, spec, planned), measured[:few])
    if refused := _refused(seen):
        return _nothing(first, refused, spec.friction)
    choice, kept, data = _chosen([each.data for each in seen if each.data is not None], shapes, first, spec)
    shapes = tuple(shapes[i] for i in kept.candidates)
    later = execution.ordered(partial(_seen, shapes, first.inputs, spec, planned), measured[few:])
    if refused := _refused(later):
        return _nothing(first, refused, spec.friction)
    every = np.arange(len(shapes))
    data += [each.data.with_shapes(every, kept.rates) for each in later if each.data is not None]
    names = tuple(each.name for each in (*seen, *later))
    limits = {note.text: note for each in (*seen, *later) for note in each.limits}
    return _Look(first, tuple(measured[-1]), names, data, choice, tuple(limits.values()))


def _seen(
    shapes: Sequence[Shape],
    inputs: tuple[str, ...],
    spec: EstimatorSpec,
    planned: IntArray | None,
    measured: Iterable[Record],
) -> _Seen:
    """A configuration whose records must have the inputs of the first one."""
    records = tuple(measured)
    refuse_mismatch(records)
    name, refused = records[0].configuration.name, refusal(records)
    if not refused and records[0].inputs != inputs:
        refused = "configurations have different inputs, and so no motors in common"
    if refused:
        return _Seen(name, refused)
    data = gather_configuration(records, shapes, spec, planned)
    if not data.is_invertible:
        return _Seen(name, _dependent(records))
    return _Seen(name, "" if data.shows_friction else _one_response(records), limits_of(records), data)


def _refused(seen: Sequence[_Seen]) -> str:
    """Why friction cannot be found in the first configuration of which that is so."""
    return next((each.refusal for each in seen if each.refusal), "")


def _gathered(
    shapes: Sequence[Shape],
    spec: EstimatorSpec,
    planned: IntArray | None,
    friction: FrictionTakenOut,
    measured: Iterable[Record],
) -> ConfigurationSpectra:
    """The spectra of a configuration along its motion under the friction that was found."""
    return gather_configuration(tuple(measured), shapes, spec, planned, friction)


def _chosen(
    data: Sequence[ConfigurationSpectra], candidates: Sequence[Shape], first: Record, spec: EstimatorSpec
) -> tuple[Choice, Kept, list[ConfigurationSpectra]]:
    """The choice of shapes, and the spectra of these alone."""
    choice, kept = choose(data, candidates, first.inputs, spec.friction == "auto")
    return choice, kept, [each.with_shapes(kept.candidates, kept.rates) for each in data]


def _dependent(records: Sequence[Record]) -> str:
    return (
        f"the torques of {', '.join(records[0].inputs)}, or the angles of these motors, are not independent in all "
        f"{len(records)} experiments of configuration {records[0].configuration.name}; check for a file listed twice "
        "and for a channel that holds the signal of another motor"
    )


def _one_response(records: Sequence[Record]) -> str:
    return (
        f"{len(records)} experiments of {len(records[0].inputs)} inputs without lines that are not excited agree with "
        "one response whatever friction is; measure a further realisation with other phases"
    )


def _result(
    look: _Look,
    choice: Choice,
    levels: FloatArray,
    accelerance: FloatArray,
    raw: NormalEquations,
    found: NormalEquations,
) -> FrictionTakenOut:
    first = look.first
    left = shares(found, len(first.inputs), choice.motor_of, choice.taken)
    result = FrictionTakenOut(
        places=first.inputs,
        place_units=first.units_of_inputs,
        shapes=choice.shapes,
        levels=levels,
        covariance=covariance(found, choice.taken) + choice.covariance,
        configurations=look.names,
        before=raw.level,
        after=found.level,
        kept_share=np.array(
            [left[i] if i in choice.motor_of else choice.kept_share[i] for i in range(len(first.inputs))]
        ),
        accelerance=accelerance,
    )
    return replace(result, notes=_notes(result))


def _notes(result: FrictionTakenOut) -> tuple[Note, ...]:
    """One for each motor; the place is in the text, so that notes of several motors are not grouped into one."""
    notes = []
    for place, unit, share in zip(result.places, result.place_units, 100 * result.kept_share, strict=True):
        if place in result.taken_places():
            level, std = result.sliding_level(place)
            text = (
                f"{place}: friction of {level:.4g} +- {std:.2g} {unit} in sliding (link side) was found in the records "
                f"and taken out of the torque; {share:.2g} % of the power of distortion and noise is left"
            )
            notes.append(Note("friction-taken-out", text, severity="information"))
        else:
            text = (
                f"{place}: no friction was taken out of the torque, since levels found in some realisations leave "
                f"{share:.3g} % of the power of distortion and noise in the others; it may be small, or no friction "
                "of this motor"
            )
            notes.append(Note("friction-left", text, severity="information"))
    return tuple(notes)


def _nothing(first: Record, why: str, wanted: Friction) -> FrictionTakenOut:
    """No friction, with the reason: a warning where the study asks for it by name.

    It goes without saying where no motor moves the structure.
    """
    n_m = len(first.inputs)
    severity: Severity = "information" if wanted == "auto" else "warning"
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
        notes=(Note("friction-left", f"friction is not taken out of the torque: {why}", severity=severity),)
        if why
        else (),
    )


def accelerance_of_lines(
    data: Sequence[ConfigurationSpectra], frictions: Sequence[ComplexArray], quantity: Quantity
) -> FloatArray:
    """Acceleration per torque (n_m,) of each motor at the highest excited lines; never negative.

    frictions: torques (F, n_m, K) that are taken out of each configuration.
    """
    found = []
    for each, friction in zip(data, frictions, strict=True):
        on = np.flatnonzero(each.excited)[-max(1, int(_HIGHEST * each.excited.sum())) :]
        G = each.Y[on] @ np.linalg.pinv(each.U[on] - friction[on])
        s = 2j * np.pi * each.freq_hz[on, None]
        found.append(np.diagonal(G, axis1=1, axis2=2) * s ** (2 - MOTION_ORDER[quantity]))
    return np.asarray(np.maximum(np.median(np.concatenate(found).real, axis=0), 0.0))
