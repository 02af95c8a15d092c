"""Channels by name, unit, neighbours and the motion of their joint; and silence where evidence is weak."""

import re
from typing import Any

import numpy as np
import pytest

from elastid.experiment.specs.channels import ChannelSpec
from elastid.logs.channel_doubts import channel_doubts, doubts_by_names
from elastid.logs.channel_guess import guess_log
from elastid.logs.channel_names import guess_by_name, label_by_words
from elastid.logs.clocks import is_clock
from elastid.logs.motion_relations import derivative, motion_relations, torque_relation
from elastid.robot import Body, Joint, Limits, Motor, Robot

RATE = 500.0
T = np.arange(8000) / RATE


def moved(k: int = 0, J: float = 3.0, gravity: float = 0.0) -> tuple[np.ndarray, ...]:
    """Position, velocity, acceleration and torque (n,) of a joint with friction that moves as sines of its own."""
    rng = np.random.default_rng(k)
    omega, phase = 2 * np.pi * rng.uniform(0.2, 1.4, 4), rng.uniform(0, 6, 4)
    q, v, a = (
        sum(0.2 * w ** (m - 1) * np.sin(w * T + p + m * np.pi / 2) for w, p in zip(omega, phase, strict=True))
        for m in range(3)
    )
    u = J * a + 8 * v + 5 * np.sign(v) + gravity * np.cos(q) + 0.1 * rng.standard_normal(len(T))
    return q, v, a, u


def test_unit_in_file_outranks_unit_in_name() -> None:
    assert guess_by_name("channel_1", None, "deg/s").quantity == "velocity"


def test_joints_are_named_by_numbers_or_words_that_two_kinds_share() -> None:
    arm = [f"{joint}_joint_{kind}" for kind in ("pos", "effort") for joint in ("shoulder_pan", "elbow", "wrist_1")]
    arms = [f"{side}_joint_{i}_{kind}" for kind in ("q", "tau") for side in ("left", "right") for i in (1, 2)]
    encoders = ["primary1_pos", "primary2_pos", "secondary1_pos", "secondary2_pos", "torque1", "torque2"]
    for names, joints in (
        (arm, {"shoulder pan", "elbow", "wrist 1"}),
        (arms, {"left 1", "left 2", "right 1", "right 2"}),
        (encoders, {"1", "2"}),
    ):
        guesses = label_by_words([guess_by_name(name, None) for name in names])
        assert {guess.joint_label for guess in guesses} == joints


def test_resisting_controller_is_no_mirrored_torque() -> None:
    """u = J a - k_d v with a motion from outside; alone, the same torque has the wrong sign."""
    (q, v, a, _), noise = moved(0), np.random.default_rng(9).standard_normal(len(T))
    u = 0.1 * a - 8 * v + 5.5 * np.std(v) * np.convolve(noise, np.ones(400) / 20, "same")
    assert torque_relation(u, q, 0, RATE).is_against_motion
    assert not torque_relation(u, q, 0, RATE, others=[(moved(1)[0], 0)]).is_against_motion
    mirrored = -moved(0)[3]
    assert torque_relation(mirrored, q, 0, RATE, others=[(moved(1)[0], 0)]).is_against_motion


def test_torques_and_motions_are_paired_with_unit_and_sign() -> None:
    """In any order; angles in deg beside speeds in rad/s, of which the second angle is mirrored."""
    joints = [moved(k) for k in range(2)]
    signals = [(f"{name}_{k + 1}", joints[k][i]) for k in range(2) for name, i in (("tau", 3), ("w", 1))]
    signals += [(f"pos_{k + 1}", np.rad2deg(joints[k][0]) * (-1) ** k) for k in range(2)]
    guess = guess_log([(guess_by_name(name, None), x) for name, x in signals[::-1]], RATE)
    pairs = {joint.torque.name: joint.motion for joint in guess.joints}
    assert {name: motion.name for name, motion in pairs.items()} == {"tau_1": "pos_1", "tau_2": "pos_2"}
    assert pairs["tau_1"].unit == "deg"
    assert (pairs["tau_1"].sign, pairs["tau_2"].sign) == (1, -1)
    assert guess.is_motion
    assert guess_log([(guess_by_name("tau_1", None), joints[0][3])], RATE) is None  # one signal is no log


