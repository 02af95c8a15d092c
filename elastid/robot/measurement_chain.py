r"""Measurement chain: factors of torque loop, sensors, filters and channels in a response.

.. math:: H(s) = \frac{1}{P_\tau(s T_\tau)} \cdot \frac{1}{P_y(s T_y)} \cdot \frac{1 - e^{-s T_\Delta}}{s T_\Delta}

Each element has one parameter: torque_lag (T_tau), sensor_lag (T_y), differentiator (T_Delta). The torque delay always
exists; its name is `delay`.

A logged channel has a gain g, a time delay T_d and a low pass of first order T_l (gain_u_motor_1, delay_u_motor_1,
low_pass_y_motor_1; delay_u and low_pass_u of all torques). The measured response is

.. math:: \hat G_{ij} = \frac{F_{y,i}}{F_{u,j}}\, G_{ij}, \qquad F = \frac{g\, e^{-s T_d}}{1 + s T_l}

References have the same numbers (delay_r): they act as F r. The gains of the joint controllers are factors of the
stated ones (gain_kp_motor_1, gain_kd_motor_1).

A negative T_l is the inverse filter 1 + s |T_l|: only quotients F_y / F_u are identifiable. The default values are 1, 0
and 0; they are parameters only if a study names them.
"""

import re
from collections.abc import Collection, Iterable, Sequence
from typing import Annotated, Literal

from elastid.base.arrays import ComplexArray
from elastid.base.section import Key, section
from elastid.base.units import Time
from elastid.robot.placement import Numbers

# Numbers of a channel: unit, and value of a channel without error.
CHANNEL_NUMBERS = {"gain": ("1", 1.0), "delay": ("s", 0.0), "low_pass": ("s", 0.0)}
MEANINGS = {
    "gain": "ratio of the logged to the true value of {}",
    "delay": "time delay of {} in the log, relative to the true signal, s",
    "low_pass": "time constant of the first-order low-pass filter between {} and the log, s",
    "gain kp": "ratio of the true to the stated position gain k_p of the joint controller of {}",
    "gain kd": "ratio of the true to the stated velocity gain k_d of the joint controller of {}",
    "gain r": "ratio of the acting to the logged value of {}",
    "delay r": "time delay between {} and the controller, s",
    "low_pass r": "time constant of the first-order low-pass filter between {} and the controller, s",
}
SIGNALS = {"u": "torque", "y": "output", "r": "reference"}


def channel_name(kind: str, role: str, location: str = "") -> str:
    """Return the name of a number of a channel, or of all channels of a role.

    >>> channel_name("gain", "y", "accelerometer tool z"), channel_name("delay", "u")
    ('gain_y_accelerometer_tool_z', 'delay_u')
    """
    return "_".join(filter(None, (kind, role, location))).replace(" ", "_")


def channel_meaning(name: str) -> str:
    """Return the meaning of a number of a channel by its name; empty for any other name.

    >>> channel_meaning("delay_r"), channel_meaning("gain_kd_motor_1")[:40]
    ('time delay between all references and the controller, s', 'ratio of the true to the stated velocity')
    """
    match = re.fullmatch(rf"({'|'.join(CHANNEL_NUMBERS)})_(kp|kd|[uyr])(?:_(.+))?", name)
    if match is None:
        return ""
    kind, role, location = match[1], match[2], (match[3] or "").replace("_", " ")
    signal = SIGNALS.get(role, "")
    owner = location or "all motors" if not signal else f"the {signal} of {location}" if location else f"all {signal}s"
    return MEANINGS.get(f"{kind} {role}", MEANINGS[kind]).format(owner)


def low_pass_response(s: ComplexArray, T: float) -> ComplexArray:
    """Return the response of a first-order low pass with time constant T in s, or its inverse if T is negative."""
    return 1 / (1 + s * T) if T >= 0 else 1 - s * T


MAX_DELAY_S = 0.05  # of a channel: four cycles of the slowest controllers


@section
class Channel:
    """Errors of a logged channel: gain (logged over true value), time delay and low pass."""

    # fmt: off
    role: Annotated[Literal["u", "y", "r", "kp", "kd"], Key("Role of the channel: `u` torque, `y` position, velocity "
        "or acceleration, `r` reference. `kp`, `kd`: gain of a joint controller relative to the stated one.", "`y` for "
        "a sensor; `u` scales all inertias of that motor; `r` with delay if references act with a delay.")]
    at: Annotated[str, Key("Location of the channel on the robot (default: all channels of the role).", "spell it as "
        "in the channels of the study.")] = ""
    gain: Annotated[float, Key("Ratio of the logged to the true signal; in fit.parameters gain_u_motor_1, for "
        "example.", "from a calibration; 1 if the fit estimates it.", above=0)] = 1.0
    delay: Annotated[Time, Key("Time delay of the logged signal relative to the true one, of either sign; in "
        "fit.parameters delay_u_motor_1, or delay_u for all torques.", "one cycle if the log contains the torque "
        "of the previous cycle.", least=-MAX_DELAY_S, most=MAX_DELAY_S)] = 0.0
    low_pass: Annotated[Time, Key("Time constant of a first-order low-pass filter between the true and the logged "
        "signal; in fit.parameters low_pass_u_motor_1, for example.", "1 / (2 pi corner) of the filter of a logged "
        "current.")] = 0.0
    # fmt: on


