"""records.h5 and frf.h5: the records of a measurement, and the frequency responses estimated from them."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from elastid.base.arrays import FloatArray
from elastid.base.errors import DataError, check_kind
from elastid.base.mapped import MIN_LARGE_VALUES, PIECE_VALUES, empty_in_file, mapped, release
from elastid.nonlinear.result import FrictionTakenOut
from elastid.record import Configuration, HeldTorque, Record
from elastid.response import Covariance, FrequencyResponse
from elastid.store.files import (
    NO_STAMP,
    Stamp,
    attribute,
    attributes,
    created,
    key,
    opened,
    read_input_units,
    read_notes,
    read_sliding,
    scale,
    texts,
    variable,
    write_input_units,
    write_notes,
    write_sliding,
)
from elastid.store.friction import write_friction
from elastid.store.quality import read_quality, write_quality

_RECORD_ATTRIBUTES = (
    *("realisation", "experiment", "rate_hz", "period_samples"),
    *("rate_is_known", "hold", "half_wave", "is_periodic"),
)
_COVARIANCES = {
    "noise": "disturbing noise",
    "total": "noise and nonlinear distortion",
    "distortion": "stochastic nonlinear distortion in one realisation",
}


def write_records(path: Path | str, records: Iterable[Record], stamp: Stamp = NO_STAMP) -> None:
    """records.h5: a group for each record, written one at a time, uncompressed (reading would cost twice the FFT)."""
    with created(path, "records", stamp) as file:
        names: list[str] = []
        for record in records:
            _write_record(file.create_group(key(record.name)), record)
            names.append(record.name)
        scale(file, "record", names, "record, in the order measured")


def read_records(path: Path | str, configuration: str | None = None) -> Iterator[Record]:
    """The records in records.h5, of one configuration or all, one at a time: `list(read_records(path))` holds all.

    DataError names the configurations there are where it is none of them.
    """
    with opened(path, "records") as file:
        names = {name: str(file[key(name)].attrs["configuration"]) for name in texts(file, "record")}
        if configuration not in (None, *names.values()):
            known = ", ".join(dict.fromkeys(names.values()))
            raise DataError(f"{path}: no records of configuration {configuration}; there are {known or 'none'}")
        for name, of in names.items():
            if configuration in (None, of):
                yield _read_record(file[key(name)], name)


def read_configurations(path: Path | str) -> tuple[str, ...]:
    """The names of the configurations in records.h5, in the order measured."""
    with opened(path, "records") as file:
        names = [str(file[key(name)].attrs["configuration"]) for name in texts(file, "record")]
    return tuple(dict.fromkeys(names))


def _write_record(group: Any, record: Record) -> None:
    for name in _RECORD_ATTRIBUTES:
        group.attrs[name] = getattr(record, name)
    time = scale(group, "time", _times(record), "time", _rate_unit(record, "s"))
    inputs = scale(group, "input", record.inputs, "input")
    outputs = scale(group, "output", record.outputs, "output")
    variable(group, "quantity", record.quantities, [outputs], "quantity of each output")
    drives = ", ".join(dict.fromkeys(record.units_of_inputs))
    variable(group, "u", record.u, [time, inputs], "torque that acts, link side", drives)
    variable(group, "y", record.y, [time, outputs], "motion, link side", ", ".join(dict.fromkeys(record.output_units)))
    if record.r is not None:
        variable(group, "r", record.r, [time, inputs], "torque that was injected, link side", drives)
    _write_configuration(group, record.configuration)
    write_sliding(group, record.sliding)
    write_input_units(group, record.input_units)
    write_notes(group, record.notes)
    scale(group, "left_out", np.array(record.left_out, dtype=np.int64), "repetitions that do not count")
    if record.hold_samples:
        variable(group, "hold_samples", record.hold_samples, [inputs], "samples for which the torque is held")
    _write_repairs(group, record.repairs)


def _times(record: Record) -> FloatArray:
    """The times (n_samples,) of the samples; of a large record in a file."""
    n = record.n_samples
    if n < MIN_LARGE_VALUES // 8:
        return np.arange(n) / record.rate_hz
    times = empty_in_file((n,))
    for first in range(0, n, PIECE_VALUES):
        last = min(n, first + PIECE_VALUES)
        times[first:last] = np.arange(first, last) / record.rate_hz
        release(times)
    return times


def _signal(group: Any, name: str) -> FloatArray:
    """A signal of a record; a large one stays in the file."""
    in_place = mapped(Path(group.file.filename), group[name])
    return group[name][:] if in_place is None else in_place


def _read_record(group: Any, name: str) -> Record:
    # Files of earlier versions hold periodic records only.
    known = {"is_periodic": True} | attributes(group)
    return Record(
        name=name,
        configuration=_read_configuration(group),
        inputs=texts(group, "input"),
        outputs=texts(group, "output"),
        quantities=texts(group, "quantity"),  # type: ignore[arg-type]
        u=_signal(group, "u"),
        y=_signal(group, "y"),
        r=_signal(group, "r") if "r" in group else None,
        notes=read_notes(group),
        repairs=attributes(group["repairs"]),
        left_out=tuple(group["left_out"][:].tolist()),
        sliding=read_sliding(group),
        hold_samples=tuple(group["hold_samples"][:].tolist()) if "hold_samples" in group else (),
        input_units=read_input_units(group),
        **{field: known[field] for field in _RECORD_ATTRIBUTES},
    )


def write_responses(
    path: Path | str,
    responses: Sequence[FrequencyResponse],
    stamp: Stamp = NO_STAMP,
    friction: FrictionTakenOut | None = None,
) -> None:
    """frf.h5: a group for each configuration with G (frequency, output, input) and its covariances, and friction."""
    check_kind(responses, Sequence, "responses", "give a sequence of FrequencyResponse, such as [response]")
    with created(path, "frf", stamp) as file:
        if friction is not None:
            write_friction(file, friction)
        scale(file, "configuration", [r.configuration.name for r in responses], "configuration, in the order measured")
        for response in responses:
            _write_response(file.create_group(key(response.configuration.name)), response)


def read_responses(path: Path | str) -> tuple[FrequencyResponse, ...]:
    """The responses in frf.h5."""
    with opened(path, "frf") as file:
        return tuple(_read_response(file[key(name)]) for name in texts(file, "configuration"))


def _write_response(group: Any, response: FrequencyResponse) -> None:
    frequency = scale(group, "freq_hz", response.freq_hz, "frequency", _rate_unit(response, "Hz"))
    outputs = scale(group, "output", response.outputs, "output")
    inputs = scale(group, "input", response.inputs, "input")
    group.attrs["quantity"] = response.quantity
    group.attrs["rate_is_known"] = response.rate_is_known
    group.attrs["correlated_lines"] = response.correlated_lines
    variable(group, "G", response.G, [frequency, outputs, inputs], "frequency response, link side", response.unit)
    for name, what in _COVARIANCES.items():
        covariance: Covariance | None = getattr(response, name)
        if covariance is None:
            continue
        part = group.create_group(name)
        part.attrs["form"] = covariance.form
        part.attrs["dof"] = covariance.dof
        part.attrs["dof_meaning"] = "complex: the variance scatters by 1/sqrt(dof) of itself"
        axes = [frequency, outputs, inputs]
        variable(part, "variance", covariance.variance, axes, f"variance of G by {what}", f"({response.unit})^2")
        if covariance.left is not None:
            axes = [frequency, inputs, inputs]
            variable(part, "left", covariance.left, axes, "input factor: cov vec G = left (x) right")
        if covariance.right is not None:
            axes = [frequency, outputs, outputs]
            variable(part, "right", covariance.right, axes, "output factor: cov vec G = left (x) right")
        if covariance.matrix is not None:
            element = scale(
                part, "element", np.arange(covariance.matrix.shape[1]), "element of vec G, column by column"
            )
            axes = [frequency, element, element]
            variable(part, "matrix", covariance.matrix, axes, "covariance of vec G", f"({response.unit})^2")
    if response.hold is not None:
        what = "rate at which a torque is held, 0 where it is not"
        variable(group, "hold_rate_hz", response.hold.rates_hz, [inputs], what, _rate_unit(response, "Hz"))
        what = "whether images of held torques are in an output"
        variable(group, "sampled", np.array(response.hold.sampled, dtype=np.int8), [outputs], what)
    if response.bias is not None:
        shared = ("all configurations",) * (len(response.bias) - 1)
        extent = scale(group, "extent", (*shared, "this configuration"), "extent of a systematic error")
        axes = [extent, inputs, frequency, outputs, inputs]
        variable(group, "bias", response.bias, axes, "systematic error of G by friction of each motor", response.unit)
    write_quality(group, response, frequency, outputs, inputs)
    _write_configuration(group, response.configuration)
    write_sliding(group, response.sliding)
    write_input_units(group, response.input_units)
    write_notes(group, response.notes)
    _write_repairs(group, response.repairs)


def _read_response(group: Any) -> FrequencyResponse:
    known = attributes(group)
    return FrequencyResponse(
        group["freq_hz"][:],
        group["G"][:],
        texts(group, "input"),
        texts(group, "output"),
        known["quantity"],
        _read_configuration(group),
        _read_covariance(group, "noise"),
        _read_covariance(group, "total"),
        known["rate_is_known"],
        read_notes(group),
        _read_covariance(group, "distortion"),
        read_quality(group),
        repairs=attributes(group["repairs"]),
        sliding=read_sliding(group),
        input_units=read_input_units(group),
        bias=group["bias"][:] if "bias" in group else None,
        correlated_lines=float(known["correlated_lines"]),
        hold=_read_hold(group),
    )


def _read_hold(group: Any) -> HeldTorque | None:
    if "hold_rate_hz" not in group:
        return None
    return HeldTorque(tuple(group["hold_rate_hz"][:].tolist()), tuple(group["sampled"][:].astype(bool).tolist()))


def _read_covariance(group: Any, name: str) -> Covariance | None:
    if name not in group:
        return None
    part = group[name]
    left, right, matrix = (part[name][:] if name in part else None for name in ("left", "right", "matrix"))
    return Covariance(part["variance"][:], attribute(part, "dof"), left, right, matrix)


def _write_repairs(group: Any, repairs: Mapping[str, int]) -> None:
    """The repairs as attributes of a group of their own: kind -> count."""
    counts = group.create_group("repairs")
    for what, count in repairs.items():
        counts.attrs[what] = count


def _write_configuration(group: Any, configuration: Configuration) -> None:
    group.attrs["configuration"] = configuration.name
    driven = scale(group, "driven_joint", np.arange(configuration.angles.size), "driven joint, in the robot's order")
    variable(group, "angles", configuration.angles, [driven], "angle of the driven joints", "rad")


def _read_configuration(group: Any) -> Configuration:
    return Configuration(str(group.attrs["configuration"]), group["angles"][:])


def _rate_unit(value: Record | FrequencyResponse, unit: str) -> str:
    """The unit of time or frequency; where the sampling rate is not known, in samples and in units of that rate."""
    return unit if value.rate_is_known else {"s": "samples", "Hz": "sampling rate"}[unit]
