"""Guesses of channels: by name, by unit, by what is beside them."""

import re

import numpy as np
import pytest

from elastid.experiment.specs.channels import ChannelSpec
from elastid.recorded.channel_guess import doubts_by_names, guess_by_name, guess_log, is_clock

RATE = 500.0


def test_a_unit_that_the_file_states_counts_more_than_the_name() -> None:
    assert guess_by_name("channel_1", None, "deg/s").quantity == "velocity"


def test_the_unit_behind_a_name_is_no_part_of_a_place() -> None:
    assert guess_by_name("acc_a [m/s^2]", None).place == "acc_a"
    assert guess_by_name("x (left)", None).place == "x left"


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


CONTENT_RATE = 250.0
T = np.arange(5000) / CONTENT_RATE


def joint(k: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Position, velocity and torque (n,), with gravity and friction, of a joint of its own motion."""
    omega = np.array([0.9, 2.1, 3.3]) * (1 + 0.31 * k)
    q, v, a = (sum(0.2 * w**m * np.sin(w * T + w * k + m * np.pi / 2) for w in omega) for m in range(3))
    noise = 0.05 * np.random.default_rng(k).standard_normal(len(T))
    return q, v, 3 * a + 5 * v + 4 * np.sign(v) + 30 * np.cos(q) + noise


def test_stamps_are_a_clock_and_a_motion_is_none() -> None:
    rng = np.random.default_rng(0)
    assert is_clock(1000 + np.cumsum(rng.choice([0.01, 0.012], 3000)))
    assert is_clock(T)
    assert not is_clock(joint(0)[0])
    assert not is_clock(np.cumsum(rng.exponential(1.0, 3000)))


HEADINGS = """
TORQUE_AXIS_ACT_A#|AXIS_ACT_A#; $TORQUE_AXIS_ACT[#]|$AXIS_ACT[#]; motorTorque.j#|jointAngle.j#; Torque @|Pos @
@_TRQ|@_FB; Trq@|Fb@; trq_act_# [Nm]|pos_act_# [deg]; effort[#]|position[#]
/joint_states/joint_#/effort|/joint_states/joint_#/position; tau_J_#|q_#; actual_current_#|actual_q_#
Axis#.ActTorque|Axis#.ActPos; gAxis0#.ActTorque|gAxis0#.ActPosition; J# Torque(Nm)|J# Angle(deg)
Drehmoment_A#|Istposition_A#; Motormoment Achse #|Gelenkwinkel Achse #; M#_Nm|phi#_rad
Iststrom A# [A]|Istwinkel A# [°]; JntForce[#]|JntPos[#]; TorqueSensor#|Position#; J#_trq|J#_ang
a#_torque|a#_position; M#_Iq|M#_Theta; T#|Q#; tq#|pos#; Torque Axis # (Nm)|Position Axis # (rad)
r0080[#] Torque actual|r0482[#] position actual; tau_@|q_@; tau(#)|q(#)
drive#_torque_actual_value|drive#_position_actual_value; MotorCurrent_Ax#|JointPos_Ax#; hammer_N|a#
CURR J# [A]|ENC J# [deg]; Joint #. torque|Joint #. angle; Joint_Torque_J#|Joint_Angle_J#; Couple_axe#|Position_axe#
coppia_#|posizione_#; par_#|posicion_#; tau_meas_#|q_meas_#; tau_mot#|q_mot#; A#.trq.act|A#.pos.act; moment#|vinkel#
joint#_torque_nm|joint#_angle_deg; Torque_mea_AX#|Pos_mea_AX#; tune_torque_ref j#|pos_fdb j#; J#Trq|J#Pos
impact_kN|resp#; LoadCell_N|A#X; Fz [N]|acc#; MAIN.Axis#.NcToPlc.ActTorque|MAIN.Axis#.NcToPlc.ActPos
input_force|ch#; Kraft N|Beschl#
"""


@pytest.mark.parametrize("heading", re.split(r"[;\n]", HEADINGS.strip()))
def test_headings_of_drives_are_read(heading: str) -> None:
    """Torque and motion of three joints, beside commands and temperatures, or one force and three accelerations."""
    of_torque, of_motion = heading.strip().split("|")
    names = [
        list(dict.fromkeys(text.replace("#", str(k + 1)).replace("@", "SLU"[k]) for k in range(3)))
        for text in (of_torque, of_motion)
    ]
    joints = [joint(k) for k in range(3)]
    signals = [(name, u) for name, (*_, u) in zip(names[0], joints, strict=False)]
    signals += [(name, q) for name, (q, *_) in zip(names[1], joints, strict=True)]
    signals += [(f"temp_{k}", 30 + np.round(0.01 * T, 1)) for k in range(3)]
    guess = guess_log([(guess_by_name(name, None), x) for name, x in signals], CONTENT_RATE)
    assert guess is not None
    assert [each.torque.name for each in guess.joints] == names[0]
    found = [each.motion.name for each in guess.joints] + [each.name for each in guess.further]
    assert found == names[1]


def motion(name: str, k: int = 1, **keys: object) -> ChannelSpec:
    return ChannelSpec("y", f"motor {k}", name, **({"quantity": "position"} | keys))  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("channels", "expected"),
    [
        ((ChannelSpec("u", "motor 1", "tau"), motion("tau")), [(1, "channel")]),
        ((ChannelSpec("u", "motor 1", "phi_mot"), motion("trq_mot")), [(0, "channel")]),
        (tuple(motion(f"q_{k}", k, unit="deg" if k == 2 else "rad") for k in (1, 2, 3, 4)), [(1, "unit")]),
        ((motion("Angle [deg]"),), [(0, "unit")]),
        ((motion("Speed [rpm]", unit="deg"),), [(0, "quantity")]),
        ((ChannelSpec("u", "motor 1", "tau"), motion("q", unit="deg")), []),
        ((motion("q_1", 1, unit="deg"), motion("q_2", 2)), []),  # which of two is at fault, nothing says
        ((motion("q_1", 1, unit="mm"), motion("q_2", 2, unit="deg"), motion("q_3", 3, unit="deg")), []),
        ((motion("Angle [deg]", scale=0.01745),), []),
        (tuple(motion("", k, column=k, unit="deg" if k == 2 else "rad") for k in (1, 2, 3, 4)), []),
    ],
)
def test_contradictions_are_found_at_their_channel(
    channels: tuple[ChannelSpec, ...], expected: list[tuple[int, str]]
) -> None:
    assert [(doubt.channel, doubt.key) for doubt in doubts_by_names(channels)] == expected
