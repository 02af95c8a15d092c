"""The section `loops` of a simulated experiment."""

from __future__ import annotations

from typing import Annotated

from elastid.base.section import section
from elastid.base.units import InUnit


@section
class StabilisationSpec:
    """How the loops of a simulated robot are kept closed; without effect on a tree or on rods that are cut.

    project: after each sample back onto the closed loops, which leaves rounding alone. -- false only to see what the
    terms alpha and beta do by themselves; loops then drift apart by the integration error.
    alpha, beta: Baumgarte's terms, phi'' + alpha phi' + beta phi = 0, critically damped where beta = alpha^2 / 4. --
    (20, 100) is usual where projection is off; larger ones need more substeps. They do not change a linear response at
    an equilibrium.
    """

    project: bool = True
    alpha: Annotated[float, InUnit("1/s")] = 0.0
    beta: Annotated[float, InUnit("1/s^2")] = 0.0

    def __post_init__(self) -> None:
        """Refuse terms that would open the loops."""
        if self.alpha < 0 or self.beta < 0:
            raise ValueError(
                f"alpha is {self.alpha:g} 1/s, beta {self.beta:g} 1/s^2; negative ones drive the loops apart"
            )
