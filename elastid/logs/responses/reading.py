"""Frequency responses in files of any format, converted to SI on the link side.

    G = f_y / (f_u H) (j omega)^k G_file

f_y, f_u turn the file's numbers into SI on the link side (scale, sign, unit, torque constant, gear), k its quantity
into the requested one. H takes out the hold of a command, as in Y = G H U: 1 for a band-limited input.
"""

import os
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from elastid.base.arrays import BoolArray, ComplexArray, FloatArray, laplace_variable
from elastid.base.errors import DataError, Note, Severity
from elastid.experiment.specs.channels import ChannelSpec, Places, input_units
from elastid.experiment.specs.logs import ResponsesSpec
from elastid.logs.files.formats import open_log
from elastid.logs.files.text import TextLog
from elastid.logs.files.text_format import guess_format
from elastid.logs.files.universal import is_universal_file, time_histories
from elastid.logs.repair import MAX_WRONG_FRACTION
from elastid.logs.responses.table import (
    ResponseTable,
    dataset_table,
    find_structs,
    struct_table,
    table_error,
    text_table,
)
from elastid.logs.responses.universal_files import describe_uff_responses, uff_table
from elastid.logs.units_and_sides import MAX_COMPUTABLE, link_side_factor, to_joints
from elastid.record import MOTION_ORDER, Configuration, Motion, ZohTorque, zero_order_hold
from elastid.response import Covariance, Response

# Fraction of zeros above which an element has no response; magnitude of a line over both neighbours above which it is
# no resonance that the lines resolve.
MAX_ZERO_FRACTION, MIN_SPIKE_RATIO = 0.5, 100.0


def read_table(path: Path, spec: ResponsesSpec, response: str) -> ResponseTable:
    """Read the frequency response in a file; raise DataError without one of that name."""
    if os.path.isfile(path) and is_universal_file(path):
        return uff_table(path, spec.channels)
    with open_log(path, spec.text) as log:
        if isinstance(log, TextLog):
            return text_table(path, log, spec)
        if find_structs(log.arrays) or (path.suffix.lower() == ".mat" and spec.columns.response not in log.arrays):
            return struct_table(path, log.arrays, response)
        return dataset_table(path, log.arrays, spec)


def describe_responses(path: Path) -> tuple[str, ...]:
    """Return a line for each frequency response in a file."""
    if is_universal_file(path):
        return () if time_histories(path) else describe_uff_responses(path)
    with open_log(path, guess_format(path)) as log:
        tables = [(name, struct_table(path, log.arrays, name)) for name in find_structs(log.arrays)]
    return tuple(
        f"response {name or '(its own variables)'}: {table.G.shape[1]} outputs x {table.G.shape[2]} inputs, "
        f"{len(table.freq)} lines, {table.freq[0]:g} to {table.freq[-1]:g} {table.frequency_unit or '(no unit)'}"
        f"{'' if table.variance is None else ', with variance'}"
        for name, table in tables
    )


