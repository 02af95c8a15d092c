"""Channels: roles, quantities and units."""

from __future__ import annotations

import pytest

from elastid.experiment.specs.channels import ChannelSpec, Structure, channel_refusal, input_units


def test_units_are_brought_to_si_where_the_place_turns_or_slides() -> None:
    assert ChannelSpec("y", "motor 1", "q", quantity="position", unit="deg").unit_factor(False) == pytest.approx(
        0.0174532925
    )
    assert ChannelSpec("y", "motor 1", "x", quantity="position", unit="mm").unit_factor(True) == pytest.approx(1e-3)
    kelvin = ChannelSpec("t", "joint 1", "T", quantity="temperature", unit="K")
    assert (kelvin.unit_factor(False), kelvin.offset) == (1.0, -273.15)


def test_a_motion_is_no_input() -> None:
    with pytest.raises(ValueError, match="role u does not go with quantity position"):
        ChannelSpec("u", "motor 1", "q", quantity="position")


def test_places_and_translations_follow_from_the_channels() -> None:
    channels = (
        ChannelSpec("u", "shaker", "F", quantity="force"),
        ChannelSpec("y", "tip x", "a", quantity="acceleration", unit="m/s^2"),
        ChannelSpec("y", "tip rotation", "b", quantity="acceleration", unit="rad/s^2"),
    )
    structure = Structure.from_channels(channels)
    assert structure.motor_locations == ("shaker",)
    assert structure.sliding(("shaker", "tip x", "tip rotation")) == ("shaker", "tip x")
    assert input_units(channels, structure) == ()
    assert all(channel_refusal(channel, channels, structure) == ("", "") for channel in channels)
