"""What the modification indices say, as one sentence each: value, share of the excess, effect on k, and what to do."""

from __future__ import annotations

import math

from elastid.base.note import Note
from elastid.fit.diagnosis.modification.candidates import kind_of
from elastid.fit.modification_index import ModificationIndex
from elastid.fit.result import FitResult

# A number that explains less is not worth a sentence; where even the best explains less than the second, no one number
# is the reason.
MIN_SAID_SHARE = 0.1
MIN_REASON_SHARE = 0.3
# A sentence names so many others that cannot be distinguished, and the stiffness that moves most, if by so much.
MAX_ALIKE = 3
MIN_EFFECT = 0.005
# A prior that is recommended is not wider.
MAX_PRIOR_STD = 0.5
MISREAD = ("sign", "direction", "exchanged channels", "exchanged postures", "phase", "parts", "quantity", "scale")
_CHECK = {
    "sign": "check sign, scale and gear ratio of the channel",
    "direction": "check the axis of its joint, the sign of its ratio and the signs of its channels",
    "exchanged channels": "check which channel is which",
    "exchanged postures": "check which record is of which posture, and the angles of both",
    "phase": "they were written with the convention exp(-j omega t); take their complex conjugates",
    "parts": "check which column or field is which",
    "quantity": "check the quantity (position, velocity, acceleration) of the y channels",
    "scale": "check unit, scale, side (link or motor) and gear ratio of the channels, and the inertias of the robot",
}


def explanations(result: FitResult) -> tuple[Note, ...]:
    """A note on each index of the sequence that explains enough, and one where none does."""
    sequence = [one for one in result.indices if one.place]
    if not sequence:
        return ()
    if sequence[0].share < MIN_REASON_SHARE:
        return (_without_reason(sequence[0], result),)
    said = [one for one in sequence if one.share >= MIN_SAID_SHARE]
    return tuple(Note("modification-index", _sentence(one, result)) for one in said)


def _without_reason(best: ModificationIndex, result: FitResult) -> Note:
    return Note(
        "modification-index",
        f"no number that the fit held explains more than {_percent(best.share)} of what the residuals have beyond the "
        f"noise ({phrase(best)} does): an elastic joint may be missing in the robot's file; add those that are "
        "possible and let elastid compare --search find which the data show",
    )


def _sentence(one: ModificationIndex, result: FitResult) -> str:
    beside = "beside that, " if one.place > 1 else ""
    others = [_like(name, result) for name in one.alike[:MAX_ALIKE]]
    same = f" (or {', or '.join(others)}: the data cannot tell)" if others else ""
    share = f"{_percent(one.share)} of what the residuals have beyond the noise"
    return f"{beside}{phrase(one)}{same} would explain {share}{_effect(one, result)}: {advice(one, result)}"


def _like(name: str, result: FitResult) -> str:
    found = next((one for one in result.indices if one.name == name), None)
    return name if found is None else phrase(found)


def _effect(one: ModificationIndex, result: FitResult) -> str:
    name, change = one.most_moved(result.parameters.free_names)
    return f" and change {name} by {_change(1 + change)}" if abs(change) > MIN_EFFECT else ""


def phrase(one: ModificationIndex) -> str:
    """The change itself: `m_fore -4.8 % (75 to 71.4 kg)`, `a delay of 0.294 ms`."""
    if one.group == "scale":
        return f"channels in another scale ({one.name})"
    if one.group in MISREAD:
        return one.name
    step, value, changed = float(one.steps[0]), float(one.values[0]), one.changed[0]
    what, _, where = one.name.partition("_")
    if one.group == "payload":
        return _payload(one, where)
    if one.group == "time" and not one.log[0]:
        return _late(one.name, step)
    if one.group == "angle":
        axis, _, configuration = where.partition("@")
        there = f"in configuration {configuration}" if configuration else "in all configurations"
        return f"an angle of axis {axis} {math.degrees(step):+.2g} deg {there}"
    if one.group == "gain":
        return _gain(one.name, math.exp(step))
    if one.group == "rate":
        return f"a sampling rate {_change(1 + step)} (and motions from positions)"
    if one.group == "compliance":
        k = 1 / changed if changed > 0 else math.inf
        if what == "gear":
            return f"elasticity in the gear of axis {where} of {k:.2g} N*m/rad"
        body, _, axis = where.rpartition("_")
        return f"an elastic rotation of body {body} about its {axis} axis of {k:.2g} N*m/rad"
    if one.group == "position loop":
        whose = "all motors" if where == "*" else f"motor {where}"
        return f"a position loop of {math.sqrt(max(changed, 0.0)) / (2 * math.pi):.2g} Hz around {whose}"
    if one.name.endswith("*"):
        return f"{one.name} {_change(math.exp(step)) if one.log[0] else f'{step:+.3g}'}"
    unit = "" if one.units[0] == "1" else f" {one.units[0]}"
    by = _change(math.exp(step)) if one.log[0] else f"{step:+.3g}{unit}"
    return f"{one.name} {by} ({value:.4g} to {changed:.4g}{unit})"


