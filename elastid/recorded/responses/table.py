"""ResponseTable: a frequency response as a file holds it before its rows and columns are named, and its CSV form."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from elastid.base.arrays import ComplexArray, FloatArray, frozen_value
from elastid.base.errors import DataError
from elastid.experiment.specs.channels import ChannelSpec
from elastid.experiment.specs.responses import ResponsesSpec
from elastid.recorded.files.text import TextLog

# Hz in one of the file's unit; MATLAB's time unit is the second unless the file states another.
_IN_HZ = {
    "hz": 1.0,
    "cycles/s": 1.0,
    "cycles/timeunit": 1.0,
    "rad/s": 1 / (2 * np.pi),
    "rad/sec": 1 / (2 * np.pi),
    "rad/timeunit": 1 / (2 * np.pi),
    "khz": 1e3,
    "rpm": 1 / 60,
}


@frozen_value
class ResponseTable:
    """G (F, rows, columns) at freq (F,) in frequency_unit; rows are outputs and columns inputs, by name or number.

    variance (F, rows, columns): E|dG|^2, or None.  G = Y / U of phasors exp(+j omega t), so that a delay turns its
    phase down.
    Raises DataError for shapes that disagree.
    """

    path: Path
    freq: FloatArray
    frequency_unit: str
    G: ComplexArray
    outputs: tuple[str, ...] = ()
    inputs: tuple[str, ...] = ()
    variance: FloatArray | None = None

    def __post_init__(self) -> None:
        """Check the shapes."""
        F, rows, columns = (*self.G.shape, 0, 0, 0)[:3]
        if self.G.ndim != 3 or len(self.freq) != F or F == 0:
            raise DataError(f"{self.path}: {len(self.freq)} frequencies and a response of shape {self.G.shape}")
        for what, names, n in (("outputs", self.outputs, rows), ("inputs", self.inputs, columns)):
            if names and len(names) != n:
                raise DataError(f"{self.path}: {len(names)} names of {n} {what}: {', '.join(names)}")
        if self.variance is not None and self.variance.shape != self.G.shape:
            raise DataError(f"{self.path}: the variance has shape {self.variance.shape}, the response {self.G.shape}")

    def freq_hz(self, unit: str) -> FloatArray:
        """The frequencies (F,) in Hz; `auto` is the file's own unit.  DataError for an unknown or missing unit."""
        name = self.frequency_unit if unit == "auto" else unit
        known = name.lower().replace(" ", "").replace("seconds", "s").replace("second", "s")
        if known not in _IN_HZ:
            said = f"its unit of frequency is '{name}'" if name else "it does not say the unit of its frequencies"
            raise DataError(f"{self.path}: {said}; set frequency_unit to Hz, rad/s, kHz or rpm")
        return self.freq * _IN_HZ[known]

    def row(self, channel: ChannelSpec) -> int:
        """Row of an output; DataError with those that there are."""
        return self._index(channel, "output", self.outputs, self.G.shape[1])

    def column(self, channel: ChannelSpec) -> int:
        """Column of an input; DataError with those that there are."""
        return self._index(channel, "input", self.inputs, self.G.shape[2])

    def _index(self, channel: ChannelSpec, what: str, names: tuple[str, ...], n: int) -> int:
        name = label(channel)
        if name in names:
            return names.index(name)
        if not channel.channel and channel.column is not None and channel.column <= n:
            return channel.column - 1
        there = f"there are {', '.join(names)}" if names else f"there are {n}, named by column: 1 to {n}"
        raise DataError(f"{self.path}: no {what} is '{name}'; {there}")


def label(channel: ChannelSpec) -> str:
    """A channel as it is called in a file of responses: by its name, else by its number."""
    return channel.channel or str(channel.column)


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
