r"""HYPOTHESES: every kind of cause that a diagnosis considers, with its usual size, its words and its plausibility.

To add one, write a function and an entry.  An entry may be put into this list, or handed to `identify`:

    def crosstalk(response: HeldResponse) -> dict[str, ComplexArray]:
        "Derivative to the share of motor 1's torque that is logged with that of motor 2."
        return {"crosstalk_2": -response.G @ np.array([[0.0, 0.0], [1.0, 0.0]])}

    MINE = Hypothesis("crosstalk", ("crosstalk",), Size(0.05, 0.5, unit="1"), columns=crosstalk,
                      advice="check the wiring of the current sensors")
    identify(responses, robot, spec, hypotheses=(MINE, *HYPOTHESES))

`hypothesis` describes the fields, `judge` how causes are judged: by the drop of V, the size of the change that it
takes relative to the usual one, and the plausibility of the family.
"""

import math
from dataclasses import replace
from itertools import pairwise

from elastid.fit.diagnosis.hypothesis import LIMITS, SCALE, Hypothesis, Size, axis, relative
from elastid.fit.diagnosis.missing_springs import find_missing_springs
from elastid.fit.diagnosis.readings import FORMS, READINGS, find_lateness, find_misreading
from elastid.fit.diagnosis.sensitivities import (
    channel_delays,
    gear_couplings,
    gear_ratios,
    of_one_posture,
    posture_angles,
    stiffening,
)
from elastid.fit.diagnosis.variants import find_variants
from elastid.fit.result import ModificationIndex

GAIN_U, GAIN_Y = Size(0.05, math.log(2), True, "1"), Size(0.01, math.log(2), True, "1")
INERTIA = Size(0.05, math.log(3), True)  # of a motor
CHANNELS = "check torque constants, units and scales of the channels, and rate_hz"
DEGREES_LOG = 0.1  # of a scale about pi / 180, within which it is said to be that


def gain(index: ModificationIndex) -> str:
    """Factor by which a channel, or all channels of one kind, read wrongly."""
    _, role, where = index.name.split("_", 2)
    signals, factor = "torques" if role == "u" else "motions", relative(math.exp(float(index.steps[0])))
    if where == "*":
        return f"{signals} of all channels that read {factor}"
    return f"{signals[:-1]} at {where.replace('_', ' ')} that reads {factor}"


def angle(index: ModificationIndex) -> str:
    """Offset of an axis, in one configuration or in all."""
    where = "" if "@" in index.name else " in all configurations"
    return f"an angle of axis {axis(index)} {math.degrees(float(index.steps[0])):+.2g} deg{where}"


def angles(index: ModificationIndex) -> str:
    """Offsets of an axis that differ between configurations, the largest first."""
    by_size = sorted(zip(index.steps.tolist(), index.members, strict=True), key=lambda pair: -abs(pair[0]))
    where = ", ".join(
        f"{math.degrees(step):+.2g} deg in {member.partition('@')[2]}" for step, member in by_size[: LIMITS.named]
    )
    return f"angles of axis {axis(index)} that are off by {where}"


def compliance(index: ModificationIndex) -> str:
    """Stiffness of a gear, a base or a body that the file has as rigid."""
    kind, _, where = index.name.partition("_")
    k = 1 / index.changed[0] if index.changed[0] > 0 else math.inf
    if kind == "gear":
        return f"elasticity in the gear of axis {where} of {k:.2g} N*m/rad"
    if kind == "base":
        return f"an elastic base about its {where} axis of {k:.2g} N*m/rad"
    body, _, axis = where.rpartition("_")
    return f"an elastic rotation of body {body} about its {axis} axis of {k:.2g} N*m/rad"


