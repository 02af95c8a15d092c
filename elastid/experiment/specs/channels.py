"""The channels of log files, and the structure that they name in a study without a robot."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Annotated, Literal, TypeAlias, cast

import numpy as np

from elastid.base.arrays import FloatArray
from elastid.base.names import Name
from elastid.base.section import Key, section
from elastid.base.units import TABLE, Frequency, Time, TorqueConstant, factor, of_translation, units_of, usual_spelling
from elastid.record import MOTION_UNIT, Hold, drive_unit
from elastid.robot import Channel, Robot

# SI units of a channel's quantity.
QUANTITY_UNIT = {**MOTION_UNIT, "torque": "N*m", "force": "N", "current": "A", "voltage": "V", "temperature": "degC"}
MOTIONS = tuple(MOTION_UNIT)
# Unit of a thermometer: factor and offset to degC.
TEMPERATURES = {"degC": (1.0, 0.0), "K": (1.0, -273.15), "degF": (5 / 9, -160 / 9)}


@section
class ChannelSpec:
    """One signal of the log files: its place in the file, and its place and quantity on the robot or structure.

    Value = sign * scale * file value, then unit, then torque_constant, then the gear ratio for side: motor.
    """

    # fmt: off
    role: Annotated[Literal["r", "u", "d", "y", "t", "reference"], Key("Role of the signal: r injected torque, u "
        "acting torque, d a known disturbance at a motor that is not in its u, which is added to it and need not "
        "repeat, y motion; in studies of friction also t temperature of a joint, and reference: the position of a "
        "motor that the controller was asked for, by which validation moves the model.", "the torque that reaches the "
        "motor is u, be it measured or computed from current; what was added to the controller's output is r; a pulse, "
        "a weight or a hand whose force on the axis was measured is d.")]
    at: Annotated[Name, Key("Place on the robot (`motor 1`, `joint 1`, `body arm z`, `frame tool x`; "
        "`accelerometer tool x` for a sensor that feels gravity); without a robot any name, such as `shaker` or `tip "
        "x`.", "where the sensor sits; a motor encoder that the controller shows as joint angle is still at the motor, "
        "with side: link.")]
    channel: Annotated[str, Key("Name of the signal in the file: variable of a MATLAB file (`theta_m`, `rec.torque` "
        "inside a struct), column heading of a CSV file, or path of an HDF5 dataset.", "the name as `elastid inspect "
        "FILE` prints it.")] = ""
    column: Annotated[int | None, Key("Number of the column in a matrix; the first is 1.", "for files without "
        "headings, and for matrices, in addition to the name of the matrix.")] = None
    quantity: Annotated[
        Literal["torque", "force", "current", "voltage", "position", "velocity", "acceleration", "temperature"], Key(
        "Quantity that the channel holds; voltage, and a current without torque_constant, in studies without a robot "
        "alone.", "the default fits torques; motions must say theirs. Positions are best where logged: the derivative "
        "is exact on the lines.")] = "torque"
    unit: Annotated[str, Key("Unit of the file after `scale`; default SI, needed without a robot.", "wherever the file "
        "is not in SI: deg, rpm, mm; for multiples of gravity scale: 9.80665. A response that is off by a factor of "
        "57.3 lacks a deg.")] = ""
    scale: Annotated[float, Key("Factor of the file's numbers.", "counts to a unit, such as 360 / 65536 with unit: "
        "deg.")] = 1.0
    sign: Annotated[Literal[1, -1], Key("Sign of the sensor: -1 where it counts the other way.", "where torque and "
        "acceleration of one motor have opposite phase well below the first resonance.")] = 1
    torque_constant: Annotated[TorqueConstant | None, Key("Torque constant of a current.", "that of the data sheet, on "
        "the motor's side; its error is a factor of a whole column of the response, which gain_u_motor_1 in "
        "fit.parameters can find.")] = None
    side: Annotated[Literal["link", "motor"], Key("Side of the gear that it is measured on (`motor` refers to motors "
        "that gears couple all together).", "motor for raw drive signals: angles are then divided by the ratio, "
        "torques multiplied by it.")] = "link"
    file: Annotated[int, Key("Number of the file of an experiment that holds the signal; 1 is `path` and 2 the first "
        "of `also`.", "where drive and data logger write two files; their clocks are aligned by a signal that both "
        "hold.")] = 1
    rate_hz: Annotated[Frequency | None, Key("Sampling rate of the channel where it differs; all channels are brought "
        "to the lowest one, band-limited.", "a temperature at 1 Hz or an accelerometer at 10 kHz, unlike the "
        "controller's rate; slower ones bound the band of all.", above=0)] = None
    delay: Annotated[Time, Key("Time by which the channel is later than the true signal, of either sign; elastid "
        "corrects it. Roles u and y.", "the cycle by which a drive reports its current late; if it is not known, "
        "identify delay_u in fit.parameters.")] = 0.0
    low_pass_hz: Annotated[Frequency | None, Key("Corner of a low pass of first order in the channel; elastid corrects "
        "it. Roles u and y.", "the corner of the current filter in the drive's parameters.", above=0)] = None
    hold: Annotated[Hold | None, Key("Course of an acting torque (role u) between its samples, where it differs from "
        "that of the section.", "where commanded and measured torques stand in one log.")] = None
    # fmt: on

    def __post_init__(self) -> None:
        if self.file < 1:
            raise ValueError(f"file is {self.file}; the first file of an experiment is 1")
        if not self.channel and self.column is None:
            raise ValueError("give channel (a name in the file), column (a number, the first is 1), or both")
        if self.column is not None and self.column < 1:
            raise ValueError(f"column is {self.column}; the first column is 1")
        fits_motion = self.is_motion == (self.role in ("y", "reference"))
        fits_reference = self.role != "reference" or self.quantity == "position"
        if not (fits_motion and fits_reference) or (self.quantity == "temperature") != (self.role == "t"):
            raise ValueError(
                f"role {self.role} does not go with quantity {self.quantity}: r, u, d are torques, y a motion, t a "
                "temperature, reference a position"
            )
        if self.role == "t" and self.side == "motor":
            raise ValueError("side is of a gear, which changes no temperature; leave it out with role t")
        if self.at.startswith("accelerometer ") and self.quantity in ("position", "velocity"):
            raise ValueError(f"quantity {self.quantity} at {self.at}: an accelerometer measures acceleration")
        if self.hold is not None and self.role != "u":
            raise ValueError(f"hold is of an acting torque (role u), not of role {self.role}; leave it out here")
        if (self.delay or self.low_pass_hz) and self.role not in ("u", "y"):
            raise ValueError(f"delay and low_pass_hz are of roles u and y, not of {self.role}; leave them out here")
        if self.scale == 0:
            raise ValueError("scale is 0; the channel would be lost")

    @property
    def errors(self) -> tuple[Channel, ...]:
        """Delay and low pass of the channel, none where it has neither."""
        low_pass_s = 0.0 if self.low_pass_hz is None else 1 / (2 * math.pi * float(self.low_pass_hz))
        is_exact = not (self.delay or low_pass_s)
        return () if is_exact else (Channel(cast(Literal["u", "y"], self.role), delay=self.delay, low_pass=low_pass_s),)

    @property
    def is_motion(self) -> bool:
        """True for a position, a velocity or an acceleration."""
        return self.quantity in MOTIONS

    @property
    def name_in_file(self) -> str:
        """The channel as it is called in the file."""
        column = "" if self.column is None else f"column {self.column}"
        return " ".join(filter(None, (self.channel, column)))

    @property
    def full_name(self) -> str:
        """The channel as it is called in the file, and its role and place on the robot."""
        return f"channel {self.name_in_file} ({self.role} at {self.at})"

    @property
    def drive(self) -> str:
        """The unit of an input that stays neither torque nor force; empty for one that is or becomes one."""
        if self.quantity == "voltage" or (self.quantity == "current" and self.torque_constant is None):
            return QUANTITY_UNIT[self.quantity]
        return ""

    def unit_factor(self, slides: bool) -> float:
        """SI units of the channel's unit; slides: its place translates (m, N). ValueError for a wrong unit."""
        if self.quantity == "temperature":
            return self._temperature[0]
        unit = QUANTITY_UNIT[self.quantity]
        if self.unit == "g" and self.quantity == "acceleration":
            raise ValueError("unit 'g' is the gram; for multiples of gravity give scale: 9.80665 and unit: m/s^2")
        return factor(self.unit, of_translation(unit) if slides else unit) if self.unit else 1.0

    @property
    def offset(self) -> float:
        """The offset added behind the factors: that of a temperature to degC."""
        return self._temperature[1] if self.quantity == "temperature" else 0.0

    @property
    def _temperature(self) -> tuple[float, float]:
        unit = usual_spelling(self.unit or "degC")
        if unit not in TEMPERATURES:
            raise ValueError(f"unit '{unit}' measures no temperature; units that fit here: {', '.join(TEMPERATURES)}")
        return TEMPERATURES[unit]


