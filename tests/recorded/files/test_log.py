"""Channels of a log by name."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from plants.lab_logs import measured, study_of, write_matlab
from plants.refusals import refused

from elastid.experiment.specs.channels import ChannelSpec


@pytest.mark.parametrize(
    ("name", "column", "message"),
    [
        ("rec.psi", None, ("rec.psi", "rec.phi", "rec.cur (2 x 800)")),
        ("rec.cur", None, ("2 signals", "column: 1 to 2")),
        ("rec.cur", 3, "column 3"),
        ("rec.note", None, ("rec.note", "<U5")),
        ("fs", None, "fs"),
        ("cells{1}", None, ("800", "50 samples")),
        ("", None, ()),
    ],
)
def test_a_channel_that_a_matlab_file_does_not_hold_is_named_with_those_it_has(
    name: str, column: int | None, message: str, tmp_path: Path, log: dict[str, np.ndarray]
) -> None:
    """Missing, a matrix without a column, a wrong column, a text, a scalar, another length, no name at all."""
    write_matlab(tmp_path, log)
    u = ChannelSpec("u", "motor 1", "run(1).w")
    y = ChannelSpec("y", "motor 1", name, column or (None if name else 1), "position")
    with refused("records/channels", holds=message):
        measured(tmp_path, study_of("log.mat", (u, y)))
