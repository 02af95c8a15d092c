"""The channels of log files, and the structure that they name in a study without a robot."""

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Annotated, Literal, TypeAlias, cast

import numpy as np

from elastid.base.arrays import FloatArray
from elastid.base.names import Name
from elastid.base.section import Key, section
from elastid.base.units import (
    Frequency,
    Time,
    TorqueConstant,
    dimension_and_size,
    si_factor,
    table_unit,
    translation_unit,
    units_of,
)
from elastid.record import MOTION_UNIT, Hold, drive_unit
from elastid.robot import MAX_DELAY_S, Channel, Robot

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
    role: Annotated[Literal["r", "u", "d", "y", "t", "reference"], Key("Role of the signal. `u` is the acting torque, "
        "`r` the injected torque, and `y` a position, velocity or acceleration. `d` is a measured disturbance torque "
        "that u does not include. `reference` is the commanded position, an instrument of the estimator joint. "
        "Friction studies also use `t` (joint temperature). A torque sensor behind the gear is `u` in a study without "
        "motor torques, and `d` with sign -1 in a friction study with motor torques.",
        "u is the torque at the motor, measured or computed from current; r is added to the controller's output.")]
    at: Annotated[Name, Key("Location on the robot: `motor 1`, `joint 1`, `body arm z`, `frame tool x`, or "
        "`accelerometer tool x` for a sensor that measures gravity; without a robot any name.", "location of the "
        "sensor; a motor encoder displayed as joint angle is `motor 1` with side: link.")]
    channel: Annotated[str, Key("Name of the signal in the file: MATLAB variable (`theta_m`, `rec.torque`), CSV "
        "column heading or HDF5 path (default: the key column).", "copy the name from `elastid inspect FILE`.")] = ""
    column: Annotated[int | None, Key("Number of the column in a matrix, from 1 (default: none; then channel).",
        "number of the signal in a file without headings, or the column of a matrix if `channel` names one.",
        least=1)] = None
    quantity: Annotated[Literal["torque", "force", "current", "voltage", "position", "velocity", "acceleration",
        "temperature"], Key("Quantity of the channel; voltage, and current without torque_constant, only in studies "
        "without a robot.", "the default is torque; prefer logged positions, whose derivative is exact at the DFT "
        "lines.")] = "torque"
    unit: Annotated[str, Key("Unit in the file after `scale` (default: SI; needed without a robot).", "for deg, rpm or "
        "mm; a response that is wrong by a factor of 57.3 lacks the unit deg.")] = ""
    scale: Annotated[float, Key("Factor of the numbers in the file.", "for counts, such as 360 / 65536 with unit: "
        "deg.")] = 1.0
    sign: Annotated[Literal[1, -1], Key("Sign of the sensor.", "-1 if torque and acceleration of one motor have "
        "opposite phase far below the first resonance.")] = 1
    torque_constant: Annotated[TorqueConstant | None, Key("Torque constant of a current channel, on the motor side "
        "(default: none; needed for a current).", "from the data sheet; its error scales a column of the response, and "
        "gain_u_motor_1 in fit.parameters estimates it.", above=0)] = None
    side: Annotated[Literal["link", "motor"], Key("Side of the gear on which the signal is measured; with coupled "
        "gears, `motor` is the shaft of each motor.", "`motor` for raw drive signals: angles are then divided by the "
        "ratio, torques multiplied by it.")] = "link"
    file: Annotated[int, Key("Number of the file that contains the signal: 1 for `path`, 2 for the first of `also`.",
        "if drive and data logger write separate files, which a common signal aligns.", least=1)] = 1
    rate_hz: Annotated[Frequency | None, Key("Sampling rate of the channel (default: rate_hz of the section); all "
        "channels are resampled to the lowest rate.", "for a temperature at 1 Hz or an accelerometer at 10 kHz, for "
        "example; the lowest rate limits the band.", above=0)] = None
    delay: Annotated[Time, Key("Time delay of the channel relative to the true signal, of either sign, which elastid "
        "corrects (roles u and y).", "the cycle by which a drive reports its current late; if it is unknown, identify "
        "delay_u in fit.parameters.", least=-MAX_DELAY_S, most=MAX_DELAY_S)] = 0.0
    low_pass_hz: Annotated[Frequency | None, Key("Corner frequency of a first-order low-pass filter in the channel "
        "(roles u and y), which elastid corrects (default: no filter).", "the corner of the current filter in the "
        "drive's parameters.", above=0)] = None
    hold: Annotated[Hold | None, Key("Behaviour of an acting torque (role u) between its samples (default: hold of the "
        "section).", "if one log contains commanded and measured torques.")] = None
    # fmt: on

    def __post_init__(self) -> None:
        if not self.channel and self.column is None:
            raise ValueError("give channel (a name in the file), column (a number from 1), or both")
        fits_motion = self.is_motion == (self.role in ("y", "reference"))
        fits_reference = self.role != "reference" or self.quantity == "position"
        if not (fits_motion and fits_reference) or (self.quantity == "temperature") != (self.role == "t"):
            raise ValueError(
                f"role {self.role} contradicts quantity {self.quantity}: r, u, d are torques, y a motion, t a "
                "temperature, reference a position. A torque sensor behind the gear is u, or d beside motor torques"
            )
        if self.role == "t" and self.side == "motor":
            raise ValueError("a temperature has no side. Omit side with role t")
        if self.at.startswith("accelerometer ") and self.quantity in ("position", "velocity"):
            raise ValueError(f"quantity {self.quantity} at {self.at}: an accelerometer measures acceleration")
        if self.hold is not None and self.role != "u":
            raise ValueError(f"hold applies to acting torques (role u), not to role {self.role}. Omit it here")
        if (self.delay or self.low_pass_hz) and self.role not in ("u", "y"):
            raise ValueError(f"delay and low_pass_hz apply to roles u and y, not to {self.role}. Omit them here")
        if self.scale == 0:
            raise ValueError("scale is 0. Give another factor")

    @property
    def errors(self) -> tuple[Channel, ...]:
        """Delay and low-pass filter of the channel; empty without them."""
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
        return " ".join(filter(None, (self.channel, "" if self.column is None else f"column {self.column}")))

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
        """Return SI units of the channel's unit; slides: its place translates (m, N). ValueError for a wrong unit."""
        if self.quantity == "temperature":
            return self._temperature[0]
        unit = QUANTITY_UNIT[self.quantity]
        if self.unit == "g" and self.quantity == "acceleration":
            raise ValueError("unit 'g' is the gram. For multiples of gravity set scale: 9.80665 and unit: m/s^2")
        return si_factor(self.unit, translation_unit(unit) if slides else unit) if self.unit else 1.0

    @property
    def offset(self) -> float:
        """Offset after the factors, from the unit of temperature to degC."""
        return self._temperature[1] if self.quantity == "temperature" else 0.0

    @property
    def _temperature(self) -> tuple[float, float]:
        unit = table_unit(self.unit or "degC")
        if unit not in TEMPERATURES:
            raise ValueError(f"unit '{unit}' measures no temperature; units that fit here: {', '.join(TEMPERATURES)}")
        return TEMPERATURES[unit]


