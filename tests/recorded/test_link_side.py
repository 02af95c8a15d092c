"""Torques that are held between samples: the keys of a study, and the record that follows from them."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from plants.gears import wrist
from plants.lab_logs import CHANNELS, RATE, measured, save_csv, study_of

from elastid.base.errors import StudyError
from elastid.experiment.specs.channels import ChannelSpec
from elastid.recorded.rig import RecordedRig

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


def test_gears_do_not_mix_torques_of_different_holds(tmp_path: Path) -> None:
    """The torque of a joint would be half held; with one hold for all of them the rig is accepted."""
    robot = wrist()
    torques = tuple(ChannelSpec("u", f"motor {n}", f"t{n}", side="motor") for n in "456")
    motions = tuple(replace(c, role="y", quantity="position", channel=f"q{c.at[-1]}") for c in torques)
    (tmp_path / "log.csv").touch()
    alike = study_of("log.csv", (*torques, *motions), hold="zero-order")
    alike = replace(alike, configurations={"home": (0.0, 0.0, 0.0)})
    RecordedRig(robot, alike, tmp_path)
    mixed = (replace(torques[0], hold="band-limited"), *torques[1:], *motions)
    with pytest.raises(StudyError, match=r"t4 \(band-limited\).*t5 \(zero-order\).*with one hold"):
        RecordedRig(robot, replace(alike, recorded=replace(alike.as_recorded(), channels=mixed)), tmp_path)
