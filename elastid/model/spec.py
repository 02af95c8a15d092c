"""The `model` section of a study."""

from __future__ import annotations

from typing import Literal, TypeAlias

from elastid.base.section import section

Formulation: TypeAlias = Literal["serial", "constrained", "minimal"]
Variant: TypeAlias = Literal[
    "exact", "rigid_loop", "constant_stiffness", "series_stiffness", "bending_outside", "lumped_rod"
]


@section
class ModelSpec:
    """How the robot becomes equations.

    formulation: default serial for a tree, constrained where there are loops.
    serial: a tree of bodies.  constrained: all coordinates, the loops closed by constraints with multipliers.
    minimal: independent coordinates; elastic rods are cut and become force elements.  independent: names of these
    coordinates, such as `joint 2` or `motor 3` (default: chosen by rank).

    variant: of the minimal formulation, exact or one of the approximations in use for parallel linkages.  rigid_loop:
    nothing gives inside loops but driven springs.  constant_stiffness: so, and the stiffness of an elastic rod is in
    series with that of its lever's gear, as at the start posture.  series_stiffness: the same with its change with the
    posture.  bending_outside: loops do not see the elastic joints in them.  lumped_rod: rods are a point mass at each
    end.
    """

    formulation: Formulation | None = None
    variant: Variant = "exact"
    independent: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        """Variants and chosen coordinates belong to the minimal formulation."""
        for key, given in (("variant", self.variant != "exact"), ("independent", bool(self.independent))):
            if given and self.formulation != "minimal":
                raise ValueError(f"{key} is a choice of the minimal formulation; set formulation: minimal")