# SI units of what translates.
_TRANSLATIONS = {drive_unit(True), *map(translation_unit, MOTION_UNIT.values())}


@dataclass(frozen=True)
class Structure:
    """The stand-in for the robot of a study without one: which places there are, and which of them translate.

    motor_locations: the inputs, where a robot has motors.  translating: the places that are measured in m and N.
    """

    motor_locations: tuple[str, ...]
    translating: tuple[str, ...]

    @classmethod
    def from_channels(cls, channels: Sequence[ChannelSpec]) -> "Structure":
        """Return the structure that the channels of a study name."""
        inputs = dict.fromkeys(channel.at for channel in channels if channel.role == "u")
        return cls(tuple(inputs), tuple(dict.fromkeys(channel.at for channel in channels if _translates(channel))))

    @property
    def driven_names(self) -> tuple[str, ...]:
        """No joints."""
        return ()

    @property
    def mixing(self) -> FloatArray:
        """The identity (n_u, n_u): no gear couples its inputs."""
        return np.eye(len(self.motor_locations))

    def ratio(self, joint: str) -> float:
        """Raise KeyError, since it has no gears."""
        raise KeyError(f"a structure has no joint {joint}")

    def count_refusal(self, count: int) -> str:
        """Return why a configuration cannot have so many angles; empty where it can."""
        return "without a robot, a configuration has no angles. Write [], or give a robot" if count else ""

    def check_location(self, location: str) -> None:
        """Accept every name as a place."""

    def slides(self, location: str) -> bool:
        """Return True if a place translates, so that it is measured in m and N."""
        return location in self.translating

    def sliding(self, locations: Iterable[str]) -> tuple[str, ...]:
        """Return the places among `locations` that translate."""
        return tuple(dict.fromkeys(location for location in locations if self.slides(location)))


# A robot, or a structure in its place.
Places: TypeAlias = Robot | Structure


def input_units(channels: Iterable[ChannelSpec], places: Places) -> tuple[str, ...]:
    """Return the unit of each input, where one is a voltage or a current; empty where all are torques and forces."""
    inputs = [channel for channel in channels if channel.role == "u"]
    units = tuple(channel.drive or drive_unit(places.slides(channel.at)) for channel in inputs)
    return units if any(channel.drive for channel in inputs) else ()


def channel_refusal(channel: ChannelSpec, channels: Sequence[ChannelSpec], places: Places) -> tuple[str, str]:
    """Return key of a channel that contradicts the robot model, and the reason; empty texts without one."""
    if isinstance(places, Robot):
        if channel.quantity == "voltage":
            return "quantity", (
                "a voltage is no torque. Use a logged torque or current, or remove robot for a study of responses only"
            )
        remedy = "a current needs torque_constant (N*m/A). Give torque_constant"
        return ("quantity", remedy) if channel.drive else ("", "")
    if channel.side == "motor":
        return "side", "without a robot, side has no meaning. Remove side; use scale instead"
    turning = QUANTITY_UNIT[channel.quantity]
    dimensions = (translation_unit(turning), turning)
    if not channel.unit and dimensions[0] != turning:
        choice = f"give unit: {dimensions[0]} or {turning}"
        return "unit", f"without a robot, '{channel.at}' may rotate or translate. {choice}"
    if dimensions[0] != turning and dimension_and_size(channel.unit)[0] not in dimensions and channel.unit != "g":
        units = ", ".join(name for dimension in dimensions for name in units_of(dimension))
        return "unit", f"unit '{channel.unit}' does not measure {channel.quantity}; units that fit here: {units}"
    rotations = [c for c in channels if c.at == channel.at and not c.drive and not _translates(c)]
    if not channel.drive and _translates(channel) and rotations:
        return "at", (
            f"{channel.name_in_file} is a translation at '{channel.at}', {rotations[0].name_in_file} a rotation. "
            f"Rename one location, for example {channel.at} rotation"
        )
    return "", ""


def _translates(channel: ChannelSpec) -> bool:
    return channel.quantity == "force" or dimension_and_size(channel.unit)[0] in _TRANSLATIONS