def payload(index: ModificationIndex) -> str:
    """Mass, centre and inertia of a body together; where a mass is added, its place."""
    body, mass, new = axis(index), float(index.values[0]), index.changed[0]
    members = zip(index.members, index.values, index.changed, strict=True)
    place = [f"{(new * c - mass * float(c_0)) / (new - mass):.2g}" for name, c_0, c in members if name[0] == "c"]
    at = f", about [{', '.join(place)}] m in its axes" if new > mass and len(place) == 3 else ""
    return f"{new - mass:+.2g} kg on {body} ({mass:.4g} to {new:.4g} kg){at}"


def late(index: ModificationIndex) -> str:
    """Delay or low pass of a channel or of all, with its time."""
    T = float(index.steps[0])
    form = next(form for form in FORMS if index.name.startswith(form))
    role, _, place = index.name.partition("@")[0].removeprefix(form).lstrip("_").partition("_")
    on = f" of {role} at {place.replace('_', ' ')}" if role else ""
    if form == "delay":
        return f"a delay of {T / 1e-3:.3g} ms{on}"
    size = f"a low pass of first order of {abs(T) / 1e-3:.3g} ms ({1 / (2 * math.pi * abs(T)):.3g} Hz)"
    return f"{size}{on}" if T > 0 else f"{size} that was taken out where there is none{on}"


def scale(index: ModificationIndex) -> str:
    """Factors of channels in another unit."""
    factors = [float(word) for before, word in pairwise(index.name.replace(",", "").split()) if before == "times"]
    is_degrees = factors and all(abs(math.log(math.radians(1) / factor)) < DEGREES_LOG for factor in factors)
    return f"{'degrees read as radians' if is_degrees else 'channels in another scale'} ({index.name})"


def load(index: ModificationIndex) -> str:
    """Change of a gear's stiffness with the torque it carries."""
    gear, percent = f"a stiffness of gear {axis(index)} that rises with the torque", 100 * float(index.steps[0])
    if index.name.startswith("play"):
        return f"{gear} out of a gap ({-percent:+.2g} % at the smallest torque of these postures)"
    return f"{gear} it carries ({percent:+.2g} % at the largest torque of these postures)"


def coupling(index: ModificationIndex) -> str:
    """Turns of a motor with another axis."""
    motor, joint = index.name.split("_")[1:3]
    return f"a gear that turns motor {motor} along by {float(index.steps[0]):+.3g} of its ratio when axis {joint} turns"


def words_of_one_posture(index: ModificationIndex) -> str:
    """Delay, torques or stiffness of one configuration."""
    if index.name.startswith("delay"):
        return late(index)
    what = "torques that read" if index.name.startswith("torques") else f"a stiffness of gear {axis(index)} of"
    return f"{what} {100 * float(index.steps[0]):+.2g} %"


LATE, RATIO = Size(5e-4, 0.05, unit="s"), Size(0.005, math.log(1.5), True, "1")

