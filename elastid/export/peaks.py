"""Export of the peaks of measured responses to CSV."""

from __future__ import annotations

import csv
from collections.abc import Sequence
from pathlib import Path

from elastid.base.escape import csv_cell
from elastid.frf.peaks import Peak
from elastid.response import FrequencyResponse
from elastid.store import text_file

_COLUMNS = (
    "configuration",
    "frequency",
    "frequency_std",
    "damping_ratio",
    "damping_ratio_std",
    "output",
    "input",
    "lines",
    "misfit",
)


def write_peaks(path: Path, responses: Sequence[FrequencyResponse], peaks: Sequence[Sequence[Peak]]) -> Path:
    """One row for each peak of each response; frequencies in Hz, or in units of an unknown sampling rate."""
    with text_file(path) as file:
        table = csv.writer(file, lineterminator="\n")
        table.writerow(_COLUMNS)
        for response, found in zip(responses, peaks, strict=True):
            for peak in found:
                numbers = (peak.freq_hz, peak.freq_std, peak.damping, peak.damping_std)
                place = (peak.output, peak.input, peak.lines, peak.misfit)
                table.writerow(map(csv_cell, (response.configuration.name, *numbers, *place)))
    return path
