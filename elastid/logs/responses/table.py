"""ResponseTable: a frequency response in columns of a text, MATLAB structs or HDF5 datasets.

A struct has the fields of an idfrd object: ResponseData (n_y, n_u, F), Frequency and FrequencyUnit (or Units), and
optionally CovarianceData (n_y, n_u, F, 2, 2) of real and imaginary part, InputName and OutputName.

G = real + j imaginary,   or   G = magnitude exp(j phase),   dB -> 10^(dB / 20)
"""

import re
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from elastid.base.arrays import ComplexArray, FloatArray, frozen_value
from elastid.base.errors import DataError, Note
from elastid.experiment.specs.channels import ChannelSpec
from elastid.experiment.specs.logs import ResponsesSpec
from elastid.logs.files.log import StoredArray
from elastid.logs.files.text import TextLog

# Hz in one of the file's unit; MATLAB's time unit is the second unless the file states another.
_IN_HZ = {
    **dict.fromkeys(("hz", "cycles/s", "cycles/timeunit"), 1.0),
    **dict.fromkeys(("rad/s", "rad/sec", "rad/timeunit"), 1 / (2 * np.pi)),
    "khz": 1e3,
    "rpm": 1 / 60,
}
_DATA = "ResponseData"
HOW_TO_SAVE = (
    "an idfrd object itself cannot be read outside MATLAB; save it as a struct: s = struct('ResponseData', "
    "G.ResponseData, 'Frequency', G.Frequency, 'FrequencyUnit', G.FrequencyUnit, 'CovarianceData', "
    "G.CovarianceData); save('frf.mat', 's', '-v7')"
)


def table_error(path: Path, text: str) -> DataError:
    """Return the error of a file without the frequency response that a study needs."""
    return DataError("responses/table", text, path)


@frozen_value
class ResponseTable:
    """G (F, rows, columns) at freq (F,) in frequency_unit; rows are outputs and columns inputs, by name or number.

    variance (F, rows, columns): E|dG|^2, or None.  G = Y / U of phasors exp(+j omega t), so that a delay turns its
    phase down.  DataError for shapes that disagree.
    """

    path: Path
    freq: FloatArray
    frequency_unit: str
    G: ComplexArray
    outputs: tuple[str, ...] = ()
    inputs: tuple[str, ...] = ()
    variance: FloatArray | None = None
    notes: tuple[Note, ...] = ()

    def __post_init__(self) -> None:
        F, rows, columns = (*self.G.shape, 0, 0, 0)[:3]
        if self.G.ndim != 3 or len(self.freq) != F or F == 0:
            raise table_error(self.path, f"{len(self.freq)} frequencies and a response of shape {self.G.shape}")
        for kind, names, n in (("outputs", self.outputs, rows), ("inputs", self.inputs, columns)):
            if names and len(names) != n:
                raise table_error(self.path, f"{len(names)} names of {n} {kind}: {', '.join(names)}")
        if self.variance is not None and self.variance.shape != self.G.shape:
            raise table_error(self.path, f"the variance has shape {self.variance.shape}, the response {self.G.shape}")

    def freq_hz(self, unit: str) -> FloatArray:
        """Convert the frequencies (F,) to Hz; `auto` is the file's unit.  DataError for an unknown or missing unit."""
        name = self.frequency_unit if unit == "auto" else unit
        unit_name = name.lower().replace(" ", "").replace("seconds", "s").replace("second", "s")
        if unit_name not in _IN_HZ:
            problem = f"its unit of frequency is '{name}'" if name else "the unit of its frequencies is unknown"
            raise table_error(self.path, f"{problem}. Set frequency_unit to Hz, rad/s, kHz or rpm")
        return self.freq * _IN_HZ[unit_name]

    def index(self, channel: ChannelSpec) -> int:
        """Return row of an output or column of an input; raise DataError with the existing names."""
        kind, names, n = "output", self.outputs, self.G.shape[1]
        if channel.role == "u":
            kind, names, n = "input", self.inputs, self.G.shape[2]
        name = label(channel)
        if name in names:
            return names.index(name)
        if not channel.channel and channel.column is not None and channel.column <= n:
            return channel.column - 1
        existing = ", ".join(names) or f"{n}, named by column: 1 to {n}"
        raise table_error(self.path, f"no {kind} is '{name}'; there are {existing}")