def test_noise_and_spikes_of_a_torque_are_no_vibration() -> None:
    """Noise has six times the std of the torque; a vibration measured by a coarse encoder remains a vibration."""
    q, *_, u = moved(0)
    noise = 6 * np.std(u) * np.random.default_rng(2).normal(size=len(q))
    spikes = 60 * np.std(u) * (np.arange(len(q)) % 701 == 0)
    shaken = np.round(np.cumsum(np.cumsum(noise - noise.mean())) / 300)
    for torque, motion, is_motion in ((u + noise, q, True), (u + spikes, q, True), (noise, shaken, False)):
        guess = guess_log([(guess_by_name("tau", None), torque), (guess_by_name("q", None), motion)], RATE)
        assert guess.is_motion == is_motion


def test_a_joint_at_rest_is_beside_a_motion() -> None:
    """Its torque is noise, and its position moves by counts of its encoder."""
    q, *_, u = moved(0)
    rest = np.random.default_rng(2).normal(size=(2, len(q)))
    signals = {"tau_1": u, "q_1": q, "tau_2": rest[0], "q_2": 1e-5 * np.round(rest[1])}
    assert guess_log([(guess_by_name(name, None), x) for name, x in signals.items()], RATE).is_motion
    del signals["tau_1"], signals["q_1"]
    assert not guess_log([(guess_by_name(name, None), x) for name, x in signals.items()], RATE).is_motion


def test_stamps_are_a_clock_and_a_motion_is_none() -> None:
    rng = np.random.default_rng(0)
    assert is_clock(1000 + np.cumsum(rng.choice([0.01, 0.012], 3000)))
    assert is_clock(T)
    assert not is_clock(moved()[0])
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
    joints = [moved(k, gravity=30.0) for k in range(3)]
    signals = [(name, u) for name, (*_, u) in zip(names[0], joints, strict=False)]
    signals += [(name, q) for name, (q, *_) in zip(names[1], joints, strict=True)]
    signals += [(f"temp_{k}", 30 + np.round(0.01 * T, 1)) for k in range(3)]
    guess = guess_log([(guess_by_name(name, None), x) for name, x in signals], RATE)
    assert [each.torque.name for each in guess.joints] == names[0]
    found = [each.motion.name for each in guess.joints] + [each.name for each in guess.other_outputs]
    assert found == names[1]


def position(name: str, k: int = 1, **keys: object) -> ChannelSpec:
    return ChannelSpec("y", f"motor {k}", name, **({"quantity": "position"} | keys))


@pytest.mark.parametrize(
    ("channels", "expected"),
    [
        ((ChannelSpec("u", "motor 1", "tau"), position("tau")), [(1, "channel")]),
        ((ChannelSpec("u", "motor 1", "phi_mot"), position("trq_mot")), [(0, "channel")]),
        (tuple(position(f"q_{k}", k, unit="deg" if k == 2 else "rad") for k in (1, 2, 3, 4)), [(1, "unit")]),
        ((position("Angle [deg]"),), [(0, "unit")]),
        ((position("Speed [rpm]", unit="deg"),), [(0, "quantity")]),
        ((ChannelSpec("u", "motor 1", "Torque [mNm]", unit="N*m"),), [(0, "unit")]),
        ((ChannelSpec("u", "motor 1", "tau"), position("q", unit="deg")), []),
        ((position("q_1", 1, unit="deg"), position("q_2", 2)), []),  # which of two is at fault, nothing says
        ((position("q_1", 1, unit="mm"), position("q_2", 2, unit="deg"), position("q_3", 3, unit="deg")), []),
        ((position("Angle [deg]", scale=0.01745),), []),
        (tuple(position("", k, column=k, unit="deg" if k == 2 else "rad") for k in (1, 2, 3, 4)), []),
    ],
)
def test_contradictions_are_found_at_their_channel(
    channels: tuple[ChannelSpec, ...], expected: list[tuple[int, str]]
) -> None:
    assert [(doubt.channel, doubt.key) for doubt in doubts_by_names(channels)] == expected


@pytest.mark.parametrize("order", [-1, 0, 1, 2])
def test_derivative_of_sine_has_gaussian_damping(order: int) -> None:
    """omega^k exp(-(s omega)^2 / 2), with a phase of k quarter turns."""
    omega, width = 2 * np.pi * 20 / RATE, 8.0
    t = np.arange(2000)
    expected = (omega * RATE) ** order * np.exp(-((width * omega) ** 2) / 2) * np.sin(omega * t + order * np.pi / 2)
    assert derivative(np.sin(omega * t), order, RATE, width) == pytest.approx(expected[48:-48], abs=1e-6 * RATE**order)


