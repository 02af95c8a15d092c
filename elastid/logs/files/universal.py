"""Data sets of universal files (UFF), by pyuff, the extra `uff`, and their time histories as a log.

A data set 58 is a function of one node and direction: a time history (type 1), or a response to another node (type 4).
"""

import re
from collections.abc import Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from elastid.base.errors import DataError, require_package
from elastid.experiment.specs.logs import TextFormatSpec
from elastid.logs.files.log import ArrayLog, StoredArray

# A universal file starts with the mark of a data set, in fixed columns, and the number of the set.
_START = re.compile(rb"    -1 *\r?\n {1,5}\d{1,5}b?\s")
_START_OF_BINARY = re.compile(rb"-1 *\r?\n +\d{1,5}b\s")
_EXPONENT = re.compile(rb"(\d\.\d+)[Dd]([+-]\d\d)")
_DIRECTIONS = ("", "x", "y", "z", "rx", "ry", "rz")
UFF_QUANTITIES = {8: "position", 11: "velocity", 12: "acceleration"}
_UNITS = {8: "m", 11: "m/s", 12: "m/s^2", 13: "N"}
# Functions of a data set 58 by their type.
FUNCTIONS = {
    0: "unknown", 2: "auto spectrum", 3: "cross spectrum", 5: "transmissibility", 6: "coherence", 9: "power spectral "
    "density", 12: "spectrum"
}  # fmt: skip


def is_universal_file(path: Path, head: bytes = b"") -> bool:
    """Recognise the first lines, or the suffix."""
    if path.suffix.lower() in (".uff", ".unv"):
        return True
    if head or path.is_dir():
        return _START.match(head) is not None
    with path.open("rb") as file:
        return _START.match(file.read(200)) is not None


def read_data_sets(path: Path, *types: int) -> list[dict[str, Any]]:
    """Read the data sets of some types; StudyError without pyuff, DataError for a damaged file."""
    pyuff = require_package("pyuff", "uff", path)
    try:
        with _readable(path) as name:
            file = pyuff.UFF(name)
            return [file.read_sets(int(i)) for i in np.flatnonzero(np.isin(file.get_set_types(), types))]
    except Exception as error:  # a damaged file makes pyuff raise anything
        text = f"{path}: damaged, truncated or not a universal file ({error}). Copy or export it again"
        raise DataError("responses/table", text) from error


@contextmanager
def _readable(path: Path) -> Iterator[str]:
    """Give the path of the file, or of a copy whose exponents are written with E in place of Fortran's D."""
    content = path.read_bytes()
    if _START_OF_BINARY.search(content) or not _EXPONENT.search(content):
        yield str(path)
        return
    with TemporaryDirectory() as folder:
        copy = Path(folder, path.name)
        copy.write_bytes(_EXPONENT.sub(rb"\1E\2", content))
        yield str(copy)


def dof_name(data_set: dict[str, Any], side: str) -> str:
    """Return node and direction of a function, 3z or 3rz (about z), on its side: rsp (output) or ref (input)."""
    direction = abs(int(data_set[f"{side}_dir"]))
    name = _DIRECTIONS[direction] if direction < len(_DIRECTIONS) else f"?{direction}"
    return f"{int(data_set[f'{side}_node'])}{name}"


def time_histories(path: Path) -> dict[str, dict[str, Any]]:
    """Return data sets of time histories, by node, direction and, where one has several, number."""
    histories: dict[str, dict[str, Any]] = {}
    for data_set in read_data_sets(path, 58):
        if int(data_set["func_type"]) == 1:
            name = dof_name(data_set, "rsp")
            histories[name if name not in histories else f"{name} {len(histories) + 1}"] = data_set
    return histories


@contextmanager
def open_uff(path: Path, text: TextFormatSpec) -> Iterator[ArrayLog]:
    """Return time histories as a log, with rate and unit; raise DataError without any."""
    histories = time_histories(path)
    if not histories:
        problem = "no time histories in it. List frequency responses under experiment.responses"
        raise DataError("records/channels", problem, path)
    yield ArrayLog(path, {name: _array(data_set) for name, data_set in histories.items()})


def _array(data_set: dict[str, Any]) -> StoredArray:
    x, step = np.asarray(data_set["data"]), float(data_set.get("abscissa_inc") or 0.0)
    unit = _UNITS.get(int(data_set["ordinate_spec_data_type"]), "")
    label = str(data_set.get("ordinate_axis_units_lab", "")).strip()
    has_label = label not in ("", "NONE")
    # The text of the file has six digits of the step.
    rate_hz = float(f"{1 / step:.5g}") if step > 0 else None
    return StoredArray(x.shape, x.dtype, partial(np.asarray, x), label if has_label else unit, rate_hz)
