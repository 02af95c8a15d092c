"""Frequency responses in MATLAB structs with the fields of idfrd objects, and in plain HDF5 datasets.

A struct has ResponseData (n_y, n_u, F), Frequency and FrequencyUnit (or Units), and optionally CovarianceData
(n_y, n_u, F, 2, 2) of real and imaginary part, InputName and OutputName.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from elastid.base.arrays import ComplexArray, FloatArray
from elastid.base.errors import DataError
from elastid.experiment.specs.responses import ResponsesSpec
from elastid.recorded.files.log import StoredArray
from elastid.recorded.responses.table import ResponseTable

_DATA = "ResponseData"
HOW_TO_SAVE = (
    "an idfrd object itself cannot be read outside MATLAB; save it as a struct: s = struct('ResponseData', "
    "G.ResponseData, 'Frequency', G.Frequency, 'FrequencyUnit', G.FrequencyUnit, 'CovarianceData', "
    "G.CovarianceData); save('frf.mat', 's', '-v7')"
)


def structs_in(leaves: Mapping[str, StoredArray]) -> tuple[str, ...]:
    """The variables that hold a frequency response; an empty text for one whose fields are variables themselves."""
    names = (re.fullmatch(rf"(?:(.+)\.)?{_DATA}(?:\.(?:real|imag))?", key) for key in leaves)
    return tuple(dict.fromkeys(match.group(1) or "" for match in names if match))


def struct_table(path: Path, leaves: Mapping[str, StoredArray], name: str) -> ResponseTable:
    """The response in a struct; DataError where it or one of its fields is missing."""
    found = structs_in(leaves)
    if not name and len(found) == 1:
        name = found[0]
    if name not in found:
        there = ", ".join(one or "its own variables" for one in found) or f"none; {HOW_TO_SAVE}"
        raise DataError(f"{path}: no response '{name}' in it (name it with response); responses in it: {there}")
    prefix = f"{name}." if name else ""
    if f"{prefix}Frequency" not in leaves:
        raise DataError(f"{path}: {prefix}{_DATA} has no {prefix}Frequency beside it; save the frequencies, too")
    data = complex_array(leaves, f"{prefix}{_DATA}")
    assert data is not None  # structs_in has found it
    G = np.moveaxis(data.reshape(data.shape + (1,) * (3 - data.ndim)), 2, 0)
    unit = _text(leaves, prefix, "FrequencyUnit") or _text(leaves, prefix, "Units")
    if "timeunit" in unit.lower() and _text(leaves, prefix, "TimeUnit").lower() not in ("", "seconds", "s"):
        raise DataError(f"{path}: {prefix}TimeUnit is not seconds; set frequency_unit, or save it in rad/s")
    return ResponseTable(
        path,
        _frequencies(leaves[f"{prefix}Frequency"]),
        unit,
        G,
        _names(leaves, f"{prefix}OutputName"),
        _names(leaves, f"{prefix}InputName"),
        _variance(path, leaves.get(f"{prefix}CovarianceData"), G),
    )


def dataset_table(path: Path, leaves: Mapping[str, StoredArray], spec: ResponsesSpec) -> ResponseTable:
    """The response in plain HDF5 datasets (or MATLAB variables), named under `columns`; DataError for a missing one."""
    columns = spec.columns
    G = complex_array(leaves, columns.response)
    if G is None or columns.frequency not in leaves:
        lacking = columns.response if G is None else columns.frequency
        there = ", ".join(f"{key} ({' x '.join(map(str, array.shape))})" for key, array in leaves.items()) or "none"
        raise DataError(f"{path}: no {lacking} in it; name response and frequency under columns. There are {there}")
    freq = _frequencies(leaves[columns.frequency])
    std = complex_array(leaves, columns.std) if columns.std else None
    if columns.std and std is None:
        raise DataError(f"{path}: no {columns.std} in it; correct columns.std, or leave it out")
    return ResponseTable(
        path,
        freq,
        leaves[columns.frequency].units or "Hz",
        _frequency_first(path, G, len(freq), spec),
        variance=None if std is None else np.abs(_frequency_first(path, std, len(freq), spec)) ** 2,
    )


def complex_array(leaves: Mapping[str, StoredArray], name: str) -> ComplexArray | None:
    """A complex array, in one piece or in fields real and imag as MATLAB writes them; None where it is not there."""
    if name in leaves:
        return np.asarray(leaves[name]).astype(np.complex128)
    for real, imaginary in (("real", "imag"), ("re", "im"), ("r", "i")):
        if f"{name}.{real}" in leaves and f"{name}.{imaginary}" in leaves:
            parts = [np.asarray(leaves[f"{name}.{part}"], dtype=np.float64) for part in (real, imaginary)]
            return (parts[0] + 1j * parts[1]).astype(np.complex128)
    return None


def _frequencies(leaf: StoredArray) -> FloatArray:
    return np.ravel(np.asarray(leaf, dtype=np.float64))


def _frequency_first(path: Path, array: ComplexArray, F: int, spec: ResponsesSpec) -> ComplexArray:
    axes = [axis for axis, n in enumerate(array.shape) if n == F]
    if not axes or array.ndim > 3:
        raise DataError(
            f"{path}: {spec.columns.response} has shape {array.shape}, and there are {F} frequencies; one of at most "
            "three axes must have their length"
        )
    first = np.moveaxis(array, axes[0], 0)
    if first.ndim == 3:
        return first
    n_u = sum(channel.role == "u" for channel in spec.channels)
    return first.reshape(F, -1, 1) if first.ndim == 1 or n_u == 1 else first.reshape(F, 1, -1)


def _variance(path: Path, covariance: StoredArray | None, G: ComplexArray) -> FloatArray | None:
    """E|dG|^2 is the sum of the variances of real and imaginary part."""
    if covariance is None or 0 in covariance.shape:
        return None
    C = np.asarray(covariance, dtype=np.float64)
    F, n_y, n_u = G.shape
    if C.size != F * n_y * n_u * 4 or C.shape[-2:] != (2, 2):
        raise DataError(f"{path}: CovarianceData has shape {C.shape}, expected {(n_y, n_u, F, 2, 2)}")
    return np.asarray(np.moveaxis(np.einsum("yukaa->yuk", C.reshape(n_y, n_u, F, 2, 2)), 2, 0))


def _text(leaves: Mapping[str, StoredArray], prefix: str, name: str) -> str:
    return "" if prefix + name not in leaves else _as_text(leaves[prefix + name])


def _as_text(leaf: StoredArray) -> str:
    values = np.ravel(np.asarray(leaf))
    # MATLAB 7.3 files hold characters as numbers.
    return "".join(chr(v) if values.dtype.kind in "ui" else str(v) for v in values).strip()


def _names(leaves: Mapping[str, StoredArray], name: str) -> tuple[str, ...]:
    cells = [_as_text(leaf) for key, leaf in leaves.items() if re.fullmatch(re.escape(name) + r"(\{\d+\})?", key)]
    return tuple(cells) if any(cells) else ()
