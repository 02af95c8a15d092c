"""Frequency responses in CSV and text files: a column of frequencies and two columns for each element.

G = real + j imaginary,   or   G = magnitude exp(j phase),   dB -> 10^(dB / 20)
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from elastid.base.arrays import ComplexArray, FloatArray
from elastid.base.errors import DataError
from elastid.experiment.specs.responses import ResponsesSpec
from elastid.recorded.files.text import TextLog
from elastid.recorded.responses.table import ResponseTable, label


def text_table(path: Path, log: TextLog, spec: ResponsesSpec) -> ResponseTable:
    """The elements of all channels of the study; DataError for a missing column, with those that there are."""
    columns = spec.columns
    outputs, inputs = (tuple(label(c) for c in spec.channels if c.role == role) for role in ("y", "u"))
    patterns = (columns.magnitude, columns.phase) if columns.magnitude else (columns.real, columns.imaginary)

    def elements(pattern: str) -> FloatArray:
        names = [pattern.format(y=y, u=u) for y in outputs for u in inputs]
        return _columns(path, log, names).reshape(-1, len(outputs), len(inputs))

    first, second = (elements(pattern) for pattern in patterns)
    return ResponseTable(
        path,
        _columns(path, log, [columns.frequency])[:, 0],
        "Hz",
        _polar(first, second, spec) if columns.magnitude else first + 1j * second,
        outputs,
        inputs,
        elements(columns.std) ** 2 if columns.std else None,
    )


def _polar(magnitude: FloatArray, phase: FloatArray, spec: ResponsesSpec) -> ComplexArray:
    if spec.columns.magnitude_unit == "dB":
        magnitude = 10 ** (magnitude / 20)
    angle = np.radians(phase) if spec.columns.phase_unit == "deg" else phase
    return (magnitude * np.exp(1j * angle)).astype(np.complex128)


def _columns(path: Path, log: TextLog, names: list[str]) -> FloatArray:
    missing = [name for name in names if name not in log.headings]
    if missing:
        there = ", ".join(log.headings) or f"no headings, {log.n_columns} columns (delimiter, decimal under text?)"
        raise DataError(
            f"{path}: no column {', '.join(missing)}; give their names under columns ({{y}}, {{u}} stand for the "
            f"channels). There are {there}"
        )
    return log.columns([log.headings.index(name) for name in names])
