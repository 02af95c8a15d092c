"""A structure in place of a robot: its places and their units."""

from __future__ import annotations

from elastid.experiment.specs.channels import ChannelSpec
from elastid.experiment.specs.structure import Structure, channel_refusal, input_units


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
