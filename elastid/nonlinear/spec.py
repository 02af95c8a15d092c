"""The `gears` section of a study."""

from typing import Annotated

from elastid.base.section import Key, section


@section
class GearsSpec:
    """Effects of gears besides their springs, found from the records together with the parameters of the fit."""

    # fmt: off
    orders: Annotated[tuple[float, ...], Key("Orders, in turns of the motor, at which transmission error and ripple of "
        "the torque are looked for.", "add those that the gear's teeth, rollers or the motor's poles would make: 2 "
        "for a strain wave gear, 6 times the pole pairs for a commutated motor.", above=0, distinct=True)] = (1.0, 2.0)
    # fmt: on

    def __post_init__(self) -> None:
        if not self.orders:
            raise ValueError("orders is empty; give one or more, such as [1, 2]")
