"""Torques that are held between samples, and torques that are no measured ones."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from plants.lab_logs import CHANNELS, RATE, N, measured, save_csv, study_of, with_names
from plants.notes import said

from elastid.excitation.multisine import synthesise
from elastid.experiment.specs.channels import ChannelSpec
from elastid.recorded.link_side import drive_notes

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


R, U = ChannelSpec("r", "motor 1", "r"), ChannelSpec("u", "motor 1", "u")


def _notes(r: np.ndarray, u: np.ndarray, N: int | None = N) -> list[str]:
    return [note.code for note in drive_notes((R, U), np.stack([r, u], axis=1), N, "record a")]


@pytest.mark.parametrize("step", [1, 2, 3])
@pytest.mark.parametrize("periodic", [True, False])
def test_a_mirrored_motor_is_named_whatever_the_lines(step: int, periodic: bool) -> None:
    """Odd lines too, where minus the signal is half a period of delay."""
    lines = np.arange(step, 60, 2 * step)
    phases = np.exp(2j * np.pi * np.random.default_rng(3).random((len(lines), 1)))
    x = np.tile(synthesise(lines, phases, N)[:, 0], 4)
    assert _notes(x, -x + 0.0, N if periodic else None) == ["records/torque"]
    assert _notes(x, 0.9 * x, N if periodic else None) == []


@pytest.mark.parametrize("step", [1, 2, 4])
@pytest.mark.parametrize("sign", [1, -1])
def test_feedback_that_turns_the_phase_mirrors_nothing(step: int, sign: int) -> None:
    """U = s^2 / (s^2 + 2 zeta w s + w^2) R of a stiff loop leads, as lines 3, 7, 11 do a quarter of a period late."""
    lines = np.arange(3, 80, step)
    ratio = 1j * lines / 15.0
    feedback = ratio**2 / (1 + 0.8 * ratio + ratio**2)
    for seed in range(10):
        phases = np.exp(2j * np.pi * np.random.default_rng(seed).random((len(lines), 1)))
        r, u = (np.tile(synthesise(lines, U, 400)[:, 0], 3) for U in (phases, phases * feedback[:, None]))
        assert _notes(r, sign * u, 400) == ([] if sign > 0 else ["records/torque"])


def _same_signal_notes(tmp_path: Path, log: dict[str, np.ndarray], second_current: str) -> list[str]:
    save_csv(tmp_path / "log.csv", log)
    channels = with_names({"i1": "i1", "i2": second_current, "phi": "phi", "w2": "w2"})
    notes = said(measured(tmp_path, study_of("log.csv", channels)).notes)
    return [note for note in notes if "holds the samples of" in note]


def test_a_signal_that_was_logged_twice_is_named(tmp_path: Path, log: dict[str, np.ndarray]) -> None:
    """A factor and an offset do not hide it; a part in a thousand of its own makes it another signal."""
    assert len(_same_signal_notes(tmp_path, log | {"i2": 7.0 - 2.5 * log["i1"]}, "i2")) == 1
    own = log["i1"] + 1e-3 * log["i2"]
    assert _same_signal_notes(tmp_path, log | {"i2": own}, "i2") == []
    # Two dead currents are equal, and no copy of each other.
    assert _same_signal_notes(tmp_path, log | {"i2": np.full_like(log["i1"], 3.0)}, "i2") == []
