"""Friction at the motors, from the records of all configurations of a measurement."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace

import numpy as np

from elastid.base.arrays import FloatArray, IntArray
from elastid.base.note import Note, Severity
from elastid.frf.checks.records import refuse_mismatch
from elastid.frf.friction.accelerance import accelerance_of_lines, with_inertial_accelerance
from elastid.frf.friction.candidates import candidate_shapes, refusal
from elastid.frf.friction.choice import Choice, choose
from elastid.frf.friction.levels import NormalEquations, covariance, find_levels, normal_equations
from elastid.frf.friction.limits import limits_of
from elastid.frf.friction.result import FrictionTakenOut
from elastid.frf.friction.selection import shares
from elastid.frf.friction.shapes import Shape
from elastid.frf.friction.spectra import ConfigurationSpectra, gather_configuration, taken
from elastid.frf.spec import EstimatorSpec, Friction
from elastid.record import Record

# Shapes are chosen in the first configurations, so many records of them; levels are found in all.
_CHOICE_RECORDS = 24


def find_friction(
    measured: Iterable[Sequence[Record]], spec: EstimatorSpec, planned: IntArray | None = None
) -> FrictionTakenOut:
    """Friction in the records of all configurations, which `measured` gives one configuration at a time.

    Where it cannot be found nothing is taken out, and a note says why.
    Raises DataError and StudyError as `estimate` does.
    """
    data: list[ConfigurationSpectra] = []
    names: list[str] = []
    limits: dict[str, Note] = {}
    candidates: tuple[Shape, ...] = ()
    choice: Choice | None = None
    first: Record | None = None
    count = 0
    for records in measured:
        refuse_mismatch(records)
        if refused := refusal(records):
            of_motors = any(place.startswith("motor ") for place in records[0].inputs)
            why = refused if of_motors or spec.friction != "auto" else ""
            return _nothing(first or records[0], why, spec.friction)
        if first is None:
            first, candidates = records[0], candidate_shapes(records, spec.friction == "coulomb")
        if records[0].inputs != first.inputs:
            return _nothing(first, "configurations have different inputs, and so no motors in common", spec.friction)
        names.append(records[0].configuration.name)
        limits |= {note.text: note for note in limits_of(records)}
        data.append(gather_configuration(records, candidates, spec, planned))
        if not data[-1].shows_friction:
            return _nothing(
                first,
                f"{len(records)} experiments of {len(first.inputs)} inputs without lines that are not excited agree "
                "with one response whatever friction is; measure a further realisation with other phases",
                spec.friction,
            )
        if choice is not None:
            data[-1] = data[-1].with_shapes(np.arange(len(candidates)), choice.rates)
        count += len(records)
        if choice is None and count >= _CHOICE_RECORDS:
            choice = choose(data, candidates, first.inputs, spec.friction == "auto")
            data = [each.with_shapes(choice.candidates, choice.rates) for each in data]
            candidates = tuple(candidates[i] for i in choice.candidates)
    assert first is not None
    if choice is None:
        choice = choose(data, candidates, first.inputs, spec.friction == "auto")
        data = [each.with_shapes(choice.candidates, choice.rates) for each in data]
    raw = normal_equations(data, np.zeros(len(choice.shapes)), choice.motor_of)
    levels, found = find_levels(data, choice.motor_of, choice.taken)
    frictions = [taken(levels, each.Phi, choice.motor_of, len(first.inputs)) for each in data]
    accelerance = accelerance_of_lines(data, frictions, spec.quantity)
    result = _result(first, tuple(names), choice, levels, accelerance, raw, found)
    result = with_inertial_accelerance(result, records, float(data[-1].freq_hz[data[-1].excited][-1]))
    return replace(result, notes=(*result.notes, *limits.values()))


def _result(
    first: Record,
    names: tuple[str, ...],
    choice: Choice,
    levels: FloatArray,
    accelerance: FloatArray,
    raw: NormalEquations,
    found: NormalEquations,
) -> FrictionTakenOut:
    left = shares(found, len(first.inputs), choice.motor_of, choice.taken)
    result = FrictionTakenOut(
        places=first.inputs,
        place_units=first.units_of_inputs,
        shapes=choice.shapes,
        levels=levels,
        covariance=covariance(found, choice.taken) + choice.covariance,
        configurations=names,
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
