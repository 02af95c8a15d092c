"""Channels: roles, quantities and units."""

from __future__ import annotations

import pytest

from elastid.experiment.specs.channels import ChannelSpec


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
