r"""HYPOTHESES: every kind of cause that a diagnosis considers, with its usual size, its words and its plausibility.

To add one, write a function and an entry.  An entry may be put into this list, or handed to `identify`:

    def crosstalk(response: HeldResponse) -> dict[str, ComplexArray]:
        "Derivative to the share of motor 1's torque that is logged with that of motor 2."
        return {"crosstalk_2": -response.G @ np.array([[0.0, 0.0], [1.0, 0.0]])}

    MINE = Hypothesis("crosstalk", ("crosstalk",), Size(0.05, 0.5, unit="1"), columns=crosstalk,
                      advice="check the wiring of the current sensors")
    identify(responses, robot, spec, hypotheses=(MINE, *HYPOTHESES))

`hypothesis` describes the fields, `ranking` how causes are judged: by the drop of V, the size of the change that it
takes relative to the usual one, and the plausibility of the family.
"""

from __future__ import annotations

import math
from dataclasses import replace
from itertools import pairwise

from elastid.fit.diagnosis.configurations import find_disagreement
from elastid.fit.diagnosis.hypothesis import CHECK_OR_PRIOR, SCALE, Hypothesis, Size, relative
from elastid.fit.diagnosis.lateness import find_lateness
from elastid.fit.diagnosis.misreadings import READINGS, find_misreading, find_wrong_frequency_unit
from elastid.fit.diagnosis.missing_springs import find_missing_springs
from elastid.fit.diagnosis.other_robots import find_other_robots
from elastid.fit.diagnosis.response_columns import (
    channel_delays,
    gear_couplings,
    gear_ratios,
    of_one_posture,
    posture_angles,
    rate_column,
    stiffening,
)
from elastid.fit.result import FitResult, ModificationIndex


def _gain(index: ModificationIndex) -> str:
    _, role, where = index.name.split("_", 2)
    signals, factor = "torques" if role == "u" else "motions", relative(math.exp(float(index.steps[0])))
    if where == "*":
        return f"{signals} of all channels that read {factor}"
    return f"{signals[:-1]} at {where.replace('_', ' ')} that reads {factor}"


def _gain_advice(index: ModificationIndex, _: FitResult) -> str:
    advice = CHECK_OR_PRIOR.partition(",")[0] if index.name.endswith("*") else CHECK_OR_PRIOR
    usual = (GAIN_U if index.name.startswith("gain_u") else GAIN_Y).usual
    text = advice.format(name=index.name, usual=usual)
    return text.replace("check it", "check torque constants, units and scales of the channels", 1)


def _angle(index: ModificationIndex) -> str:
    axis, _, configuration = index.name.partition("_")[2].partition("@")
    where = f"in configuration {configuration}" if configuration else "in all configurations"
    if index.units[0] == "m":
        return f"a position of axis {axis} {1e3 * float(index.steps[0]):+.2g} mm {where}"
    return f"an angle of axis {axis} {math.degrees(float(index.steps[0])):+.2g} deg {where}"


def _rate(index: ModificationIndex) -> str:
    return f"a sampling rate {relative(1 + float(index.steps[0]))} (and motions from positions)"


def _compliance(index: ModificationIndex) -> str:
    kind, _, where = index.name.partition("_")
    k = 1 / index.changed[0] if index.changed[0] > 0 else math.inf
    if kind == "gear":
        return f"elasticity in the gear of axis {where} of {k:.2g} N*m/rad"
    if kind == "base":
        return f"an elastic base about its {where} axis of {k:.2g} N*m/rad"
    body, _, axis = where.rpartition("_")
    return f"an elastic rotation of body {body} about its {axis} axis of {k:.2g} N*m/rad"


def _position_loop(index: ModificationIndex) -> str:
    where = index.name.partition("_")[2]
    whose = "all motors" if where == "*" else f"motor {where}"
    return f"a position loop of {math.sqrt(max(index.changed[0], 0.0)) / (2 * math.pi):.2g} Hz around {whose}"


