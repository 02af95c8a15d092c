"""The section `loops` of a simulated experiment."""

from __future__ import annotations

from typing import Annotated

from elastid.base.section import Key, section
from elastid.base.units import InUnit


@section
class StabilisationSpec:
    """Stabilisation of the closed loops of a simulated robot; without effect on a tree or on rods that are cut."""

    # fmt: off
    project: Annotated[bool, Key("Coordinates are projected back onto the closed loops after each sample if true, "
        "which leaves rounding alone.", "false only to see what the terms alpha and beta do by themselves; loops then "
        "drift apart by the integration error.")] = True
    alpha: Annotated[Annotated[float, InUnit("1/s")], Key("Baumgarte's damping of the loop error, phi'' + alpha phi' + "
        "beta phi = 0; critically damped where beta = alpha^2 / 4.", "(20, 100) is usual where projection is off; "
        "larger ones need more substeps. They do not change a linear response at an equilibrium.")] = 0.0
    beta: Annotated[Annotated[float, InUnit("1/s^2")], Key("Baumgarte's stiffness of the loop error, phi'' + alpha "
        "phi' + beta phi = 0; critically damped where beta = alpha^2 / 4.", "(20, 100) is usual where projection is "
        "off; larger ones need more substeps. They do not change a linear response at an equilibrium.")] = 0.0
    # fmt: on

    def __post_init__(self) -> None:
        """Refuse terms that would open the loops."""
        if self.alpha < 0 or self.beta < 0:
            raise ValueError(
                f"alpha is {self.alpha:g} 1/s, beta {self.beta:g} 1/s^2; negative ones drive the loops apart"
            )
