"""Frequency responses and geometry in universal files, read by pyuff.

Universal files contain responses (data sets 58, text or binary), units (164), and geometry (15, 2411, lines 82). Nodes
and directions are the names of inputs and outputs: 3z is node 3 along z, 3rz about z. A negative direction is the same
location with the other sign.
"""

import re
from collections import Counter
from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from elastid.base.arrays import FloatArray
from elastid.base.errors import Note
from elastid.base.units import dimension_and_size
from elastid.experiment.specs.channels import ChannelSpec
from elastid.experiment.specs.experiment import ExperimentSpec
from elastid.logs.files.universal import FUNCTIONS, UFF_QUANTITIES, dof_name, is_universal_file, read_data_sets
from elastid.logs.responses.table import ResponseTable, label, table_error
from elastid.modal.spec import GeometrySpec

# Length and force of the unit codes of data set 164, by their names in scipy.constants; m and N have none.
_UNITS = {
    1: "m N", 2: "foot lbf", 3: "m kgf", 4: "foot poundal", 5: "milli milli", 6: "centi centi", 7: "inch lbf",
    8: "milli kgf", 10: "milli N"
}  # fmt: skip


def uff_table(path: Path, channels: tuple[ChannelSpec, ...]) -> ResponseTable:
    """Read all responses as one matrix; StudyError without pyuff or for other quantities, DataError for other lines."""
    sets = _responses(path)
    outputs, inputs = (tuple(dict.fromkeys(dof_name(data_set, side) for data_set in sets)) for side in ("rsp", "ref"))
    freq = np.asarray(sets[0]["x"], np.float64)
    G = np.full((len(freq), len(outputs), len(inputs)), np.nan, dtype=np.complex128)
    for data_set in sets:
        output, input_ = dof_name(data_set, "rsp"), dof_name(data_set, "ref")
        if not np.array_equal(np.asarray(data_set["x"]), freq):
            pairs = f"the responses of {output} to {input_} and of {outputs[0]} to {inputs[0]}"
            raise table_error(path, f"{pairs} have different frequencies. Export all with the same lines")
        sign = np.prod([-1 if int(data_set[f"{side}_dir"]) < 0 else 1 for side in ("rsp", "ref")])
        G[:, outputs.index(output), inputs.index(input_)] = sign * np.asarray(data_set["data"])
        _check_quantity(path, data_set, output, channels)
    in_si, notes = _in_si(path, outputs, inputs, channels)
    return ResponseTable(path, freq, "Hz", G * in_si, outputs, inputs, notes=notes)


def describe_uff_responses(path: Path) -> tuple[str, ...]:
    """Return one line for each response of a universal file."""
    return tuple(
        f"response of {dof_name(data_set, 'rsp')} ({_quantity(data_set) or 'unknown quantity'}) "
        f"to {dof_name(data_set, 'ref')}: {len(data_set['x'])} lines, {data_set['x'][0]:g} to {data_set['x'][-1]:g} Hz"
        for data_set in _responses(path)
    )


def uff_locations(path: Path) -> tuple[dict[str, str], tuple[str, ...]]:
    """List outputs of a universal file with quantities (default: acceleration), and its inputs."""
    sets = _responses(path)
    outputs = {dof_name(data_set, "rsp"): _quantity(data_set) or "acceleration" for data_set in sets}
    return outputs, tuple(dict.fromkeys(dof_name(data_set, "ref") for data_set in sets))


def geometry_of_files(experiment: ExperimentSpec, folder: Path) -> GeometrySpec | None:
    """Return geometry of the first universal file with nodes at locations of the study; None without one."""
    spec = experiment.responses or experiment.recorded
    if spec is None:
        return None
    locations = {at for file in getattr(spec, "files", ()) for at in getattr(file, "at", {}).values()}
    paths = [path for file in spec.files if (path := folder / file.path).is_file() and is_universal_file(path)]
    geometries = (uff_geometry(path, spec.channels, sorted(locations)) for path in paths)
    return next((geometry for geometry in geometries if geometry is not None), None)


