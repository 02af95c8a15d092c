"""A compensator is one spring between two bodies, whose numbers and ends have names."""

from __future__ import annotations

import pytest

from elastid.robot import Anchor, CoilSpring, Compensator, GasSpring

ENDS = (Anchor(), Anchor("arm", (0.0, 0.0, 0.3)))


def test_a_compensator_is_a_coil_or_a_gas_spring_between_two_bodies() -> None:
    for coil, gas in ((None, None), (CoilSpring(1e4), GasSpring(1e3, 0.5, 1.0))):
        with pytest.raises(ValueError, match="give one of coil and gas"):
            Compensator("cyl", ENDS, coil, gas)
    with pytest.raises(ValueError, match="never moves"):
        Compensator("cyl", (Anchor("arm"), Anchor("arm")), CoilSpring(1e4))


def test_numbers_and_ends_have_names() -> None:
    gas = Compensator("cyl", ENDS, gas=GasSpring(1e3, 0.5, 1.0))
    assert set(gas.numbers) == {"F0_cyl", "L0_cyl", "h0_cyl", "kappa_cyl"}
    assert gas.geometry["pc2_cyl_z"] == ("m", ("ends", 1, "point", 2))
