"""ResponseTable: a frequency response in columns of a text, MATLAB structs, HDF5 datasets, or universal files.

A struct has the fields of an idfrd object: ResponseData (n_y, n_u, F), Frequency and FrequencyUnit (or Units), and
optionally CovarianceData (n_y, n_u, F, 2, 2) of real and imaginary part, InputName and OutputName.

G = real + j imaginary,   or   G = magnitude exp(j phase),   dB -> 10^(dB / 20)

Universal files hold responses (data sets 58, text or binary), units (164), and geometry (15, 2411, lines 82), read by
pyuff. Nodes and directions are the names of inputs and outputs: 3z is node 3 along z, 3rz about z; a
negative direction is the same place with the other sign.
"""

import re
from collections import Counter
from collections.abc import Mapping, Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from elastid.base.arrays import ComplexArray, FloatArray, frozen_value
from elastid.base.errors import DataError, Note
from elastid.base.units import dimension_and_size
from elastid.experiment.specs.channels import ChannelSpec
from elastid.experiment.specs.experiment import ExperimentSpec
from elastid.experiment.specs.logs import ResponsesSpec
from elastid.logs.files.log import StoredArray
from elastid.logs.files.text import TextLog
from elastid.logs.files.universal import FUNCTIONS, UFF_QUANTITIES, is_universal_file, place_of, sets_of
from elastid.modal.spec import GeometrySpec

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


def structs_in(leaves: Mapping[str, StoredArray]) -> tuple[str, ...]:
    """List variables with a frequency response; an empty text for a struct whose fields are variables themselves."""
    names = (re.fullmatch(rf"(?:(.+)\.)?{_DATA}(?:\.(?:real|imag))?", key) for key in leaves)
    return tuple(dict.fromkeys(match.group(1) or "" for match in names if match))


def responses_in(leaves: Mapping[str, StoredArray]) -> list[str]:
    """Return structs and complex arrays that hold a frequency response, by name."""
    arrays = (name for name, array in leaves.items() if array.dtype.kind == "c" and max(array.shape, default=0) > 2)
    return [name or _DATA for name in dict.fromkeys((*structs_in(leaves), *arrays))]


def struct_table(path: Path, leaves: Mapping[str, StoredArray], name: str) -> ResponseTable:
    """Read the response in a struct; DataError where it or one of its fields is missing."""
    structs = structs_in(leaves)
    name = structs[0] if not name and len(structs) == 1 else name
    if name not in structs:
        names = ", ".join(struct or "its own variables" for struct in structs) or f"none; {HOW_TO_SAVE}"
        raise table_error(path, f"no response '{name}' in it (name it with response); responses in it: {names}")
    prefix = f"{name}." if name else ""
    if f"{prefix}Frequency" not in leaves:
        raise table_error(path, f"{prefix}{_DATA} has no {prefix}Frequency. Save the frequencies, too")
    data = complex_array(leaves, f"{prefix}{_DATA}")
    assert data is not None  # it is listed by structs_in
    G = np.moveaxis(data.reshape(data.shape + (1,) * (3 - data.ndim)), 2, 0)
    keys = (prefix + key for key in ("FrequencyUnit", "Units", "TimeUnit"))
    unit, alternative, time = (leaves[key].text if key in leaves else "" for key in keys)
    unit = unit or alternative
    if "timeunit" in unit.lower() and time.lower() not in ("", "seconds", "s"):
        raise table_error(path, f"{prefix}TimeUnit is not seconds. Set frequency_unit, or save it in rad/s")
    freq = np.ravel(np.asarray(leaves[f"{prefix}Frequency"], dtype=np.float64))
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
    freq = np.ravel(np.asarray(leaves[columns.frequency], dtype=np.float64))
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
            real, imaginary = (np.asarray(leaves[f"{name}.{suffix}"], dtype=np.float64) for suffix in suffixes)
            return (real + 1j * imaginary).astype(np.complex128)
    return None


def _frequency_first(path: Path, array: ComplexArray, F: int, spec: ResponsesSpec) -> ComplexArray:
    axes = [axis for axis, n in enumerate(array.shape) if n == F]
    if not axes or array.ndim > 3:
        text = f"{spec.columns.response} has shape {array.shape} for {F} frequencies"
        raise table_error(path, f"{text}; one of at most three axes must have this length")
    first = np.moveaxis(array, axes[0], 0)
    if first.ndim == 3:
        return first
    n_u = sum(channel.role == "u" for channel in spec.channels)
    return first.reshape(F, -1, 1) if first.ndim == 1 or n_u == 1 else first.reshape(F, 1, -1)


