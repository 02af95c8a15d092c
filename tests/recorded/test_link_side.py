"""Torques that are held between samples: the keys of a study, and the record that follows from them."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from plants.lab_logs import CHANNELS, RATE, measured, save_csv, study_of

from elastid.experiment.specs.channels import ChannelSpec

FIRST, SECOND, *MOTIONS = CHANNELS


@pytest.mark.parametrize(
    ("section", "first", "second", "held"),
    [
        ("band-limited", None, None, (0.0, 0.0)),
        ("zero-order", None, None, (1.0, 1.0)),
        ("zero-order", "band-limited", None, (0.0, 1.0)),
        ("band-limited", None, "zero-order", (0.0, 1.0)),
    ],
)
def test_a_torque_is_held_as_its_channel_says_or_else_as_the_section_does(
    tmp_path: Path, log: dict[str, np.ndarray], section: Any, first: Any, second: Any, held: tuple[float, ...]
) -> None:
    """Y = G H U with H = 1 for a measured current, and the half sample and sinc of the rate for a command."""
    save_csv(tmp_path / "log.csv", log)
    channels = (replace(FIRST, hold=first), replace(SECOND, hold=second), *MOTIONS)
    record = measured(tmp_path, study_of("log.csv", channels, hold=section))
    freq_hz = np.array([RATE / 10])
    expected = np.sinc(0.1 * np.array(held)) * np.exp(-0.1j * np.pi * np.array(held))
    np.testing.assert_allclose(record.hold_response(freq_hz), [expected], rtol=1e-12)


def test_hold_is_a_key_of_torques_that_act() -> None:
    """Not of motions, nor of the reference, on which no response depends."""
    for channel in (MOTIONS[0], ChannelSpec("r", "motor 1", "r1")):
        with pytest.raises(ValueError, match=r"hold is of an acting torque \(role u\).*leave it out"):
            replace(channel, hold="zero-order")