def _payload(index: ModificationIndex) -> str:
    """Mass, centre and inertia of a body together; as a further mass where they are one."""
    body = index.name.partition("_")[2]
    mass, new = float(index.values[0]), index.changed[0]
    more = new - mass
    centres = {
        name[-1]: (new * changed - mass * float(value))
        for name, value, changed in zip(index.members, index.values, index.changed, strict=True)
        if name[0] == "c"
    }
    if not more > 0 or len(centres) < 3:
        return f"mass, centre of mass and inertia of {body} ({mass:.4g} to {new:.4g} kg)"
    centre = ", ".join(f"{centres[axis] / more:.2g}" for axis in "xyz")
    return f"{more:.2g} kg more on {body}, about [{centre}] m in its axes"


def _late(index: ModificationIndex) -> str:
    T = float(index.steps[0])
    form = next(form for form in ("delay", "low_pass", "hold") if index.name.startswith(form))
    role, _, place = index.name.removeprefix(form).lstrip("_").partition("_")
    on = f" of {role} at {place.replace('_', ' ')}" if role else ""
    if form == "delay":
        return f"a delay of {T / 1e-3:.3g} ms{on}"
    if form == "low_pass":
        size = f"a low pass of first order of {abs(T) / 1e-3:.3g} ms ({1 / (2 * math.pi * abs(T)):.3g} Hz)"
        if T > 0:
            return f"{size}{on}"
        if role == "y":
            return f"{size}{on} that was taken out where there is none"
        return f"{size} that torques pass before they are logged{on}"
    if T < 0:
        return f"a torque that acts {-T / 2e-3:.3g} ms earlier than it was taken to{on}"
    return f"a torque that acts {T / 2e-3:.3g} ms late, held for {T / 1e-3:.3g} ms{on}"


def _late_advice(index: ModificationIndex, result: FitResult) -> str:
    delay, names = "free delay (fit.parameters: {delay: {}})", (index.name, *index.alike)
    hold = next((i for i in result.indices if i.name == "hold" and i.name in names), None)
    if hold is not None and hold.steps[0] < 0:
        return "leave hold: zero-order out where u was measured, and check the delay"
    if hold is not None:
        text = (
            f"where u is a command that the drive holds, a sample at {1 / float(hold.steps[0]):.4g} Hz, say hold: "
            "zero-order in experiment.recorded (with rate_hz in experiment.responses)"
        )
        return f"{text}; where the torque loop or a log delays it, {delay}" if "delay" in names else text
    if index.name == "delay":
        return f"{delay}, or give the robot's chain its lags"
    if (index.name == "low_pass" or index.name.startswith("low_pass_u")) and index.steps[0] < 0:
        return "log torques before their filter, or take the filter out of what was logged"
    if index.name == "low_pass":
        return "give the robot's chain the sensor_lag of its encoders, or the torque_lag of its drives"
    return "check the filter and the time stamps of this channel; a log leads to the fit once all channels are in time"


def _by_posture(index: ModificationIndex) -> str:
    """Changes by posture, relative, the largest first."""
    changes = {name.partition("@")[2]: float(step) for name, step in zip(index.members, index.steps, strict=True)}
    mean = sum(changes.values()) / len(changes) if len(changes) > 1 else 0.0
    largest = sorted(changes, key=lambda posture: -abs(changes[posture] - mean))[:POSTURES]
    return ", ".join(f"{100 * (changes[posture] - mean):+.2g} % in {posture}" for posture in largest)


def _axis(index: ModificationIndex) -> str:
    return index.name.partition("@")[0].partition("_")[2]


def _scale(index: ModificationIndex) -> str:
    factors = [float(word) for before, word in pairwise(index.name.replace(",", "").split()) if before == "times"]
    is_degrees = factors and all(abs(math.log(math.radians(1) / factor)) < DEGREES_LOG for factor in factors)
    return f"{'degrees read as radians' if is_degrees else 'channels in another scale'} ({index.name})"


def _friction(index: ModificationIndex) -> str:
    return f"friction of motor {_axis(index)} that depends on the posture ({_by_posture(index)})"


def _transmission(index: ModificationIndex) -> str:
    return f"a transmission error of gear {_axis(index)} (effective ratio {_by_posture(index)})"


