"""The law that a friction study looks for."""

from __future__ import annotations

from typing import Literal, TypeAlias

from elastid.base.section import section

Part: TypeAlias = Literal["auto", "yes", "no"]


@section
class LawSpec:
    """Which parts a static friction law has, beside Coulomb and viscous friction.

    Each part is `no`, `yes`, or `auto`: where the levels can tell it (an F test at 1 %, and none of its numbers wider
    than half of itself).
    stribeck: stiction that falls to Coulomb friction.  exponent: of that fall, 2 unless it can be told.  quadratic:
    friction that grows with v |v|.  directions: levels and slopes of each direction.  load: growth with the load.
    temperature: change with temperature.
    """

    stribeck: Part = "auto"
    exponent: Part = "auto"
    quadratic: Part = "no"
    directions: Part = "auto"
    load: Part = "auto"
    temperature: Part = "auto"
