"""Friction at the motors, from the records of all configurations of a measurement."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np

from elastid.base.arrays import FloatArray, IntArray
from elastid.base.note import Note
from elastid.frf.friction.levels import covariance, find_levels, normal_equations
from elastid.frf.friction.result import FrictionTakenOut
from elastid.frf.friction.selection import MAX_KEPT_SHARE, choose_shapes, shares
from elastid.frf.friction.shapes import Shape, motion_of
from elastid.frf.friction.spectra import ConfigurationSpectra, gather_configuration
from elastid.frf.spec import EstimatorSpec
from elastid.record import Record

# Thresholds of the stop operators over the RMS angle of a motor about its mean. A bristle longer than the motion is a
# spring, which is part of the response.
_THRESHOLDS = (0.05, 0.12, 0.3, 0.75)


def find_friction(
    measured: Iterable[Sequence[Record]], spec: EstimatorSpec, planned: IntArray | None = None
) -> FrictionTakenOut:
    """Friction in the records of all configurations, which `measured` gives one configuration at a time.

    Where it cannot be found nothing is taken out, and a note says why.
    Raises DataError and StudyError as `estimate` does.
    """
    data: list[ConfigurationSpectra] = []
    names: list[str] = []
    candidates: tuple[Shape, ...] = ()
    first: Record | None = None
    for records in measured:
        if first is None:
            first = records[0]
            candidates = candidate_shapes(records, spec.friction == "coulomb")
        if refused := refusal(records):
            return _nothing(first, refused)
        data.append(gather_configuration(records, candidates, spec, planned))
        names.append(records[0].configuration.name)
    assert first is not None
    return _found(first, names, data, candidates, spec.friction == "auto")


def refusal(records: Sequence[Record]) -> str:
    """Why friction cannot be found in the records of a configuration; empty where it can."""
    first = records[0]
    if not first.is_periodic:
        return "the records have no period; friction is found from differences between periodic experiments"
    missing = [place for place in first.inputs if place not in first.outputs]
    if missing:
        return (
            f"the angle of {', '.join(missing)} is not among the outputs; log the motor angles, since friction is a "
            "function of them"
        )
    if len({record.realisation for record in records}) < 2:
        return "there is one realisation; levels of friction need two or more with different phases"
    if len(records) <= len(first.inputs):
        return f"{len(records)} experiments explain {len(first.inputs)} torques whatever friction is; measure more"
    return ""


def candidate_shapes(records: Sequence[Record], coulomb_alone: bool) -> tuple[Shape, ...]:
    """The sign at every motor, and stop operators whose thresholds are parts of its motion."""
    shapes = []
    for place in records[0].inputs:
        shapes.append(Shape(place, "sign"))
        if coulomb_alone or place not in records[0].outputs:
            continue
        angle = np.sqrt(np.mean([np.var(motion_of(record, place).angle) for record in records]))
        shapes += [Shape(place, "stop", float(part * angle)) for part in _THRESHOLDS if angle > 0]
    return tuple(shapes)


def _found(
    first: Record, names: Sequence[str], data: Sequence[ConfigurationSpectra], candidates: Sequence[Shape], auto: bool
) -> FrictionTakenOut:
    motor_of = np.array([first.inputs.index(shape.place) for shape in candidates])
    raw = normal_equations(data, np.zeros(len(candidates)), motor_of)
    _, every = find_levels(data, motor_of, np.zeros(len(candidates)))
    choices = [choose_shapes(every, i, np.flatnonzero(motor_of == i)) for i in range(len(first.inputs))]
    pays = [len(chosen) > 0 and (not auto or kept <= MAX_KEPT_SHARE) for chosen, kept in choices]
    chosen = np.concatenate([own for (own, _), good in zip(choices, pays, strict=True) if good] or [motor_of[:0]])
    kept = [kept for _, kept in choices]
    if not len(chosen):
        return _result(first, names, candidates, chosen, np.zeros(0), np.zeros((0, 0)), raw.rms, raw.rms, kept)
    reduced = [each.with_shapes(chosen) for each in data]
    levels, found = find_levels(reduced, motor_of[chosen], np.zeros(len(chosen)))
    left = shares(found, len(first.inputs), motor_of[chosen])
    kept = [left[i] if good else kept[i] for i, good in enumerate(pays)]
    return _result(first, names, candidates, chosen, levels, covariance(found), raw.rms, found.rms, kept)


def _result(
    first: Record,
    names: Sequence[str],
    candidates: Sequence[Shape],
    chosen: IntArray,
    levels: FloatArray,
    of_levels: FloatArray,
    before: FloatArray,
    after: FloatArray,
    kept: Sequence[float],
) -> FrictionTakenOut:
    units = first.units_of_inputs
    shapes = tuple(candidates[i] for i in chosen)
    result = FrictionTakenOut(
        first.inputs, units, shapes, levels, of_levels, tuple(names), before, after, np.array(kept)
    )
    notes = []
    for i, place in enumerate(first.inputs):
        if place in result.taken_places():
            level, std = result.sliding_level(place)
            text = (
                f"friction of {level:.3g} +- {std:.2g} {units[i]} in sliding was found in the records and taken out of "
                f"the torque; {100 * kept[i]:.2g} % of the power of distortion and noise is left"
            )
        else:
            text = (
                f"no friction was taken out of the torque: levels found in some realisations leave {100 * kept[i]:.3g} "
                "% of the power of distortion and noise in the others"
            )
        notes.append(Note("friction-taken-out" if place in result.taken_places() else "friction-left", text, place,
                          severity="information"))  # fmt: skip
    return FrictionTakenOut(
        first.inputs, units, shapes, levels, of_levels, tuple(names), before, after, np.array(kept), tuple(notes)
    )


def _nothing(first: Record, why: str) -> FrictionTakenOut:
    n_m = len(first.inputs)
    none, note = np.zeros((0, n_m)), Note("friction-left", f"friction is not taken out of the torque: {why}")
    return FrictionTakenOut(
        first.inputs,
        first.units_of_inputs,
        (),
        np.zeros(0),
        np.zeros((0, 0)),
        (),
        none,
        none,
        np.ones(n_m),
        (note,),
    )