HYPOTHESES: tuple[Hypothesis, ...] = (
    # Channels and clocks.
    Hypothesis("gain", ("gain_u",), GAIN_U, True, gain, CHANNELS),
    Hypothesis("gain", ("gain_y",), GAIN_Y, True, gain, CHANNELS),
    Hypothesis(
        "time",
        ("delay", "low"),
        LATE,
        False,
        late,
        "check time stamps, filters and `hold` of its channel; of all channels, free delay (fit.parameters: {{delay: "
        "{{}}}}), or give the robot's chain its lags, sensor_lag of its encoders and torque_lag of its drives",
        columns=channel_delays,
        search=find_lateness,
    ),
    Hypothesis("time", ("torque", "sensor", "differentiator"), Size(0.3, math.log(10), True)),
    Hypothesis(
        "gear ratio", ("ratio",), RATIO, True, advice="check the ratios in the robot's file", columns=gear_ratios
    ),
    Hypothesis(
        "angle",
        ("angle", "zero"),
        Size(0.02, 0.6, unit="rad"),
        phrase=angle,
        advice="check the zero of the axis, the angles that the configurations have, its brake and its encoder",
        columns=posture_angles,
    ),
    Hypothesis(
        "angles by posture",
        ("angles",),
        phrase=angles,
        advice="check the angles that the configurations have; does its brake hold, and does its encoder slip?",
    ),
    # The robot's file.
    Hypothesis("motor inertia", ("Jm",), INERTIA, True),
    Hypothesis("mass", ("m",), Size(0.05, math.log(3), True)),
    Hypothesis("centre of mass", ("c",), Size(0.01, 0.3)),
    Hypothesis("centre of mass", ("a",), Size(0.05, 0.5)),
    Hypothesis("inertia", ("I",), Size(0.15, math.log(5), True)),
    Hypothesis("stiffness", ("k", "km", "ki", "kc", "k2", "k2s", "k3"), Size(0.3, math.log(30), True)),
    Hypothesis("damping", ("d", "dm", "f", "fm"), Size(0.5, math.log(100), True)),
    Hypothesis("length", ("p", "pj", "p1", "p2", "pc1", "pc2", "l", "L0"), Size(0.005, 0.2)),
    Hypothesis(
        "payload",
        phrase=payload,
        advice="is a payload forgotten? give it as payload in the robot's file, or check body {where}",
        plausibility=20.0,  # what a robot carries changes, its links do not
        columns=of_one_posture,
    ),
    Hypothesis(
        "payload of one posture",
        phrase=payload,
        advice="was it measured with another load? leave it out, or say which configurations carry the payload",
        is_stated=False,
    ),
    Hypothesis(
        "one posture",
        ("delay@", "torques@", "spring@"),
        Size(0.03, 2.0, unit="1"),
        phrase=words_of_one_posture,
        advice="check the time stamps and the start of its files; was it measured warm, on another day, or on another "
        "robot? leave it out, or measure it again",
        is_stated=False,
    ),
    # What gears do besides.
    Hypothesis(
        "load",
        ("load", "play"),
        Size(0.1, 1.0, unit="1"),
        phrase=load,
        advice="does the gear harden, or has it backlash? give its spring cubic or backlash in the robot's file",
        columns=stiffening,
        is_stated=False,
    ),
    Hypothesis(
        "gear coupling",
        ("coupling",),
        Size(0.1, 2.0, unit="1"),
        phrase=coupling,
        advice="give it as gears in the robot's file",
        columns=gear_couplings,
        is_stated=False,
    ),
    *READINGS,
    Hypothesis(
        SCALE,
        phrase=scale,
        advice="check unit, scale, side (link or motor) and gear ratio of the channels, and the inertias of the robot",
        search=find_misreading,
    ),
    # What the robot's file lacks.
    Hypothesis(
        "compliance",
        ("torsion", "gear", "base"),
        Size(math.inf, math.inf, unit="rad/(N*m)", grows=True),
        phrase=compliance,
        advice="add it to the robot's file with a spring, and let elastid compare --search judge it",
        search=find_missing_springs,
    ),
    Hypothesis(
        "gravity",
        phrase="{name} instead of the file's",
        advice="check gravity in the robot's file: how is its base mounted?",
        search=find_variants,
    ),
    Hypothesis(
        "postures",
        phrase="{name}",
        advice="check unit, direction and order of the angles of experiment.configurations against the robot's axes",
    ),
    Hypothesis(
        "side of the gear",
        phrase="{name}",
        advice="the robot's file takes the inertia of a motor on the motor side, in kg*m^2",
    ),
    Hypothesis(
        "side of the encoder",
        phrase="the {name}",
        advice="give its channel the place that it reads, `motor` before the elastic gear or `joint` behind it",
    ),
    Hypothesis(
        "payload of the file",
        phrase="{name}",
        advice="take payload out of the robot's file, or say which configurations carry it",
    ),
    Hypothesis("number", ("*",), Size(0.1, 1.0, True)),
)
# For fits that are compared: those of other robots take longer than the fit, and no status depends on them.
WITHOUT_OTHER_ROBOTS = tuple(h if h.search is not find_variants else replace(h, search=None) for h in HYPOTHESES)
