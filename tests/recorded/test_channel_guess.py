"""Guesses of channels: by name, by unit, by Newton's law."""

import numpy as np
import pytest

from elastid.recorded.channel_guess import guess_by_name, guess_log

RATE = 500.0


@pytest.mark.parametrize(
    ("name", "quantity", "unit"),
    [
        ("rec.act_torque_abs_nm", "torque", "N*m"),
        ("rec.act_vel_mot_deg_per_s", "velocity", "deg/s"),
        ("Torque [Nm]", "torque", "N*m"),
        ("theta_mx", "position", ""),
        ("iq_adx", "current", ""),
        ("motorSpeed", "velocity", ""),
        ("acc (m/s^2)", "acceleration", "m/s^2"),
        ("Impact [N]", "force", "N"),
        ("hammer", "force", ""),
        ("qm", "position", ""),
        ("xyzzy", "", ""),
    ],
)
def test_names_as_loggers_write_them(name: str, quantity: str, unit: str) -> None:
    guess = guess_by_name(name, None)
    assert (guess.quantity, guess.unit) == (quantity, unit)


def test_a_unit_that_the_file_states_counts_more_than_the_name() -> None:
    assert guess_by_name("channel_1", None, "deg/s").quantity == "velocity"


def test_measured_signals_are_preferred_to_references() -> None:
    assert guess_by_name("iq_adx", None).rank > guess_by_name("iq_refx", None).rank


def rows(n: int = 2) -> list[tuple[object, np.ndarray]]:
    """Torques and angles in deg of joints that move as different sines, with speeds in rad/s; angle 2 is mirrored."""
    t = np.arange(10_000) / RATE
    signals = []
    for k in range(n):
        omega = np.array([1.1, 2.3, 3.1]) * (1 + 0.37 * k)
        q, v, a = (sum(0.3 * w**m * np.sin(w * t + m * np.pi / 2) for w in omega) for m in range(3))
        signals += [(f"tau_{k + 1}", 3 * a + 5 * v + 2 * np.sign(v)), (f"w_{k + 1}", v)]
        signals += [(f"pos_{k + 1}", np.rad2deg(q) * (-1) ** k)]
    return [(guess_by_name(name, None), x) for name, x in signals]


def test_torques_and_motions_are_paired_with_unit_and_sign() -> None:
    guess = guess_log(rows()[::-1], RATE)
    assert guess is not None
    pairs = {joint.torque.name: joint.motion for joint in guess.joints}
    assert {name: motion.name for name, motion in pairs.items()} == {"tau_1": "pos_1", "tau_2": "pos_2"}
    assert pairs["tau_1"].unit == "deg"
    assert (pairs["tau_1"].sign, pairs["tau_2"].sign) == (1, -1)
    assert guess.is_motion


def test_one_signal_is_no_log_of_a_machine() -> None:
    assert guess_log(rows(1)[:1], RATE) is None
