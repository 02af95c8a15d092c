"""Channels of a log by name."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from plants.lab_logs import measured, study_of, write_matlab

from elastid.base.errors import DataError
from elastid.experiment.specs.channels import ChannelSpec


@pytest.mark.parametrize(
    ("name", "column", "message"),
    [
        ("rec.psi", None, r"'rec.psi' is not in it; did you mean rec.phi\? There are rec.cur \(2 x 800\)"),
        ("rec.cur", None, "holds 2 signals of 800 samples; give column: 1 to 2"),
        ("rec.cur", 3, "has no column 3; it has 2, the first is column 1"),
        ("rec.note", None, "channel rec.note is no signal but <U5"),
        ("fs", None, "channel fs is no signal but"),
        ("cells{1}", None, "differ in length: run.1..w 800, cells.1. 50 samples"),
        ("", None, "give the name of a channel"),
    ],
)
def test_a_channel_that_a_matlab_file_does_not_hold_is_named_with_those_it_has(
    name: str, column: int | None, message: str, tmp_path: Path, log: dict[str, np.ndarray]
) -> None:
    """Missing, a matrix without a column, a wrong column, a text, a scalar, another length, no name at all."""
    write_matlab(tmp_path, log)
    u = ChannelSpec("u", "motor 1", "run(1).w")
    y = ChannelSpec("y", "motor 1", name, column or (None if name else 1), "position")
    with pytest.raises(DataError, match=message):
        measured(tmp_path, study_of("log.mat", (u, y)))
