"""Channels: roles, quantities and units."""

from __future__ import annotations

import pytest

from elastid.experiment.specs.channels import ChannelSpec


def test_a_motion_is_no_input() -> None:
    with pytest.raises(ValueError, match="role u does not go with quantity position"):
        ChannelSpec("u", "motor 1", "q", quantity="position")