def uff_geometry(path: Path, channels: Sequence[ChannelSpec], locations: Sequence[str] = ()) -> GeometrySpec | None:
    """Read nodes (data sets 15, 2411) in m and trace lines (82) of a universal file; None without nodes at locations.

    channels: of the study, at nodes with a direction.  locations: names of further locations.
    """
    metre = _length_and_force(path)[0]
    points = {
        str(int(node)): (metre * x, metre * y, metre * z)
        for nodes in read_data_sets(path, 15, 2411)
        for node, x, y, z in zip(nodes["node_nums"], nodes["x"], nodes["y"], nodes["z"], strict=True)
    }
    motion = dict[str, tuple[str, str]]()
    names = [(channel.at, channel.channel or channel.at, channel.sign) for channel in channels]
    for at, name, sign in (*names, *((at, at, 1) for at in locations)):
        match = re.fullmatch(r"(\d+)([xyz])( \d+)?", name)
        if match and match[1] in points:
            motion.setdefault(at, (match[1], f"{'-' if sign < 0 else ''}{match[2]}"))
    if not motion:
        return None
    traces = [[str(int(node)) for node in line["nodes"]] for line in read_data_sets(path, 82)]
    lines = [pair for trace in traces for pair in pairwise(trace) if points.keys() >= set(pair)]
    return GeometrySpec(points=points, lines=tuple(lines), motion=motion)


def _length_and_force(path: Path) -> tuple[float, float]:
    """Return units of length in m and force in N from data set 164, by default SI."""
    units = read_data_sets(path, 164)
    if not units:
        return 1.0, 1.0
    from scipy import constants

    if (code := int(units[0]["units_code"])) not in _UNITS:  # other codes: divide by the factors of the data set
        return 1 / float(units[0]["length"]), 1 / float(units[0]["force"])
    sizes = vars(constants) | {"m": 1.0, "N": 1.0, "poundal": constants.pound * constants.foot}
    length, force = (float(sizes[name]) for name in _UNITS[code].split())
    return length, force


def _in_si(
    path: Path, outputs: Sequence[str], inputs: Sequence[str], channels: Sequence[ChannelSpec]
) -> tuple[FloatArray, tuple[Note, ...]]:
    """Return factors (n_y, n_u) by the units of a file (data set 164), 1 for a channel with a unit; and a note."""
    metre, newton = _length_and_force(path)
    with_unit = {label(c) for c in channels if dimension_and_size(c.unit)[1] != 1}
    turns = re.compile(r"\d+r[xyz]")
    f_y = np.array([1.0 if name in with_unit or turns.fullmatch(name) else metre for name in outputs])
    f_u = np.array([1.0 if n in with_unit else newton * (metre if turns.fullmatch(n) else 1.0) for n in inputs])
    if np.all(f_y == 1) and np.all(f_u == 1):
        return np.ones((len(outputs), len(inputs))), ()
    text = f"its data set 164 states lengths of {metre:g} m and forces of {newton:g} N, which elastid converts to SI; a"
    text += " channel with another unit, or with scale, overrides it"
    return f_y[:, None] / f_u, (Note("responses/units", text, path.name, severity="information"),)


def _responses(path: Path) -> list[dict[str, Any]]:
    sets = read_data_sets(path, 58)
    responses = [data_set for data_set in sets if int(data_set["func_type"]) == 4]
    if not responses:
        counts = Counter(int(data_set["func_type"]) for data_set in sets)
        types = (f"{n} of type {kind} ({FUNCTIONS.get(kind, 'other')})" for kind, n in counts.items())
        text = "it has no frequency response (function type 4) and no time history (type 1); its data sets 58: "
        text += ", ".join(types) or "none"
        raise table_error(path, f"{text}. Export frequency responses or time histories")
    return responses


def _quantity(data_set: dict[str, Any]) -> str | None:
    return UFF_QUANTITIES.get(int(data_set["ordinate_spec_data_type"]))


def _check_quantity(path: Path, data_set: dict[str, Any], output: str, channels: tuple[ChannelSpec, ...]) -> None:
    quantity = _quantity(data_set)
    for channel in channels:
        if channel.role == "y" and label(channel) == output and quantity not in (None, channel.quantity):
            text = f"output {output} has quantity {quantity} in the file, {channel.quantity} in its channel"
            raise table_error(path, text)
