"""The planned lines of a study: those of its grid in its band, without those left free for detection."""

from __future__ import annotations

import numpy as np

from elastid.excitation.grids import Lines, chosen_lines, grid_lines, with_detection
from elastid.excitation.spec import MultisineSpec


def planned_lines(excitation: MultisineSpec, seed: int) -> Lines:
    """The lines of a study, those left free for detection drawn from its seed; StudyError where the band holds none."""
    N = excitation.period_samples
    if excitation.grid == "lines":
        chosen = chosen_lines(excitation.lines, excitation.band_hz, excitation.rate_hz, N)
        return Lines(chosen, np.zeros(0, np.int64))
    lines = grid_lines(excitation.grid, excitation.band_hz, excitation.rate_hz, N, excitation.ratio)
    if excitation.grid != "odd-random":
        return Lines(lines, np.zeros(0, np.int64))
    return with_detection(lines, excitation.group, np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(0,))))
