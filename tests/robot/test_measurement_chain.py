"""Gains of channels are one unless listed, listed once, and at places that exist."""

from __future__ import annotations

import pytest

from elastid.robot import Chain, ChannelGain


def test_a_gain_is_one_unless_it_is_listed() -> None:
    chain = Chain(gains=(ChannelGain("y", "joint 1", 1.2),), torque_lag=1e-3)
    assert (chain.gain("y", "joint 1"), chain.gain("u", "joint 1")) == (1.2, 1.0)
    assert set(chain.numbers) == {"torque_lag", "gain_y_joint_1"}
    assert [gain.gain for gain in chain.gains_at(["motor 1"], ["joint 1"]).values()] == [1.0, 1.2]


def test_a_channel_has_one_gain_at_a_known_place() -> None:
    with pytest.raises(ValueError, match="twice"):
        Chain(gains=(ChannelGain("u", "motor 1"), ChannelGain("u", "motor 1", 2.0)))
    with pytest.raises(ValueError, match="no u is at 'motor 9'"):
        Chain(gains=(ChannelGain("u", "motor 9"),)).check_places(["motor 1"], ["joint 1"])
