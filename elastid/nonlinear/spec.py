"""The `gears` section of a study."""

from __future__ import annotations

from typing import Annotated

from elastid.base.section import Key, section


@section
class GearsSpec:
    """Effects of gears besides their springs, found from the records together with the parameters of the fit."""

    # fmt: off
    orders: Annotated[tuple[float, ...], Key("Orders, in turns of the motor, at which transmission error and ripple of "
        "the torque are looked for.", "add those that the gear's teeth, rollers or the motor's poles would make: 2 "
        "for a strain wave gear, 6 times the pole pairs for a commutated motor.")] = (1.0, 2.0)
    # fmt: on

    def __post_init__(self) -> None:
        if not self.orders or any(not order > 0 for order in self.orders):
            raise ValueError(f"orders are {list(self.orders)}; give one or more, each positive, such as [1, 2]")
        if len(set(self.orders)) < len(self.orders):
            raise ValueError(f"orders are {list(self.orders)}; one is given twice, leave it out")
