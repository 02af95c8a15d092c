r"""The measurement chain around the mechanics: factors of torque loop, sensors and filters in a response.

.. math:: H(s) = \frac{1}{P_\tau(s T_\tau)} \cdot \frac{1}{P_y(s T_y)} \cdot \frac{1 - e^{-s T_\Delta}}{s T_\Delta}

Each element has one number with a name, which a fit may keep or find: torque_lag (T_tau), sensor_lag (T_y),
differentiator (T_Delta). The torque delay is always there, under the name `delay`.

A channel that is not calibrated reads g times what is there: gain_y_accelerometer_tool_z of a motion, gain_u_motor_1 of
a torque, so that the response that is measured is

.. math:: \hat G_{ij} = g_{y,i}\, G_{ij} / g_{u,j}

Every place has such gains; they are 1, and parameters only where a study names them.
"""

from collections.abc import Collection, Iterable
from typing import Annotated, Literal

from elastid.base.section import Key, section
from elastid.base.units import Time
from elastid.robot.placement import Numbers


def gain_name(role: str, place: str) -> str:
    """The name of a channel's gain, by the role and place of the channel.

    >>> gain_name("y", "accelerometer tool z")
    'gain_y_accelerometer_tool_z'
    """
    return f"gain_{role}_{place}".replace(" ", "_")


@section
class ChannelGain:
    """Gain of a channel: its reading over the true value, 1 where it is calibrated."""

    # fmt: off
    role: Annotated[Literal["u", "y"], Key("Role of the channel, `u` of a torque, `y` of a motion.", "y for a motion "
        "sensor; u moves a whole column, and with it all inertias of that motor.")]
    at: Annotated[str, Key("Place of the channel on the robot.", "spelt as in the channels, so that the parameter "
        "gain_y_... is found.")]
    gain: Annotated[float, Key("Gain of the channel, a positive factor; the start of a fit that names it "
        "(gain_y_accelerometer_tool_z), and held by others.", "the number of a calibration; 1 is the start where the "
        "fit is to find it.", above=0)] = 1.0
    # fmt: on


@section
class Chain:
    """Elements between torque command and logged motion; those without a number are not there."""

    # fmt: off
    torque_lag: Annotated[Time | None, Key("Time constant of the torque loop.", "0.2 to 1 ms for modern current loops, "
        "where u is a command; leave it out for measured current.", above=0)] = None
    torque_order: Annotated[Literal[1, 2], Key("Order of the torque loop: 1, or 2 with torque_damping.", "2 for loops "
        "that overshoot, or with a filter behind the controller.")] = 1
    torque_damping: Annotated[float, Key("Damping ratio of a torque loop of second order.", "lower for a loop that "
        "rings; without torque_order: 2 it does nothing.", above=0)] = 0.7
    sensor_lag: Annotated[Time | None, Key("Time constant 1 / (2 pi corner) of the low-pass filter of the logged "
        "motions.", "from the corner in the drive's manual; in doubt let the fit find it, with a prior.",
        above=0)] = None
    sensor_order: Annotated[Literal[1, 2, 3, 4], Key("Order of that filter, a Butterworth filter.", "as in the data "
        "sheet of the anti-aliasing filter; order 4 delays 2.6 times as long as order 1 with the same corner.")] = 1
    differentiator: Annotated[Time | None, Key("Time over which a logged velocity is the difference of positions.",
        "one sample or the averaging time of the drive, where it logs speed of encoder counts.", above=0)] = None
    gains: Annotated[tuple[ChannelGain, ...], Key("Gains of channels that are not calibrated.", "for channels that "
        "were never calibrated, as accelerometers on magnets; keep the gain of at least one motor, since gains and "
        "inertias cannot be distinguished.")] = ()
    # fmt: on

    def __post_init__(self) -> None:
        channels = [(channel.role, channel.at) for channel in self.gains]
        for role, place in channels:
            if channels.count((role, place)) > 1:
                raise ValueError(f"gains has {role} at {place} twice; leave one out")

    @property
    def numbers(self) -> Numbers:
        """The time constant of each element that is present, and the gains that are listed."""
        times: Numbers = {name: ("s", (name,)) for name in self._times}
        return times | {gain_name(g.role, g.at): ("1", ("gains", i, "gain")) for i, g in enumerate(self.gains)}

    def gain(self, role: str, place: str) -> float:
        """The gain of a channel, 1 where none is listed."""
        return next((channel.gain for channel in self.gains if (channel.role, channel.at) == (role, place)), 1.0)

    def gains_at(self, motors: Iterable[str], places: Iterable[str]) -> dict[str, ChannelGain]:
        """Gains of torques at motors and of motions at places by name, 1 where none is listed."""
        channels = [ChannelGain("u", place, self.gain("u", place)) for place in motors]
        channels += [ChannelGain("y", place, self.gain("y", place)) for place in places]
        return {gain_name(channel.role, channel.at): channel for channel in channels}

    def check_places(self, motors: Collection[str], places: Collection[str]) -> None:
        """ValueError for a listed gain of a channel that cannot be."""
        for channel in self.gains:
            known = motors if channel.role == "u" else places
            if channel.at not in known:
                raise ValueError(f"chain.gains: no {channel.role} is at '{channel.at}'; there are {', '.join(known)}")

    @property
    def _times(self) -> dict[str, float]:
        """The time constants of the elements that are present, in s."""
        times = {name: getattr(self, name) for name in ("torque_lag", "sensor_lag", "differentiator")}
        return {name: value for name, value in times.items() if value is not None}