@pytest.mark.parametrize(("first", "second"), [(0, 1), (1, 0), (0, 2), (1, 1)])
def test_the_order_between_two_motions_and_their_gain_are_found(first: int, second: int) -> None:
    """With an encoder of 4096 counts, and speed in rpm."""
    signals = [np.round(x * 650) / 650 for x in moved()[:3]]
    gain = 60 / (2 * np.pi)
    relations = motion_relations(signals[first], -gain * signals[second], RATE)
    best = max(relations, key=lambda order: abs(relations[order].correlation))
    assert best == second - first
    assert relations[best].gain == pytest.approx(-gain, rel=0.03)
    assert relations[best].correlation < -0.99


@pytest.mark.parametrize(
    ("order", "gravity", "unit"), [(0, 0.0, 1.0), (0, 40.0, 1.0), (1, 40.0, 1.0), (2, 0.0, 1.0), (1, 0.0, 1e-12)]
)
def test_newtons_law_gives_inertia_from_each_motion(order: int, gravity: float, unit: float) -> None:
    """In any unit; where the angle is known or follows from the velocity, beside gravity."""
    motion = moved(gravity=gravity)
    relation = torque_relation(motion[3], unit * motion[order], order, RATE, turns=gravity > 0)
    assert relation.explained > 0.97  # the integral of an acceleration has lost its mean
    assert unit * relation.inertia == pytest.approx(3.0, rel=0.03)
    assert not relation.is_against_motion


def test_inertia_is_in_si_of_prefixed_torques_and_wrapped_angles() -> None:
    """3 kg*m^2 from mN*m and an angle that is read from -180 to 180 deg."""
    q, _, _, u = moved()
    angle = (np.rad2deg(20 * q) + 180) % 360 - 180
    signals = [(guess_by_name("torque [mNm]", None), 1e3 * u), (guess_by_name("angle [deg]", None), angle)]
    assert 20 * guess_log(signals, RATE).joints[0].relation.inertia == pytest.approx(3.0, rel=0.03)


RATIO = 50.0
U = ChannelSpec("u", "motor 1", "tau")
Q = ChannelSpec("y", "motor 1", "q", quantity="position")
NOISE = np.random.default_rng(5).standard_normal((5000, 3))
LINK = ChannelSpec("y", "joint 1", "link", quantity="position")


def robot(gear: float = RATIO, angle: tuple[float, float] = (-np.inf, np.inf)) -> Robot:
    joint = Joint("1", "z", motor=Motor(1e-3, gear), limits=Limits(angle=angle))
    return Robot("one", (Body("arm", joints=(joint,), inertia=2.0),), gravity=(0, 0, 0))


# Torque, motor and link position (n, 3) of a joint of 4.5 kg*m^2.
MOTION, *_, TORQUE = (0.3 * x for x in moved(J=4.5))
RIGHT = np.stack([TORQUE, MOTION, MOTION + 1e-5 * np.random.default_rng(3).standard_normal(len(MOTION))], axis=1)
SPEED = np.stack([*RIGHT[:, :2].T, np.gradient(RIGHT[:, 1], 1 / RATE)], axis=1)
TEN_TURNS = (1, 20 * np.pi / np.ptp(RIGHT[:, 1]))


@pytest.mark.parametrize(
    ("values", "factors", "keys", "expected"),
    [
        (RIGHT, (1, 1, 1), {}, []),
        (RIGHT, (1, 1, 1.6), {}, []),  # a gain, which the fit finds
        (NOISE, (1, 1, 1), {}, []),  # a joint at rest
        (RIGHT, (0.1, 10, 1), {}, [(2, "scale")]),  # the motor turns ten times as far: another gear
        (RIGHT, (1, 1, 57.3), {}, [(2, "unit")]),
        (RIGHT, (1, 57.3, 1), {}, [(1, "unit")]),
        (RIGHT, (1, 1, RATIO), {}, [(2, "side")]),
        (RIGHT, (1, RATIO, 1), {}, [(1, "side")]),
        (RIGHT, (1, 1, -1), {}, [(2, "sign")]),
        (RIGHT, (1, -1, 1), {}, [(1, "sign")]),
        (RIGHT, (-1, 1, 1), {}, [(0, "sign")]),
        (RIGHT, (1 / RATIO, 1), {}, [(0, "side")]),  # less inertia than the rotor has
        (RIGHT, (1 / RATIO, RATIO), {}, [(0, "side")]),
        (SPEED, (1, 1, 1), {}, [(2, "quantity")]),
        (RIGHT, (1, 1), {"angle": (-2.0, 2.0)}, []),
        (RIGHT, (1, 57.3), {"angle": (-2.0, 2.0)}, [(1, "unit")]),
        (RIGHT, TEN_TURNS, {}, [(1, "unit")]),  # a joint without limits behind a gear
        (RIGHT, TEN_TURNS, {"gear": 1.0}, []),
    ],
)
def test_channels_are_doubted_where_the_others_contradict_them(
    values: np.ndarray, factors: tuple[float, ...], keys: dict[str, Any], expected: list[tuple[int, str]]
) -> None:
    """The one that the other two contradict; signals before the gear have no contradiction but the inertia."""
    n = len(factors)
    doubts = channel_doubts((U, Q, LINK)[:n], values[:, :n] * factors, RATE, robot(**keys))
    assert [(doubt.channel, doubt.key) for doubt in doubts] == expected