def label(channel: ChannelSpec) -> str:
    """Return a channel as it is called in a file of responses: by its name, else by its number."""
    return channel.channel or str(channel.column)


def text_table(path: Path, log: TextLog, spec: ResponsesSpec) -> ResponseTable:
    """Read the elements of all channels of the study; DataError for a missing column, with those that there are."""
    columns = spec.columns
    outputs, inputs = (tuple(label(c) for c in spec.channels if c.role == role) for role in ("y", "u"))
    patterns = (columns.magnitude, columns.phase) if columns.magnitude else (columns.real, columns.imaginary)

    def elements(pattern: str) -> FloatArray:
        names = [pattern.format(y=y, u=u) for y in outputs for u in inputs]
        return _columns(path, log, names).reshape(-1, len(outputs), len(inputs))

    first, second = (elements(pattern) for pattern in patterns)
    if columns.magnitude:
        size = 10 ** (first / 20) if columns.magnitude_unit == "dB" else first
        angle = np.radians(second) if columns.phase_unit == "deg" else second
        first, second = size * np.cos(angle), size * np.sin(angle)
    freq = _columns(path, log, [columns.frequency])[:, 0]
    variance = elements(columns.std) ** 2 if columns.std else None
    return ResponseTable(path, freq, "Hz", first + 1j * second, outputs, inputs, variance)


def _columns(path: Path, log: TextLog, names: list[str]) -> FloatArray:
    absent = [name for name in names if name not in log.headings]
    if absent:
        headings = ", ".join(log.headings) or f"no headings, {log.n_columns} columns (delimiter, decimal under text?)"
        text = f"no column {', '.join(absent)}. Give the names under columns, with {{y}} and {{u}} for the channels"
        raise table_error(path, f"{text}. There are {headings}")
    return log.columns([log.headings.index(name) for name in names])


def find_structs(leaves: Mapping[str, StoredArray]) -> tuple[str, ...]:
    """List variables with a frequency response; an empty text for a struct whose fields are variables themselves."""
    names = (re.fullmatch(rf"(?:(.+)\.)?{_DATA}(?:\.(?:real|imag))?", key) for key in leaves)
    return tuple(dict.fromkeys(match.group(1) or "" for match in names if match))


def find_responses(leaves: Mapping[str, StoredArray]) -> list[str]:
    """Return structs and complex arrays that hold a frequency response, by name."""
    arrays = (name for name, array in leaves.items() if array.dtype.kind == "c" and max(array.shape, default=0) > 2)
    return [name or _DATA for name in dict.fromkeys((*find_structs(leaves), *arrays))]


def struct_table(path: Path, leaves: Mapping[str, StoredArray], name: str) -> ResponseTable:
    """Read the response in a struct; DataError where it or one of its fields is missing."""
    structs = find_structs(leaves)
    name = structs[0] if not name and len(structs) == 1 else name
    if name not in structs:
        names = ", ".join(struct or "its own variables" for struct in structs) or f"none; {HOW_TO_SAVE}"
        raise table_error(path, f"no response '{name}' in it (name it with response); responses in it: {names}")
    prefix = f"{name}." if name else ""
    if f"{prefix}Frequency" not in leaves:
        raise table_error(path, f"{prefix}{_DATA} has no {prefix}Frequency. Save the frequencies, too")
    data = complex_array(leaves, f"{prefix}{_DATA}")
    assert data is not None  # it is listed by find_structs
    G = np.moveaxis(data.reshape(data.shape + (1,) * (3 - data.ndim)), 2, 0)
    keys = (prefix + key for key in ("FrequencyUnit", "Units", "TimeUnit"))
    unit, alternative, time = (leaves[key].text if key in leaves else "" for key in keys)
    unit = unit or alternative
    if "timeunit" in unit.lower() and time.lower() not in ("", "seconds", "s"):
        raise table_error(path, f"{prefix}TimeUnit is not seconds. Set frequency_unit, or save it in rad/s")
    freq = np.ravel(np.asarray(leaves[f"{prefix}Frequency"], np.float64))
    outputs, inputs = (_names(leaves, f"{prefix}{side}Name") for side in ("Output", "Input"))
    variance = _variance(path, leaves.get(f"{prefix}CovarianceData"), G)
    return ResponseTable(path, freq, unit, G, outputs, inputs, variance)


