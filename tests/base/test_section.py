"""Sections check the bounds that stand beside their keys."""

from __future__ import annotations

from typing import Annotated

import pytest

from elastid.base.section import Key, section
from elastid.base.units import Mass, Ratio, Time


@section
class Sample:
    time: Annotated[Time | None, Key("Time.", "longer.", above=0)] = None
    shares: Annotated[tuple[Ratio, ...] | Ratio, Key("Shares.", "more.", least=0)] = 0.0
    count: Annotated[int, Key("Count.", "more.", least=2)] = 2
    mass: Annotated[Mass, Key("Mass.", "more.", above=-1)] = 0.0


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"time": 0.0}, "time is 0 s; it must be positive"),
        ({"time": float("nan")}, "time is nan s; it must be positive"),
        ({"shares": (0.5, -0.1)}, "shares is -0.1; it must not be negative"),
        ({"count": 1}, "count is 1; it must be at least 2"),
        ({"mass": -1.0}, "mass is -1 kg; it must be above -1"),
    ],
)
def test_a_number_out_of_its_bounds_is_named_with_them(given: dict[str, float], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        Sample(**given)