def _reading(index: ModificationIndex) -> str:
    return f"an encoder of motor {_axis(index)} that reads {_by_posture(index)}"


def _load(index: ModificationIndex) -> str:
    gear, percent = f"a stiffness of gear {_axis(index)} that rises with the torque", 100 * float(index.steps[0])
    if index.name.startswith("play"):
        return f"{gear} out of a gap ({-percent:+.2g} % at the smallest torque of these postures)"
    return f"{gear} it carries ({percent:+.2g} % at the largest torque of these postures)"


def _coupling(index: ModificationIndex) -> str:
    motor, joint = index.name.split("_")[1:3]
    return f"a gear that turns motor {motor} along by {float(index.steps[0]):+.3g} of its ratio when axis {joint} turns"


def _reference(index: ModificationIndex) -> str:
    gains = [float(step) for name, step in zip(index.members, index.steps, strict=True) if name.startswith("gain")]
    times = f", times {math.exp(-gains[0]):.3g}" if gains and abs(gains[0]) > GAIN_U.usual else ""
    return f"the reference of a controller{times} that was logged instead of the torque"


def _payload_of_one(index: ModificationIndex) -> str:
    return f"{_payload(replace(index, name=index.name.partition('@')[0]))}, in configuration {_posture(index)} alone"


def _posture(index: ModificationIndex) -> str:
    return index.name.partition("@")[2]


def _late_posture(index: ModificationIndex) -> str:
    T = float(index.steps[0]) / 1e-3
    return f"motions of configuration {_posture(index)} alone that are {T:.3g} ms late against its torques"


LATE, RATIO = Size(5e-4, 0.05, unit="s"), Size(0.005, math.log(1.5), True, "1")
GAIN_U, GAIN_Y = Size(0.05, math.log(2), True, "1"), Size(0.01, math.log(2), True, "1")

POSTURES = 3  # that a phrase names
DEGREES_LOG = 0.1  # of a scale about pi / 180, within which it is said to be that

