"""ResponseTable: a frequency response as a file holds it, before the study names its rows and columns."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from elastid.base.arrays import ComplexArray, FloatArray, frozen_value
from elastid.base.errors import DataError
from elastid.experiment.specs.channels import ChannelSpec

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