D = ChannelSpec("d", "motor 1", "sensor", sign=-1)


@pytest.mark.parametrize("factor", [1, -1, 1e3, 1e2, 1e-3, 1 / RATIO])
@pytest.mark.parametrize(("gravity", "efficiency"), [(30.0, 1.0), (30.0, 0.7), (0.0, 1.0)])
@pytest.mark.parametrize("others", [0.0, 1.0])
def test_torque_sensor_behind_gear_is_doubted_by_motor_torque(
    factor: float, gravity: float, efficiency: float, others: float
) -> None:
    """Also behind a gear with losses, and moved by other joints; an inertia alone shows no unit that is too small."""
    q, v, a, _ = moved(J=0)
    noise = np.random.default_rng(8).standard_normal((2, len(q)))
    sensor = 2 * a + gravity * np.cos(q) + 3 * others * moved(1)[2] + 0.05 * noise[0]
    torque = 2.5 * a + 8 * v + 5 * np.sign(v) + sensor / efficiency + 0.1 * noise[1]
    doubts = channel_doubts((U, Q, D), np.stack([torque, q, factor * sensor], axis=1), RATE, robot())
    is_seen = factor == -1 or factor > 1 or (factor < 1 and (gravity or others))
    expected = [(2, "sign" if factor == -1 else "side" if factor == 1 / RATIO else "unit")] if is_seen else []
    assert [(doubt.channel, doubt.key) for doubt in doubts] == expected


@pytest.mark.parametrize("factor", [1, -1])
def test_joints_that_move_in_proportion_have_no_sign(factor: float) -> None:
    """A coupled torque that acts against the motion of its joint shows no sign, and none is written."""
    q, v, a, u = moved(0)
    signals = [("tau_1", u), ("q_1", q), ("tau_2", factor * (4 * a + 3 * v)), ("q_2", -0.8 * q)]
    guess = guess_log([(guess_by_name(name, None), x) for name, x in signals], RATE)
    assert [joint.motion.sign for joint in guess.joints] == [1, 1]


@pytest.mark.parametrize("seed", range(20))
def test_elastic_joint_on_slow_carrier_raises_no_doubt(seed: int) -> None:
    """Friction carries the slow torque, modes the multisine; the torque is up to two samples late."""
    rng = np.random.default_rng(seed)
    rate, n, rotor, load, k = 250.0, 6000, 2.5, 9.0, rng.uniform(2e4, 2e5)
    freq_hz = np.fft.rfftfreq(n, 1 / rate)
    lines = (freq_hz > 2) & (freq_hz < rng.uniform(15, 70))
    spectrum = np.zeros(len(freq_hz), complex)
    spectrum[lines] = np.exp(2j * np.pi * rng.uniform(size=lines.sum()))
    s = 2j * np.pi * np.maximum(freq_hz, freq_hz[1])
    d = 2e-2 * np.sqrt(k * rotor)
    compliance = (load * s**2 + d * s + k) / (s**2 * (rotor * load * s**2 + (rotor + load) * (d * s + k)))
    t = np.arange(n) / rate
    u, q = (np.fft.irfft(x, n) for x in (spectrum, spectrum * compliance))
    scale = 30.0 / u.std()
    slow = rng.uniform(0.3, 1.0) * np.sin(2 * np.pi * t / 8)
    motion = scale * q + slow
    torque = scale * u + 40.0 * np.tanh(20 * np.gradient(slow, t)) + 5 * np.gradient(motion, t) + rng.normal(size=n)
    late = int(rng.integers(0, 3))
    values = np.stack([np.roll(torque, late), motion + 1e-5 * rng.normal(size=n)], axis=1)
    assert not list(channel_doubts((U, Q), values, rate, robot()))