def _payload(one: ModificationIndex, body: str) -> str:
    """Mass, centre and inertia of a body together; as a further mass where they are one."""
    mass, new = float(one.values[0]), one.changed[0]
    more = new - mass
    at = {
        name[-1]: (float(v), c)
        for name, v, c in zip(one.members, one.values, one.changed, strict=True)
        if name[0] == "c"
    }
    if not more > 0 or len(at) < 3:
        return f"mass, centre of mass and inertia of {body} ({mass:.4g} to {new:.4g} kg)"
    where = ", ".join(f"{(new * at[axis][1] - mass * at[axis][0]) / more:.2g}" for axis in "xyz")
    return f"{more:.2g} kg more on {body}, about [{where}] m in its axes"


def _late(name: str, T: float) -> str:
    form, _, where = next(
        (form, "_", name.removeprefix(form).lstrip("_"))
        for form in ("delay", "low_pass", "hold")
        if name.startswith(form)
    )
    role, _, at = where.partition("_")
    on = f" of {role} at {at.replace('_', ' ')}" if where else ""
    if form == "delay":
        return f"a delay of {T / 1e-3:.3g} ms{on}"
    if form == "low_pass":
        size = f"a low pass of first order of {abs(T) / 1e-3:.3g} ms ({1 / (2 * math.pi * abs(T)):.3g} Hz){on}"
        return size if T > 0 else f"{size} that was taken out where there is none"
    if T < 0:
        return f"a torque that acts {-T / 2e-3:.3g} ms earlier than it was taken to{on}"
    return f"a torque that acts {T / 2e-3:.3g} ms late, held for {T / 1e-3:.3g} ms{on}"


def _gain(name: str, factor: float) -> str:
    _, role, where = name.split("_", 2)
    what = "torques" if role == "u" else "motions"
    at = f"{what} of all channels" if where == "*" else f"{what[:-1]} at {where.replace('_', ' ')}"
    verb = "read" if where == "*" else "reads"
    return f"{at} that {verb} {_change(factor)}"


def _change(factor: float) -> str:
    """As a percentage, or a factor where that says more."""
    return f"{100 * (factor - 1):+.2g} %" if 0.5 < factor < 2 else f"a factor {factor:.3g}"


def _percent(share: float) -> str:
    return f"{min(100.0, 100 * share):.0f} %" if share < 0.995 else "99 % or more"


def advice(one: ModificationIndex, result: FitResult) -> str:
    """What to do about it."""
    if one.group in _CHECK:
        return _CHECK[one.group]
    what, _, where = one.name.partition("_")
    if one.group == "payload":
        return f"is a payload forgotten? give it as payload in the robot's file, or check body {where}"
    if one.group == "time" and not one.log[0]:
        return _late_advice(one, result)
    if one.group == "angle":
        return "check the zero of the axis, and the angles that the configurations have"
    if one.group == "gear ratio":
        return "check the ratios in the robot's file"
    if one.group == "rate":
        return "check rate_hz"
    if one.group == "compliance":
        return "add it to the robot's file with a spring, and let elastid compare --search judge it"
    if one.group == "position loop":
        return "is the torque that was logged the reference of a controller? log the torque or current of the drive"
    usual = min(kind_of(one.name).usual, MAX_PRIOR_STD)
    which = "torque constants, units and scales of the channels" if one.group == "gain" else "it"
    name = next(iter(one.members)) if what == "gain" and where.endswith("*") else one.name
    if one.name.startswith(("gain_u_*", "gain_y_*")):
        return f"check {which}"
    return f"check {which}, or give it a prior (fit.parameters: {{{name}: {{prior: {{std: {usual:g}}}}}}})"


def _late_advice(one: ModificationIndex, result: FitResult) -> str:
    delay = "free delay (fit.parameters: {delay: {}})"
    hold = next((each for each in result.indices if each.name == "hold" and each.name in (one.name, *one.alike)), None)
    if hold is not None and hold.steps[0] < 0:
        return "leave hold: zero-order out where u was measured, and check the delay"
    if hold is not None:
        said = (
            f"where u is a command that the drive holds, a sample at {1 / float(hold.steps[0]):.4g} Hz, say hold: "
            "zero-order in experiment.recorded (with rate_hz in experiment.responses)"
        )
        return (
            f"{said}; where the torque loop or a log delays it, {delay}" if "delay" in (one.name, *one.alike) else said
        )
    if one.name == "delay":
        return f"{delay}, or give the robot's chain its lags"
    if one.name == "low_pass":
        return "give the robot's chain the sensor_lag of its encoders, or the torque_lag of its drives"
    return "check the filter and the time stamps of this channel; a log leads to the fit once all channels are in time"
