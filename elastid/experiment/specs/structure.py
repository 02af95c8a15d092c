"""Structure: what stands in for the robot of a study without one. Its places are names, their units those of channels.

It answers the questions that records and plans ask a robot: which places there are, and which of them translate.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np

from elastid.base.arrays import FloatArray
from elastid.base.units import TABLE, of_translation, units_of
from elastid.experiment.specs.channels import QUANTITY_UNIT, ChannelSpec
from elastid.record import drive_unit, motion_unit
from elastid.robot import Joint, Robot

# SI units of what translates.
_TRANSLATIONS = {
    drive_unit(True),
    *(motion_unit(quantity, True) for quantity in ("position", "velocity", "acceleration")),
}


@dataclass(frozen=True)
class Structure:
    """motor_locations: the inputs, where a robot has motors.  translating: the places that are measured in m and N."""

    motor_locations: tuple[str, ...]
    translating: tuple[str, ...]

    @classmethod
    def from_channels(cls, channels: Sequence[ChannelSpec]) -> Structure:
        """The structure that the channels of a study name."""
        inputs = dict.fromkeys(channel.at for channel in channels if channel.role == "u")
        return cls(tuple(inputs), tuple(dict.fromkeys(channel.at for channel in channels if _translates(channel))))

    @property
    def driven(self) -> tuple[Joint, ...]:
        """It has no joints."""
        return ()

    @property
    def mixing(self) -> FloatArray:
        """No gear couples its inputs: the identity."""
        return np.eye(len(self.motor_locations))

    def ratio(self, joint: str) -> float:
        """It has no gears; KeyError."""
        raise KeyError(f"a structure has no joint {joint}")

    def count_refusal(self, count: int) -> str:
        """Why a configuration cannot have so many angles; empty where it can."""
        noun = "angle" if count == 1 else "angles"
        return f"{count} {noun}, and a study without a robot has no joints; write [], or give it" if count else ""

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
        return _robot_refusal(channel)
    if not channel.at.strip():
        return "at", "the place has no name; give one, for example tip x"
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


def _robot_refusal(channel: ChannelSpec) -> tuple[str, str]:
    if channel.quantity == "voltage":
        return "quantity", (
            "a voltage is not known as a torque of the robot; give the torque or the current that was logged, or drop "
            "robot for a study of responses alone"
        )
    if channel.drive:
        return "quantity", "a current needs torque_constant (N*m/A) to become a torque"
    return "", ""


def _translates(channel: ChannelSpec) -> bool:
    """True if the unit of a channel is that of a translation."""
    return channel.quantity == "force" or TABLE.get(channel.unit, ("", 1.0))[0] in _TRANSLATIONS
