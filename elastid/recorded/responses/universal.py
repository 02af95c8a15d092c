"""Universal files: responses (data sets 58, text or binary), units (164), and geometry (15, 2411, lines 82).

They are read by pyuff, the extra `uff`. Nodes and directions are the names of inputs and outputs: 3z is node 3 along z,
3rz about z; a negative direction is the same place with the other sign.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from elastid.base.arrays import FloatArray
from elastid.base.errors import DataError, Note, StudyError
from elastid.base.units import TABLE
from elastid.experiment.specs.channels import ChannelSpec
from elastid.experiment.specs.recorded import ResponsesSpec
from elastid.modal.spec import GeometrySpec
from elastid.recorded.responses.table import ResponseTable, label

# A universal file starts with the mark of a data set, in fixed columns, and the number of the set.
_START = re.compile(rb"    -1 *\r?\n {1,5}\d{1,5}b?\s")
_DIRECTIONS = ("", "x", "y", "z", "rx", "ry", "rz")
_QUANTITY = {8: "position", 11: "velocity", 12: "acceleration"}
# Length in m and force in N of the unit codes of data set 164.
_FOOT, _POUND, _KILOGRAM = 0.3048, 4.4482216152605, 9.80665
_UNITS = {
    1: (1.0, 1.0), 2: (_FOOT, _POUND), 3: (1.0, _KILOGRAM), 4: (_FOOT, 0.138254954376), 5: (1e-3, 1e-3),
    6: (1e-2, 1e-2), 7: (0.0254, _POUND), 8: (1e-3, _KILOGRAM), 10: (1e-3, 1.0),
}  # fmt: skip


def is_universal_file(path: Path) -> bool:
    """True by the first lines, or by the suffix."""
    if path.suffix.lower() in (".uff", ".unv"):
        return True
    with path.open("rb") as file:
        return _START.match(file.read(200)) is not None


def uff_table(path: Path, channels: tuple[ChannelSpec, ...]) -> ResponseTable:
    """All responses as one matrix; StudyError without pyuff or for other quantities, DataError for other lines."""
    sets = _responses(path)
    outputs, inputs = (tuple(dict.fromkeys(_place(data_set, side) for data_set in sets)) for side in ("rsp", "ref"))
    freq = np.asarray(sets[0]["x"], dtype=np.float64)
    G = np.full((len(freq), len(outputs), len(inputs)), np.nan, dtype=np.complex128)
    for data_set in sets:
        output, input_ = _place(data_set, "rsp"), _place(data_set, "ref")
        if not np.array_equal(np.asarray(data_set["x"]), freq):
            raise DataError(
                "responses/table",
                f"the response of {output} to {input_} has other frequencies than that of {outputs[0]} to "
                f"{inputs[0]}; export all with the same lines",
                path,
            )
        sign = np.prod([-1 if int(data_set[f"{side}_dir"]) < 0 else 1 for side in ("rsp", "ref")])
        G[:, outputs.index(output), inputs.index(input_)] = sign * np.asarray(data_set["data"])
        _check_quantity(path, data_set, output, channels)
    in_si, notes = _in_si(path, outputs, inputs, channels)
    return ResponseTable(path, freq, "Hz", G * in_si, outputs, inputs, notes=notes)


def uff_contents(path: Path) -> tuple[str, ...]:
    """One line for each response of a universal file."""
    return tuple(
        f"response of {_place(data_set, 'rsp')} ({_quantity(data_set) or 'unknown quantity'}) "
        f"to {_place(data_set, 'ref')}: {len(data_set['x'])} lines, {data_set['x'][0]:g} to {data_set['x'][-1]:g} Hz"
        for data_set in _responses(path)
    )


def uff_places(path: Path) -> tuple[dict[str, str], tuple[str, ...]]:
    """Outputs of a universal file with their quantities (acceleration where it is not stated), and its inputs."""
    sets = _responses(path)
    outputs = {_place(data_set, "rsp"): _quantity(data_set) or "acceleration" for data_set in sets}
    return outputs, tuple(dict.fromkeys(_place(data_set, "ref") for data_set in sets))


def geometry_of_files(spec: ResponsesSpec | None, folder: Path) -> GeometrySpec | None:
    """Geometry of the first universal file with nodes of the places of a study; None where no file has any."""
    paths = () if spec is None else (folder / file.path for file in spec.files)
    found = (uff_geometry(path, spec.channels) for path in paths if spec is not None and is_universal_file(path))
    return next((geometry for geometry in found if geometry is not None), None)


def uff_geometry(path: Path, channels: Sequence[ChannelSpec]) -> GeometrySpec | None:
    """Nodes (data sets 15, 2411) in m and trace lines (82) of a universal file; None without nodes of its places.

    channels: of the study, whose places move in the directions of their nodes.
    """
    metre = _length_and_force(path)[0]
    points = {
        str(int(node)): (metre * x, metre * y, metre * z)
        for each in _sets(path, 15, 2411)
        for node, x, y, z in zip(each["node_nums"], each["x"], each["y"], each["z"], strict=True)
    }
    motion = {}
    for channel in channels:
        match = re.fullmatch(r"(\d+)([xyz])", label(channel))
        if match and match[1] in points and channel.at not in motion:
            motion[channel.at] = match[1], f"{'-' if channel.sign < 0 else ''}{match[2]}"
    if not motion:
        return None
    traces = [[str(int(node)) for node in each["nodes"]] for each in _sets(path, 82)]
    lines = [pair for trace in traces for pair in pairwise(trace) if points.keys() >= set(pair)]
    return GeometrySpec(points=points, lines=tuple(lines), motion=motion)


def _length_and_force(path: Path) -> tuple[float, float]:
    """A unit of length in m and one of force in N, by data set 164; SI where there is none."""
    units = _sets(path, 164)
    if not units:
        return 1.0, 1.0
    code = int(units[0]["units_code"])
    # Of codes other than these the set has the factors, by which numbers are divided.
    return _UNITS.get(code) or (1 / float(units[0]["length"]), 1 / float(units[0]["force"]))


def _in_si(
    path: Path, outputs: Sequence[str], inputs: Sequence[str], channels: Sequence[ChannelSpec]
) -> tuple[FloatArray, tuple[Note, ...]]:
    """Factors (n_y, n_u) of a file that states its units (data set 164), 1 where a channel states one; and a note."""
    metre, newton = _length_and_force(path)
    stated = {label(c) for c in channels if TABLE.get(c.unit, ("", 1.0))[1] != 1}
    turns = re.compile(r"\d+r[xyz]")
    of_outputs = np.array([1.0 if name in stated or turns.fullmatch(name) else metre for name in outputs])
    of_inputs = np.array([1.0 if n in stated else newton * (metre if turns.fullmatch(n) else 1.0) for n in inputs])
    if np.all(of_outputs == 1) and np.all(of_inputs == 1):
        return np.ones((len(outputs), len(inputs))), ()
    text = (
        f"its data set 164 states lengths of {metre:g} m and forces of {newton:g} N, from which its numbers are turned "
        "into SI; a channel with another unit, or with scale, overrides it"
    )
    return of_outputs[:, None] / of_inputs, (Note("responses/units", text, path.name, severity="information"),)


def _sets(path: Path, *types: int) -> list[dict[str, Any]]:
    """The data sets of some types; StudyError without pyuff, DataError for a damaged file."""
    try:
        import pyuff
    except ImportError:
        raise StudyError(
            "install/missing-package",
            "universal files are read by pyuff, which is not installed: pip install 'elastid[uff]'",
            path,
        ) from None
    try:
        file = pyuff.UFF(str(path))
        return [file.read_sets(int(i)) for i in np.flatnonzero(np.isin(file.get_set_types(), types))]
    except Exception as error:  # a damaged file makes pyuff raise anything
        text = f"{path}: damaged, cut short or no universal file ({error}); copy it or export it again"
        raise DataError("responses/table", text) from error


def _responses(path: Path) -> list[dict[str, Any]]:
    sets = _sets(path, 58)
    responses = [data_set for data_set in sets if int(data_set["func_type"]) == 4]
    if not responses:
        raise DataError(
            "responses/table",
            f"none of its {len(sets)} data sets 58 is a frequency response (function type 4); export those",
            path,
        )
    return responses


def _quantity(data_set: dict[str, Any]) -> str | None:
    return _QUANTITY.get(int(data_set["ordinate_spec_data_type"]))


def _place(data_set: dict[str, Any], side: str) -> str:
    direction = abs(int(data_set[f"{side}_dir"]))
    name = _DIRECTIONS[direction] if direction < len(_DIRECTIONS) else f"?{direction}"
    return f"{int(data_set[f'{side}_node'])}{name}"


def _check_quantity(path: Path, data_set: dict[str, Any], output: str, channels: tuple[ChannelSpec, ...]) -> None:
    quantity = _quantity(data_set)
    for channel in channels:
        if channel.role == "y" and label(channel) == output and quantity not in (None, channel.quantity):
            raise StudyError(
                "responses/table",
                f"output {output} is of quantity {quantity}, its channel states {channel.quantity}",
                path,
            )
