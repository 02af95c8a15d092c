"""Kinematics, Newton's law and energy distinguish quantity, unit and sign of channels."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from plants.lab_logs import N, measured, save_csv, study_of, with_names
from plants.notes import said

from elastid.excitation.multisine import synthesise
from elastid.experiment.specs.channels import ChannelSpec
from elastid.recorded.channel_guess import derivative, motion_relations, torque_relation, travel
from elastid.recorded.link_side import drive_notes

RATE = 500.0
J, F, COULOMB = 3.0, 8.0, 5.0


def motion(seed: int = 0) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Position, velocity, acceleration (n,) of four sines for 20 s."""
    rng = np.random.default_rng(seed)
    t = np.arange(10_000) / RATE
    omega, phase = 2 * np.pi * rng.uniform(0.2, 2, 4), rng.uniform(0, 6, 4)
    parts = [
        [w ** (k - 1) * np.sin(w * t + p + k * np.pi / 2) for w, p in zip(omega, phase, strict=True)] for k in range(3)
    ]
    return tuple(np.sum(part, axis=0) * 0.2 for part in parts)  # type: ignore[return-value]


def torque(seed: int = 0) -> np.ndarray:
    _, v, a = motion(seed)
    return J * a + F * v + COULOMB * np.sign(v) + 0.1 * np.random.default_rng(9).standard_normal(len(v))


@pytest.mark.parametrize("order", [0, 1, 2])
def test_the_derivative_of_a_sine_is_damped_as_the_gaussian_says(order: int) -> None:
    """omega^k exp(-(s omega)^2 / 2), with a phase of k quarter turns."""
    omega, width = 2 * np.pi * 20 / RATE, 8.0
    t = np.arange(2000)
    expected = (omega * RATE) ** order * np.exp(-((width * omega) ** 2) / 2) * np.sin(omega * t + order * np.pi / 2)
    assert derivative(np.sin(omega * t), order, RATE, width) == pytest.approx(expected[48:-48], abs=1e-6 * RATE**order)


@pytest.mark.parametrize(("first", "second"), [(0, 1), (1, 0), (0, 2), (1, 1)])
def test_the_order_between_two_motions_and_their_gain_are_found(first: int, second: int) -> None:
    """With an encoder of 4096 counts, and speed in rpm."""
    signals = [np.round(x * 650) / 650 for x in motion()]
    gain = 60 / (2 * np.pi)
    relations = list(motion_relations(signals[first], -gain * signals[second], RATE))
    best = max(relations, key=lambda r: abs(r.correlation))
    assert best.order == second - first
    assert best.gain == pytest.approx(-gain, rel=0.03)
    assert best.correlation < -0.99


def test_motions_of_two_joints_have_no_relation() -> None:
    assert all(abs(r.correlation) < 0.9 for r in motion_relations(motion(1)[0], motion(2)[1], RATE))


@pytest.mark.parametrize("order", [0, 1, 2])
def test_newtons_law_has_the_inertia_of_the_joint_from_each_motion(order: int) -> None:
    relation = torque_relation(torque(), motion()[order], order, RATE)
    assert relation.explained > 0.97  # the integral of an acceleration has lost its mean
    assert relation.inertia == pytest.approx(J, rel=0.03)
    assert not relation.is_against_motion


def test_travel_leaves_a_single_spike_out() -> None:
    x = np.concatenate([np.linspace(0, 1, 5000), [1e6]])
    assert travel(x) == pytest.approx(1.0, rel=0.01)


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


def test_signals_that_do_not_move_are_left_to_other_checks(tmp_path: Path, log: dict[str, np.ndarray]) -> None:
    """Two dead currents are equal, and no copy of each other."""
    assert _same_signal_notes(tmp_path, log | {"i2": np.full_like(log["i1"], 3.0)}, "i2") == []
