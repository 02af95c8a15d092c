"""Frequency responses in universal files, data set 58 (text or binary), read by pyuff: the extra `uff`.

Nodes and directions are the names of inputs and outputs: 3z is node 3 along z, 3rz about z. A negative direction is
the same place with the other sign.
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np

from elastid.base.arrays import IntArray
from elastid.base.errors import DataError, StudyError
from elastid.experiment.specs.channels import ChannelSpec
from elastid.recorded.responses.table import ResponseTable, label

# A universal file starts with the mark of a data set, in fixed columns, and the number of the set.
_START = re.compile(rb"    -1 *\r?\n {1,5}\d{1,5}b?\s")
_DIRECTIONS = ("", "x", "y", "z", "rx", "ry", "rz")
_QUANTITY = {8: "position", 11: "velocity", 12: "acceleration"}


def is_universal_file(path: Path) -> bool:
    """By its first lines, or by its suffix."""
    if path.suffix.lower() in (".uff", ".unv"):
        return True
    with path.open("rb") as file:
        return _START.match(file.read(200)) is not None


def uff_table(path: Path, channels: tuple[ChannelSpec, ...]) -> ResponseTable:
    """All responses of a universal file as one matrix.

    Raises StudyError where pyuff is not installed or the file's quantity is not that of a channel, DataError where
    the responses do not share their frequencies.
    """
    sets = _responses(path)
    outputs, inputs = (tuple(dict.fromkeys(_place(data_set, side) for data_set in sets)) for side in ("rsp", "ref"))
    freq = np.asarray(sets[0]["x"], dtype=np.float64)
    G = np.full((len(freq), len(outputs), len(inputs)), np.nan, dtype=np.complex128)
    for data_set in sets:
        output, input_ = _place(data_set, "rsp"), _place(data_set, "ref")
        if not np.array_equal(np.asarray(data_set["x"]), freq):
            raise DataError(
                f"{path}: the response of {output} to {input_} has other frequencies than that of {outputs[0]} to "
                f"{inputs[0]}; export all with the same lines"
            )
        sign = np.prod([-1 if int(data_set[f"{side}_dir"]) < 0 else 1 for side in ("rsp", "ref")])
        G[:, outputs.index(output), inputs.index(input_)] = sign * np.asarray(data_set["data"])
        _check_quantity(path, data_set, output, channels)
    return ResponseTable(path, freq, "Hz", G, outputs, inputs)


def uff_contents(path: Path) -> tuple[str, ...]:
    """One line for each response of a universal file."""
    return tuple(
        f"response of {_place(data_set, 'rsp')} ({_quantity(data_set) or 'unknown quantity'}) "
        f"to {_place(data_set, 'ref')}: {len(data_set['x'])} lines, {data_set['x'][0]:g} to {data_set['x'][-1]:g} Hz"
        for data_set in _responses(path)
    )


def _responses(path: Path) -> list[dict[str, Any]]:
    try:
        import pyuff
    except ImportError:
        raise StudyError(
            f"{path}: universal files are read by pyuff, which is not installed: pip install 'elastid[uff]'"
        ) from None
    try:
        file = pyuff.UFF(str(path))
        wanted: IntArray = np.flatnonzero(file.get_set_types() == 58)
        sets = [file.read_sets(int(i)) for i in wanted]
    except Exception as error:  # a damaged file makes pyuff raise anything
        raise DataError(
            f"{path}: damaged, cut short or no universal file ({error}); copy it or export it again"
        ) from error
    responses = [data_set for data_set in sets if int(data_set["func_type"]) == 4]
    if not responses:
        raise DataError(
            f"{path}: none of its {len(sets)} data sets 58 is a frequency response (function type 4); export those"
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
                f"{path}: output {output} is of quantity {quantity}, its channel states {channel.quantity}"
            )