def dataset_table(path: Path, leaves: Mapping[str, StoredArray], spec: ResponsesSpec) -> ResponseTable:
    """Read the response in HDF5 datasets (or MATLAB variables) named by `columns`; DataError for a missing one."""
    columns = spec.columns
    G = complex_array(leaves, columns.response)
    if G is None or columns.frequency not in leaves:
        absent = columns.response if G is None else columns.frequency
        datasets = ", ".join(f"{key} ({' x '.join(map(str, array.shape))})" for key, array in leaves.items()) or "none"
        raise table_error(path, f"no {absent} in it. Name response and frequency under columns. There are {datasets}")
    freq = np.ravel(np.asarray(leaves[columns.frequency], np.float64))
    std = complex_array(leaves, columns.std) if columns.std else None
    if columns.std and std is None:
        raise table_error(path, f"column {columns.std} does not exist. Correct columns.std, or omit it")
    G = _frequency_first(path, G, len(freq), spec)
    variance = None if std is None else np.abs(_frequency_first(path, std, len(freq), spec)) ** 2
    return ResponseTable(path, freq, leaves[columns.frequency].units or "Hz", G, variance=variance)


def complex_array(leaves: Mapping[str, StoredArray], name: str) -> ComplexArray | None:
    """Read a complex array, or struct with real and imag fields as written by MATLAB; None if it is missing."""
    if name in leaves:
        return np.asarray(leaves[name]).astype(np.complex128)
    for suffixes in (("real", "imag"), ("re", "im"), ("r", "i")):
        if all(f"{name}.{suffix}" in leaves for suffix in suffixes):
            real, imaginary = (np.asarray(leaves[f"{name}.{suffix}"], np.float64) for suffix in suffixes)
            return (real + 1j * imaginary).astype(np.complex128)
    return None


def _frequency_first(path: Path, array: ComplexArray, F: int, spec: ResponsesSpec) -> ComplexArray:
    axes = [axis for axis, n in enumerate(array.shape) if n == F]
    if len(axes) != 1 or array.ndim > 3:
        text = f"{spec.columns.response} has shape {array.shape} for {F} frequencies"
        raise table_error(path, f"{text}. Save it with exactly one axis of this length, of at most three")
    first = np.moveaxis(array, axes[0], 0)
    if first.ndim == 3:
        return first
    n_u = sum(channel.role == "u" for channel in spec.channels)
    return first.reshape(F, -1, 1) if first.ndim == 1 or n_u == 1 else first.reshape(F, 1, -1)


def _variance(path: Path, covariance: StoredArray | None, G: ComplexArray) -> FloatArray | None:
    """Return E|dG|^2, the sum of the variances of real and imaginary part."""
    if covariance is None or 0 in covariance.shape:
        return None
    C = np.asarray(covariance, np.float64)
    F, n_y, n_u = G.shape
    if C.size != F * n_y * n_u * 4 or C.shape[-2:] != (2, 2):
        raise table_error(path, f"CovarianceData has shape {C.shape}, expected {(n_y, n_u, F, 2, 2)}")
    return np.asarray(np.moveaxis(np.einsum("yukaa->yuk", C.reshape(n_y, n_u, F, 2, 2)), 2, 0))


def _names(leaves: Mapping[str, StoredArray], name: str) -> tuple[str, ...]:
    cells = [leaf.text for key, leaf in leaves.items() if re.fullmatch(re.escape(name) + r"(\{\d+\})?", key)]
    return tuple(cells) if any(cells) else ()
