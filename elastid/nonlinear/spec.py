"""The `gears` section of a study."""

from typing import Annotated

from elastid.base.section import Key, section


@section
class GearsSpec:
    """Gear effects besides linear springs, estimated from the records together with the parameters of the fit."""

    # fmt: off
    orders: Annotated[tuple[float, ...], Key("Candidate orders per motor revolution of transmission error and torque "
        "ripple.", "add the orders of teeth, rollers and motor poles: 2 for a strain wave gear, 6 times the pole pairs "
        "for commutation.", above=0, distinct=True, filled=True)] = (1.0, 2.0)
    # fmt: on