# SI units of what translates.
_TRANSLATIONS = {drive_unit(True), *map(of_translation, MOTION_UNIT.values())}


@dataclass(frozen=True)
class Structure:
    """The stand-in for the robot of a study without one: which places there are, and which of them translate.

    motor_locations: the inputs, where a robot has motors.  translating: the places that are measured in m and N.
    """

    motor_locations: tuple[str, ...]
    translating: tuple[str, ...]

    @classmethod
    def from_channels(cls, channels: Sequence[ChannelSpec]) -> Structure:
        """The structure that the channels of a study name."""
        inputs = dict.fromkeys(channel.at for channel in channels if channel.role == "u")
        return cls(tuple(inputs), tuple(dict.fromkeys(channel.at for channel in channels if _translates(channel))))

    @property
    def driven_names(self) -> tuple[str, ...]:
        """No joints."""
        return ()

    @property
    def mixing(self) -> FloatArray:
        """No gear couples its inputs: the identity."""
        return np.eye(len(self.motor_locations))

    def ratio(self, joint: str) -> float:
        """KeyError: it has no gears."""
        raise KeyError(f"a structure has no joint {joint}")

    def count_refusal(self, count: int) -> str:
        """Why a configuration cannot have so many angles; empty where it can."""
        return "a study without a robot has no joints, and so no angles; write [], or give it" if count else ""

    def check_location(self, location: str) -> None:
        """Every name is a place."""

    def slides(self, location: str) -> bool:
        """True if a place translates, so that it is measured in m and N."""
        return location in self.translating

    def sliding(self, locations: Iterable[str]) -> tuple[str, ...]:
        """The places among `locations` that translate."""
        return tuple(dict.fromkeys(location for location in locations if self.slides(location)))


