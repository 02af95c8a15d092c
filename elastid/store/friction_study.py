"""The artefacts of a friction study: plan.h5, records.h5, levels.h5 and friction.h5."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

from elastid.base.arrays import FloatArray
from elastid.base.note import Note
from elastid.experiment.plan.friction import FrictionPlan
from elastid.experiment.plan.passes import PassReference
from elastid.friction_record import FrictionRecord, FrictionRecords, WarmUpLog
from elastid.friction_study.result import FrictionResult, JointLevels
from elastid.record import drive_unit
from elastid.store.files import NO_STAMP, Stamp, created, opened, read_notes, scale, text_file, variable, write_notes
from elastid.store.twin import write_twin
from elastid.store.values import read_dataclass, write_value
from elastid.validation.twin_run import NO_TWIN, TwinFindings

PLAN, RECORDS, LEVELS, FRICTION = "friction plan", "friction records", "friction levels", "friction"


def write_friction_plan(path: Path, plan: FrictionPlan, stamp: Stamp = NO_STAMP) -> None:
    """plan.h5 of a friction study."""
    with created(path, PLAN, stamp) as file:
        write_value(file, "plan", plan)


def read_friction_plan(path: Path | str) -> FrictionPlan:
    """The plan in plan.h5."""
    with opened(path, PLAN) as file:
        return read_dataclass(file, "plan", FrictionPlan)


def write_pass_reference(path: Path, reference: PassReference) -> None:
    """A pass as CSV for a robot controller: time, position, velocity and acceleration of the joint, SI, link side."""
    motion = {"position": reference.position, "velocity": reference.velocity, "acceleration": reference.acceleration}
    _write_columns(path, reference.rate_hz, motion)


def write_torque_reference(path: Path, torque: FloatArray, rate_hz: float) -> None:
    """A torque (n,) to inject as CSV, SI, link side."""
    _write_columns(path, rate_hz, {"torque": torque})


def _write_columns(path: Path, rate_hz: float, columns: Mapping[str, FloatArray]) -> None:
    with text_file(path) as file:
        file.write(",".join(("t_s", *columns)) + "\n")
        for k, row in enumerate(zip(*columns.values(), strict=True)):
            file.write(",".join(f"{value:.9g}" for value in (k / rate_hz, *row)) + "\n")


def write_friction_records(
    path: Path,
    records: Iterable[FrictionRecord],
    warm_ups: Sequence[WarmUpLog] = (),
    notes: Sequence[Note] = (),
    stamp: Stamp = NO_STAMP,
) -> None:
    """records.h5: a group each record, one at a time, then the logs of warm-ups."""
    with created(path, RECORDS, stamp) as file:
        count = 0
        for record in records:
            write_value(file, f"record-{count:05d}", record)
            _label_signals(file[f"record-{count:05d}"], record)
            count += 1
        file.attrs["records"] = count
        file.attrs["warm_ups"] = len(warm_ups)
        for i, log in enumerate(warm_ups):
            write_value(file, f"warm-up-{i:05d}", log)
        write_notes(file, notes)


def _label_signals(group: Any, record: FrictionRecord) -> None:
    """Axis, unit and meaning of each signal of a record."""
    for name, unit, what in (
        ("position", record.unit, "position of the joint"),
        ("velocity", f"{record.unit}/s", "velocity of the joint"),
        ("torque", drive_unit(record.slides), "torque of the motor, link side"),
        ("temperature", "degC", "temperature of the joint"),
    ):
        if name in group:
            group[name].dims[0].label = "sample"
            group[name].attrs["units"], group[name].attrs["long_name"] = unit, what


def read_friction_records(path: Path | str) -> FrictionRecords:
    """Everything in records.h5."""
    with opened(path, RECORDS) as file:
        records = (read_dataclass(file, f"record-{i:05d}", FrictionRecord) for i in range(int(file.attrs["records"])))
        logs = (read_dataclass(file, f"warm-up-{i:05d}", WarmUpLog) for i in range(int(file.attrs["warm_ups"])))
        return FrictionRecords(tuple(records), tuple(logs), read_notes(file))


def write_levels(path: Path, levels: Sequence[JointLevels], stamp: Stamp = NO_STAMP) -> None:
    """levels.h5: a group each joint."""
    with created(path, LEVELS, stamp) as file:
        write_value(file, "joints", tuple(levels))


def read_levels(path: Path | str) -> tuple[JointLevels, ...]:
    """The joints in levels.h5."""
    with opened(path, LEVELS) as file:
        return tuple(
            read_dataclass(file["joints"], str(i), JointLevels) for i in range(int(file["joints"].attrs["length"]))
        )


def write_friction_result(
    path: Path, result: FrictionResult, stamp: Stamp = NO_STAMP, twin: TwinFindings = NO_TWIN
) -> None:
    """friction.h5: the numbers of all joints as a table, a group with everything, and the twin."""
    with created(path, FRICTION, stamp) as file:
        numbers = result.numbers
        axis = scale(file, "number", [each.name for each in numbers] or [""], "identified number, link side")
        for name, what in (("unit", "unit"), ("meaning", "meaning"), ("learnt_from", "data that tell it")):
            variable(file, name, [getattr(each, name) for each in numbers] or [""], [axis], what)
        for name, what in (
            ("value", "estimate"),
            ("std", "standard deviation"),
            ("low", "lower end of its 95 % interval"),
            ("high", "upper end of its 95 % interval"),
        ):
            variable(file, name, [float(getattr(each, name)) for each in numbers] or [0.0], [axis], what, "SI")
        write_value(file, "result", result)
        write_twin(file, twin)


def read_friction_result(path: Path | str) -> FrictionResult:
    """The result in friction.h5."""
    with opened(path, FRICTION) as file:
        return read_dataclass(file, "result", FrictionResult)
