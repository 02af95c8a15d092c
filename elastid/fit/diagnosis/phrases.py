"""Phrases of causes: the clause that states a change, from its modification index, and advice that depends on it."""

from __future__ import annotations

import math
from dataclasses import replace
from itertools import pairwise

from elastid.fit.diagnosis.hypothesis import CHECK_OR_PRIOR, POSTURES, Size, axis, posture, relative
from elastid.fit.result import ModificationIndex, Result

GAIN_U, GAIN_Y = Size(0.05, math.log(2), True, "1"), Size(0.01, math.log(2), True, "1")
INERTIA = Size(0.05, math.log(3), True)  # of a motor
DEGREES_LOG = 0.1  # of a scale about pi / 180, within which it is said to be that


def gain(index: ModificationIndex) -> str:
    """Factor by which a channel, or all channels of one kind, read wrongly."""
    _, role, where = index.name.split("_", 2)
    signals, factor = "torques" if role == "u" else "motions", relative(math.exp(float(index.steps[0])))
    if where == "*":
        return f"{signals} of all channels that read {factor}"
    return f"{signals[:-1]} at {where.replace('_', ' ')} that reads {factor}"


def gain_advice(index: ModificationIndex, _: Result) -> str:
    """Check of the channels, or a prior of a single one."""
    advice = CHECK_OR_PRIOR.partition(",")[0] if index.name.endswith("*") else CHECK_OR_PRIOR
    usual = (GAIN_U if index.name.startswith("gain_u") else GAIN_Y).usual
    text = advice.format(name=index.name, usual=usual)
    return text.replace("check it", "check torque constants, units and scales of the channels", 1)


def rate(index: ModificationIndex) -> str:
    """Sampling rate."""
    return f"a sampling rate {relative(1 + float(index.steps[0]))} (and motions from positions)"


def inertia_advice(index: ModificationIndex, _: Result) -> str:
    """Check of a motor's inertia, or a prior of one that is not beyond any."""
    if abs(float(index.steps[0])) > INERTIA.limit:
        return "check its unit and side: the file takes rotor, brake and input of the gear, in kg*m^2 of the motor"
    return CHECK_OR_PRIOR.format(name=index.name, usual=INERTIA.usual)


def angle(index: ModificationIndex) -> str:
    """Offset of an axis, in one configuration or in all."""
    axis, _, configuration = index.name.partition("_")[2].partition("@")
    where = f"in configuration {configuration}" if configuration else "in all configurations"
    if index.units[0] == "m":
        return f"a position of axis {axis} {1e3 * float(index.steps[0]):+.2g} mm {where}"
    return f"an angle of axis {axis} {math.degrees(float(index.steps[0])):+.2g} deg {where}"


def angles(index: ModificationIndex) -> str:
    """Offsets of an axis that differ between configurations, the largest first."""
    by_size = sorted(zip(index.steps.tolist(), index.members, strict=True), key=lambda each: -abs(each[0]))
    slides = index.units[0] == "m"
    sizes = [f"{1e3 * step:+.2g} mm" if slides else f"{math.degrees(step):+.2g} deg" for step, _ in by_size[:POSTURES]]
    named = (member.partition("@")[2] for _, member in by_size)
    where = ", ".join(f"{size} in {name}" for size, name in zip(sizes, named, strict=False))
    return f"{'positions' if slides else 'angles'} of axis {axis(index)} that are off by {where}"


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


def late(index: ModificationIndex) -> str:
    """Delay, low pass or hold of a channel or of all, with its time."""
    T = float(index.steps[0])
    form = next(form for form in ("delay", "low_pass", "hold") if index.name.startswith(form))
    role, _, place = index.name.removeprefix(form).lstrip("_").partition("_")
    on = f" of {role} at {place.replace('_', ' ')}" if role else ""
    if form == "delay":
        return f"a delay of {T / 1e-3:.3g} ms{on}"
    if form == "hold":
        when = f"late, held for {T / 1e-3:.3g} ms" if T > 0 else "earlier than it was taken to"
        return f"a torque that acts {abs(T) / 2e-3:.3g} ms {when}{on}"
    size = f"a low pass of first order of {abs(T) / 1e-3:.3g} ms ({1 / (2 * math.pi * abs(T)):.3g} Hz)"
    return f"{size}{on}" if T > 0 else f"{size} that was taken out where there is none{on}"


def late_advice(index: ModificationIndex, result: Result) -> str:
    """Keys that give a delay, a hold or a lag to the model, or the filter to check."""
    delay, names = "free delay (fit.parameters: {delay: {}})", (index.name, *index.alike)
    hold = next((i for i in result.indices if i.name == "hold" and i.name in names), None)
    if hold is not None and hold.steps[0] < 0:
        return "leave hold: zero-order out where u was measured, and check the delay"
    if hold is not None:
        T = float(hold.steps[0])
        text = (
            f"where u is a command that the drive holds, a sample at {1 / T:.4g} Hz, say hold: zero-order in "
            "experiment.recorded (with rate_hz in experiment.responses); where y are velocities that it makes of its "
            f"encoder, give the robot's file chain: {{differentiator: {1e3 * T:.4g} ms}}"
        )
        return f"{text}; where the torque loop or a log delays it, {delay}" if "delay" in names else text
    if index.name == "delay":
        return f"{delay}, or give the robot's chain its lags"
    if index.name.startswith("low_pass") and index.steps[0] < 0:
        return "log torques before their filter, or take the filter out of what was logged"
    if index.name == "low_pass":
        return "give the robot's chain the sensor_lag of its encoders, or the torque_lag of its drives"
    return "check the filter and the time stamps of this channel; a log leads to the fit once all channels are in time"


def scale(index: ModificationIndex) -> str:
    """Factors of channels in another unit."""
    factors = [float(word) for before, word in pairwise(index.name.replace(",", "").split()) if before == "times"]
    is_degrees = factors and all(abs(math.log(math.radians(1) / factor)) < DEGREES_LOG for factor in factors)
    return f"{'degrees read as radians' if is_degrees else 'channels in another scale'} ({index.name})"


def load(index: ModificationIndex) -> str:
    """Change of a gear's stiffness with the torque it carries."""
    percent = 100 * float(index.steps[0])
    return (
        f"a stiffness of gear {axis(index)} that rises with the torque it carries ({percent:+.2g} % at the largest "
        "torque of these postures)"
    )


def coupling(index: ModificationIndex) -> str:
    """Turns of a motor with another axis."""
    motor, joint = index.name.split("_")[1:3]
    return f"a gear that turns motor {motor} along by {float(index.steps[0]):+.3g} of its ratio when axis {joint} turns"


def payload_of_one(index: ModificationIndex) -> str:
    """Load in one configuration."""
    return f"{payload(replace(index, name=index.name.partition('@')[0]))}, in configuration {posture(index)} alone"


def of_one_posture(index: ModificationIndex) -> str:
    """Delay, torques or stiffness of one configuration."""
    where, step = f"configuration {posture(index)} alone", float(index.steps[0])
    if index.name.startswith("delay"):
        return f"motions of {where} that are {1e3 * step:.3g} ms late against its torques"
    what = "torques that read" if index.name.startswith("torques") else f"a stiffness of gear {axis(index)} of"
    return f"{what} {100 * step:+.2g} % in {where}"