# A robot, or a structure in its place.
Places: TypeAlias = Robot | Structure


def input_units(channels: Iterable[ChannelSpec], places: Places) -> tuple[str, ...]:
    """The unit of each input, where one is a voltage or a current; empty where all are torques and forces."""
    inputs = [channel for channel in channels if channel.role == "u"]
    units = tuple(channel.drive or drive_unit(places.slides(channel.at)) for channel in inputs)
    return units if any(channel.drive for channel in inputs) else ()


def channel_refusal(channel: ChannelSpec, channels: Sequence[ChannelSpec], places: Places) -> tuple[str, str]:
    """The key of a channel that does not go with a robot, or with none, and why; empty texts where all do."""
    if isinstance(places, Robot):
        if channel.quantity == "voltage":
            return "quantity", (
                "a voltage is not known as a torque of the robot; give the torque or the current that was logged, or "
                "drop robot for a study of responses alone"
            )
        needed = "a current needs torque_constant (N*m/A) to become a torque"
        return ("quantity", needed) if channel.drive else ("", "")
    if channel.side == "motor":
        return "side", "a study without a robot has no gears; drop side, and give scale where the sensor needs it"
    turning = QUANTITY_UNIT[channel.quantity]
    known = (of_translation(turning), turning)
    if not channel.unit and known[0] != turning:
        choice = f"give unit: {known[0]} or {turning}"
        return "unit", f"without a robot it is unknown if '{channel.at}' translates; {choice}"
    measures = TABLE.get(channel.unit, ("", 1.0))[0]
    if known[0] != turning and measures not in known and channel.unit != "g":
        fitting = ", ".join(name for dimension in known for name in units_of(dimension))
        return "unit", f"unit '{channel.unit}' does not measure {channel.quantity}; units that fit here: {fitting}"
    turning_too = [c for c in channels if c.at == channel.at and not c.drive and not _translates(c)]
    if not channel.drive and _translates(channel) and turning_too:
        return "at", (
            f"{channel.name_in_file} translates at '{channel.at}', {turning_too[0].name_in_file} turns there; give one "
            f"of the two places another name, for example {channel.at} rotation"
        )
    return "", ""


def _translates(channel: ChannelSpec) -> bool:
    """True if the unit of a channel is that of a translation."""
    return channel.quantity == "force" or TABLE.get(channel.unit, ("", 1.0))[0] in _TRANSLATIONS