HYPOTHESES: tuple[Hypothesis, ...] = (
    Hypothesis("frequency unit", notes=find_wrong_frequency_unit),
    # Channels and clocks.
    Hypothesis("gain", ("gain_u",), GAIN_U, True, _gain, _gain_advice),
    Hypothesis("gain", ("gain_y",), GAIN_Y, True, _gain, _gain_advice),
    Hypothesis("rate", ("rate",), Size(0.005, 0.2, unit="1"), False, _rate, "check rate_hz", columns=rate_column),
    Hypothesis(
        "time", ("delay", "low", "hold"), LATE, False, _late, _late_advice, columns=channel_delays, search=find_lateness
    ),
    Hypothesis(
        "time of one posture",
        ("delay@",),
        Size(1e-3, 0.05, unit="s"),
        phrase=_late_posture,
        advice="check time stamps and start of its files",
        is_stated=False,
    ),
    Hypothesis("time", ("torque", "sensor", "differentiator"), Size(0.3, math.log(10), True)),
    Hypothesis(
        "gear ratio", ("ratio",), RATIO, True, advice="check the ratios in the robot's file", columns=gear_ratios
    ),
    Hypothesis(
        "angle",
        ("angle", "zero"),
        Size(0.02, 0.6, unit="rad"),
        phrase=_angle,
        advice="check the zero of the axis, and the angles that the configurations have",
        columns=posture_angles,
    ),
    # The robot's file.
    Hypothesis("motor inertia", ("Jm",), Size(0.05, math.log(3), True), is_common=True),
    Hypothesis("mass", ("m",), Size(0.05, math.log(3), True)),
    Hypothesis("centre of mass", ("c",), Size(0.01, 0.3)),
    Hypothesis("centre of mass", ("a",), Size(0.05, 0.5)),
    Hypothesis("inertia", ("I",), Size(0.15, math.log(5), True)),
    Hypothesis("stiffness", ("k", "km", "ki", "kc", "k2", "k2s", "k3"), Size(0.3, math.log(30), True)),
    Hypothesis("damping", ("d", "dm", "f", "fm"), Size(0.5, math.log(100), True)),
    Hypothesis("length", ("p", "pj", "p1", "p2", "pc1", "pc2", "l", "L0"), Size(0.005, 0.2)),
    Hypothesis(
        "payload",
        phrase=_payload,
        advice="is a payload forgotten? give it as payload in the robot's file, or check body {where}",
        plausibility=20.0,  # what a robot carries changes, its links do not
        columns=of_one_posture,
    ),
    Hypothesis(
        "payload of one posture",
        phrase=_payload_of_one,
        advice="was it measured with another load? leave it out, or say which configurations carry the payload",
        is_stated=False,
    ),
    # What gears and motors do besides.
    Hypothesis(
        "load",
        ("load", "play"),
        Size(0.1, 1.0, unit="1"),
        phrase=_load,
        advice="does the gear harden, or has it backlash? give its spring cubic or backlash in the robot's file",
        columns=stiffening,
        is_stated=False,
    ),
    Hypothesis(
        "friction by posture",
        ("friction",),
        Size(0.5, 20.0, unit="1"),
        phrase=_friction,
        advice="does dry friction depend on the angle or the load? take it out (estimator.friction: auto)",
        is_stated=False,
    ),
    Hypothesis(
        "transmission",
        ("transmission",),
        Size(0.01, 0.3, unit="1"),
        phrase=_transmission,
        advice="measure it against a second encoder behind the gear; more postures average it",
        is_stated=False,
    ),
    Hypothesis(
        "reading by posture",
        ("reading",),
        Size(0.01, 0.3, unit="1"),
        phrase=_reading,
        advice="is its resolver or its disc eccentric? a motion over whole turns of the motor averages it",
        is_stated=False,
    ),
    Hypothesis(
        "gear coupling",
        ("coupling",),
        Size(0.1, 2.0, unit="1"),
        phrase=_coupling,
        advice="give it as gears in the robot's file",
        columns=gear_couplings,
        is_stated=False,
    ),
    # How the torque was logged.
    Hypothesis(
        "reference",
        phrase=_reference,
        advice="log the torque or current of the drive",
        is_stated=False,
    ),
    Hypothesis(
        "position loop",
        ("loop",),
        Size((2 * math.pi * 3) ** 2, math.inf, unit="1/s^2", grows=True),
        is_common=True,
        phrase=_position_loop,
        advice="is the torque that was logged the reference of a controller? log the torque or current of the drive",
    ),
    *READINGS,
    Hypothesis(
        SCALE,
        phrase=_scale,
        advice="check unit, scale, side (link or motor) and gear ratio of the channels, and the inertias of the robot",
        search=find_misreading,
    ),
    # What the robot's file lacks.
    Hypothesis(
        "compliance",
        ("torsion", "gear", "base"),
        Size(math.inf, math.inf, unit="rad/(N*m)", grows=True),
        phrase=_compliance,
        advice="add it to the robot's file with a spring, and let elastid compare --search judge it",
        search=find_missing_springs,
    ),
    Hypothesis(
        "gravity",
        phrase=lambda index: f"{index.name} instead of the file's",
        advice="check gravity in the robot's file: how is its base mounted?",
        search=find_other_robots,
    ),
    Hypothesis(
        "postures",
        phrase=lambda index: index.name,
        advice="check unit, direction and order of the angles of experiment.configurations against the robot's axes",
    ),
    Hypothesis(
        "side of the gear",
        phrase=lambda index: index.name,
        advice="the robot's file takes the inertia of a motor on the motor side, in kg*m^2",
    ),
    Hypothesis(
        "payload of the file",
        phrase=lambda index: index.name,
        advice="take payload out of the robot's file, or say which configurations carry it",
    ),
    Hypothesis("configurations", notes=find_disagreement),
    Hypothesis("number", ("*",), Size(0.1, 1.0, True)),
)
# For fits that are compared: those of other robots take longer than the fit, and no status depends on them.
WITHOUT_OTHER_ROBOTS = tuple(h if h.search is not find_other_robots else replace(h, search=None) for h in HYPOTHESES)