def _variance(path: Path, covariance: StoredArray | None, G: ComplexArray) -> FloatArray | None:
    """Return E|dG|^2, the sum of the variances of real and imaginary part."""
    if covariance is None or 0 in covariance.shape:
        return None
    C = np.asarray(covariance, dtype=np.float64)
    F, n_y, n_u = G.shape
    if C.size != F * n_y * n_u * 4 or C.shape[-2:] != (2, 2):
        raise table_error(path, f"CovarianceData has shape {C.shape}, expected {(n_y, n_u, F, 2, 2)}")
    return np.asarray(np.moveaxis(np.einsum("yukaa->yuk", C.reshape(n_y, n_u, F, 2, 2)), 2, 0))


def _names(leaves: Mapping[str, StoredArray], name: str) -> tuple[str, ...]:
    cells = [leaf.text for key, leaf in leaves.items() if re.fullmatch(re.escape(name) + r"(\{\d+\})?", key)]
    return tuple(cells) if any(cells) else ()


# Length and force of the unit codes of data set 164, by their names in scipy.constants; m and N have none.
_UNITS = {
    1: "m N", 2: "foot lbf", 3: "m kgf", 4: "foot poundal", 5: "milli milli", 6: "centi centi", 7: "inch lbf",
    8: "milli kgf", 10: "milli N"
}  # fmt: skip


def uff_table(path: Path, channels: tuple[ChannelSpec, ...]) -> ResponseTable:
    """Read all responses as one matrix; StudyError without pyuff or for other quantities, DataError for other lines."""
    sets = _responses(path)
    outputs, inputs = (tuple(dict.fromkeys(place_of(data_set, side) for data_set in sets)) for side in ("rsp", "ref"))
    freq = np.asarray(sets[0]["x"], dtype=np.float64)
    G = np.full((len(freq), len(outputs), len(inputs)), np.nan, dtype=np.complex128)
    for data_set in sets:
        output, input_ = place_of(data_set, "rsp"), place_of(data_set, "ref")
        if not np.array_equal(np.asarray(data_set["x"]), freq):
            pairs = f"the responses of {output} to {input_} and of {outputs[0]} to {inputs[0]}"
            raise table_error(path, f"{pairs} have different frequencies. Export all with the same lines")
        sign = np.prod([-1 if int(data_set[f"{side}_dir"]) < 0 else 1 for side in ("rsp", "ref")])
        G[:, outputs.index(output), inputs.index(input_)] = sign * np.asarray(data_set["data"])
        _check_quantity(path, data_set, output, channels)
    in_si, notes = _in_si(path, outputs, inputs, channels)
    return ResponseTable(path, freq, "Hz", G * in_si, outputs, inputs, notes=notes)


def uff_contents(path: Path) -> tuple[str, ...]:
    """Return one line for each response of a universal file."""
    return tuple(
        f"response of {place_of(data_set, 'rsp')} ({_quantity(data_set) or 'unknown quantity'}) "
        f"to {place_of(data_set, 'ref')}: {len(data_set['x'])} lines, {data_set['x'][0]:g} to {data_set['x'][-1]:g} Hz"
        for data_set in _responses(path)
    )


def uff_places(path: Path) -> tuple[dict[str, str], tuple[str, ...]]:
    """List outputs of a universal file with quantities (default: acceleration), and its inputs."""
    sets = _responses(path)
    outputs = {place_of(data_set, "rsp"): _quantity(data_set) or "acceleration" for data_set in sets}
    return outputs, tuple(dict.fromkeys(place_of(data_set, "ref") for data_set in sets))


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
    """Read nodes (data sets 15, 2411) in m and trace lines (82) of a universal file; None without nodes of places.

    channels: of the study, at nodes with a direction.  locations: further ones, by their names.
    """
    metre = _length_and_force(path)[0]
    points = {
        str(int(node)): (metre * x, metre * y, metre * z)
        for nodes in sets_of(path, 15, 2411)
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
    traces = [[str(int(node)) for node in line["nodes"]] for line in sets_of(path, 82)]
    lines = [pair for trace in traces for pair in pairwise(trace) if points.keys() >= set(pair)]
    return GeometrySpec(points=points, lines=tuple(lines), motion=motion)


def _length_and_force(path: Path) -> tuple[float, float]:
    """Return units of length in m and force in N from data set 164, by default SI."""
    units = sets_of(path, 164)
    if not units:
        return 1.0, 1.0
    from scipy import constants

    if (code := int(units[0]["units_code"])) not in _UNITS:  # the set has the factors, by which numbers are divided
        return 1 / float(units[0]["length"]), 1 / float(units[0]["force"])
    sizes = vars(constants) | {"m": 1.0, "N": 1.0, "poundal": constants.pound * constants.foot}
    length, force = (float(sizes[name]) for name in _UNITS[code].split())
    return length, force


def _in_si(
    path: Path, outputs: Sequence[str], inputs: Sequence[str], channels: Sequence[ChannelSpec]
) -> tuple[FloatArray, tuple[Note, ...]]:
    """Return factors (n_y, n_u) by the units of a file (data set 164), 1 where a channel states one; and a note."""
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
    sets = sets_of(path, 58)
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