@section
class Chain:
    """Elements between torque command and logged motion; omitted without a value."""

    # fmt: off
    torque_lag: Annotated[Time | None, Key("Time constant of the torque loop (default: no lag).", "0.2 to 1 ms for "
        "modern current loops if u is a command; omit it for measured current.", above=0)] = None
    torque_order: Annotated[Literal[1, 2], Key("Order of the torque loop: 1, or 2 with torque_damping.", "2 for loops "
        "that overshoot, or with a filter behind the controller.")] = 1
    torque_damping: Annotated[float, Key("Damping ratio of a second-order torque loop.", "lower for a loop with "
        "overshoot; needs torque_order: 2.", above=0)] = 0.7
    sensor_lag: Annotated[Time | None, Key("Time constant 1 / (2 pi corner) of the low-pass filter of the logged "
        "position signals (default: no filter).", "from the corner frequency in the drive's manual; if it is "
        "uncertain, fit it with a prior.", above=0)] = None
    sensor_order: Annotated[Literal[1, 2, 3, 4], Key("Order of the sensor filter (Butterworth).", "from the data sheet "
        "of the anti-aliasing filter; order 4 has 2.6 times the delay of order 1 at the same corner.")] = 1
    differentiator: Annotated[Time | None, Key("Time span over which logged velocities are differences of positions "
        "(default: exact derivative).", "one sample, or the averaging time of the drive, for speeds computed from "
        "encoder counts.", above=0)] = None
    channels: Annotated[tuple[Channel, ...], Key("Gains, time delays and low-pass filters of logged channels.", "for "
        "uncalibrated channels such as accelerometers on magnets, and for filtered or delayed currents; keep the gain "
        "of at least one motor fixed, since gains and inertias are confounded.")] = ()
    # fmt: on

    def __post_init__(self) -> None:
        channels = [(channel.role, channel.at) for channel in self.channels]
        for role, location in channels:
            if channels.count((role, location)) > 1:
                raise ValueError(f"channels has {role} at {location or 'all places'} twice; leave one out")

    @property
    def numbers(self) -> Numbers:
        """Unit and path of the time constant of each element, and of the numbers of listed channels."""
        numbers: Numbers = {name: ("s", (name,)) for name in self._times}
        for i, channel in enumerate(self.channels):
            for kind, (unit, ideal) in CHANNEL_NUMBERS.items():
                if (kind == "gain" and channel.at) or getattr(channel, kind) != ideal:
                    numbers[channel_name(kind, channel.role, channel.at)] = (unit, ("channels", i, kind))
        return numbers

    def channel_numbers(self, motors: Sequence[str], locations: Sequence[str]) -> dict[str, tuple[Channel, str]]:
        """Return channel and kind of each possible number of torques, references, gains and motions, by name."""
        channels = {(channel.role, channel.at): channel for channel in self.channels}
        places_of_role = {"u": motors, "y": locations, "r": motors, "kp": motors, "kd": motors}
        keys = [(role, place) for role, at in places_of_role.items() for place in ("", *at) if place or role in "uyr"]
        return {
            channel_name(kind, *key): (channels.get(key, Channel(*key)), kind)  # type: ignore[arg-type]
            for key in keys
            for kind in CHANNEL_NUMBERS
            if (key[1] or kind != "gain") and (key[0] in "uyr" or kind == "gain")
        }

    def at(self, role: str, locations: Iterable[str]) -> list[tuple[Channel, ...]]:
        """Return the listed channels of a role at each location, including channels for all locations."""
        channels = [channel for channel in self.channels if channel.role == role]
        return [tuple(channel for channel in channels if channel.at in ("", location)) for location in locations]

    def check_locations(self, motors: Collection[str], locations: Collection[str]) -> None:
        """Raise ValueError for a listed channel that does not exist, and for a common gain of a role."""
        for channel in self.channels:
            names = locations if channel.role == "y" else motors
            if (channel.at and channel.at not in names) or (not channel.at and channel.gain != 1):
                raise ValueError(
                    f"chain.channels: no {channel.role} is at '{channel.at}'; there are {', '.join(names)}"
                )

    @property
    def _times(self) -> dict[str, float]:
        times = {name: getattr(self, name) for name in ("torque_lag", "sensor_lag", "differentiator")}
        return {name: value for name, value in times.items() if value is not None}