def link_side_response(
    table: ResponseTable, spec: ResponsesSpec, configuration: Configuration, robot: Places, quantity: Motion
) -> Response:
    """Convert the table's channels to SI on the link side, all outputs to `quantity`.

    Lines at 0 Hz or below and lines that are not finite are left out with a note.  The variance is the file's, else
    (relative_std |G|)^2, else none.  Raises DataError where no line is left or a channel is not in the table.
    """
    outputs, inputs = ([c for c in spec.channels if c.role == role] for role in ("y", "u"))
    rows, columns = ([table.index(c) for c in side] for side in (outputs, inputs))
    freq_hz = table.freq_hz(spec.frequency_unit)
    order = np.argsort(freq_hz, kind="stable")
    freq_hz, G = freq_hz[order], table.G[order][:, rows][:, :, columns]
    for i, j in np.argwhere(np.isnan(G).all(axis=0)):
        raise table_error(table.path, f"it lacks the response of {outputs[i].name_in_file} to {inputs[j].name_in_file}")
    f_y, f_u = (np.array([link_side_factor(c, robot) for c in side]) for side in (outputs, inputs))
    powers = np.array([MOTION_ORDER[quantity] - MOTION_ORDER[c.quantity] for c in outputs])
    is_zero = G == 0  # at all lines of an element that has no response, else of a missing value
    size = np.abs(np.where(is_zero, 1.0, G))
    # Beyond these are placeholders of missing values; squares of smaller ones vanish.
    good = (freq_hz > 0) & np.all((size > 1 / MAX_COMPUTABLE) & (size < MAX_COMPUTABLE), axis=(1, 2))
    good &= ~(is_zero & (is_zero.mean(axis=0) < MAX_ZERO_FRACTION)).any(axis=(1, 2))
    good &= ~_is_spike(size).any(axis=(1, 2))
    variance = None if table.variance is None else table.variance[order][:, rows][:, :, columns]
    if variance is not None:
        good &= np.isfinite(variance).all(axis=(1, 2))
    notes = (*table.notes, *_discarded_lines_notes(table, freq_hz, good))
    freq_hz, G = freq_hz[good], G[good]
    for twice_hz in freq_hz[1:][np.diff(freq_hz) == 0][:1]:
        raise DataError("responses/lines", f"{twice_hz:g} Hz occurs twice. Keep one line", table.path)
    gain = laplace_variable(freq_hz[:, None]) ** powers * f_y
    gain_of_elements = gain[:, :, None] / (f_u * _hold_response(table.path, freq_hz, inputs, spec))[:, None, :]
    T_y, T_u = to_joints(outputs, robot), np.linalg.inv(to_joints(inputs, robot))
    G = T_y @ (gain_of_elements * G) @ T_u
    if variance is not None:
        variance = T_y**2 @ (variance[good] * np.abs(gain_of_elements) ** 2) @ T_u**2
    elif spec.relative_std is not None:
        variance = (spec.relative_std * np.abs(G)) ** 2
    u_places, y_places = (tuple(c.at for c in side) for side in (inputs, outputs))
    # Angles contain images of the commands that are held.
    rates, sampled = (tuple(_hold_rate_hz(c, spec) for c in inputs), tuple(c.quantity == "position" for c in outputs))
    # Taken as exact: a file does not hold its degrees of freedom.
    noise = None if variance is None else Covariance(variance, float("inf"))
    return Response(
        freq_hz, G, u_places, y_places, quantity, configuration, noise=noise, notes=notes,
        sliding=robot.sliding((*u_places, *y_places)), input_units=input_units(inputs, robot),
        hold=ZohTorque(rates, sampled) if any(rates) else None
    )  # fmt: skip


def _is_spike(size: FloatArray) -> BoolArray:
    """Flag lines of magnitudes (F, ...) far above both neighbours, if these are few: no resonance in them."""
    result = np.zeros(size.shape, np.bool_)
    if len(size) > 2:
        result[1:-1] = size[1:-1] > MIN_SPIKE_RATIO * np.maximum(size[:-2], size[2:])
    return np.asarray(result & (result.mean(axis=0) <= MAX_WRONG_FRACTION))


def _hold_rate_hz(channel: ChannelSpec, spec: ResponsesSpec) -> float:
    """Return the rate at which a command is renewed; 0 of an input that is not held."""
    return 0.0 if spec.hold_of(channel) == "band-limited" else channel.rate_hz or spec.rate_hz or 0.0


def _hold_response(path: Path, freq_hz: FloatArray, inputs: Sequence[ChannelSpec], spec: ResponsesSpec) -> ComplexArray:
    """Compute H (F, n_u) of inputs, 1 if not held; DataError for lines above half the rate of a command."""
    H = np.ones((len(freq_hz), len(inputs)), np.complex128)
    for j, (channel, rate_hz) in enumerate((channel, _hold_rate_hz(channel, spec)) for channel in inputs):
        if 0 < rate_hz < 2 * freq_hz[-1]:
            text = f"its lines reach {freq_hz[-1]:g} Hz; the held command {channel.name_in_file} at {rate_hz:g} Hz"
            text += f" excites up to {rate_hz / 2:g} Hz"
            raise DataError("responses/lines", text + ". Correct rate_hz, or exclude the lines above", path)
        H[:, j] = zero_order_hold(freq_hz / rate_hz) if rate_hz else 1.0
    return H


_UNUSABLE = f"missing, 0, not finite, or above {MIN_SPIKE_RATIO:g} times both neighbours"


def _discarded_lines_notes(table: ResponseTable, freq_hz: FloatArray, good: BoolArray) -> tuple[Note, ...]:
    if good.all():
        return ()
    if not good.any():
        text = f"none of its {len(good)} lines is finite, plausible and above 0 Hz"
        raise DataError("responses/lines", text, table.path)
    n_out, static = int(np.sum(~good)), int(np.sum(freq_hz <= 0))
    reasons = [f"{n} {reason}" for n, reason in ((static, "at 0 Hz"), (n_out - static, _UNUSABLE)) if n]
    text = f"{n_out} of {len(good)} lines are discarded: {' and '.join(reasons)}"
    # Analysers begin at 0 Hz, where no motion has an acceleration.
    severity: Severity = "information" if n_out == static else "warning"
    return (Note("frf/lines-discarded", text, table.path.name, severity=severity),)
