"""The `model` section of a study."""

from collections.abc import Iterator
from typing import Annotated, Literal, TypeAlias

from elastid.base.errors import did_you_mean
from elastid.base.section import Key, section
from elastid.robot import Robot

Formulation: TypeAlias = Literal["serial", "constrained", "minimal"]
Variant: TypeAlias = Literal[
    "exact", "rigid_loop", "constant_stiffness", "series_stiffness", "bending_outside", "lumped_rod"
]


@section
class ModelSpec:
    """Equations of motion of the robot."""

    # fmt: off
    formulation: Annotated[Formulation | None, Key("Formulation of the equations of motion (default: serial for a "
        "tree, constrained where there are loops). serial: a tree of bodies. constrained: all coordinates, the loops "
        "closed by constraints with multipliers. minimal: independent coordinates; elastic rods are cut and become "
        "force elements.", "`constrained` works for every linkage; `minimal` where results are wanted in independent "
        "coordinates, or elastic rods are to be cut, so that a simulation has no loop to keep closed. Both give the "
        "same response to rounding, and either checks the other.")] = None
    variant: Annotated[Variant, Key("Variant of the minimal formulation: exact, or one of the approximations in use "
        "for parallel linkages. rigid_loop: nothing gives inside loops but driven springs. constant_stiffness: so, and "
        "the stiffness of an elastic rod is in series with that of its lever's gear, as at the start posture. "
        "series_stiffness: the same with its change with the posture. bending_outside: loops do not see the elastic "
        "joints in them. lumped_rod: rods are a point mass at each end.", "an approximation only to see what it costs, "
        "or to match a model that another tool uses; parameters of an approximation are not those of the "
        "robot.")] = "exact"
    independent: Annotated[tuple[str, ...], Key("Names of the independent coordinates of the minimal formulation, such "
        "as `joint 2` or `motor 3` (default: chosen by rank).", "where the choice by rank is not the one in which you "
        "want to read the results; coordinates that are dependent in a posture are refused.")] = ()
    # fmt: on

    def __post_init__(self) -> None:
        for key, given in (("variant", self.variant != "exact"), ("independent", bool(self.independent))):
            if given and self.formulation != "minimal":
                raise ValueError(f"{key} is a choice of the minimal formulation; set formulation: minimal")

    def refusals(self, robot: Robot) -> Iterator[tuple[tuple[str | int, ...], str]]:
        """The keys that do not suit a robot, each with the reason: loops left open, names that are no coordinates."""
        if self.formulation == "serial" and robot.loops:
            loops = ", ".join(loop.name for loop in robot.loops)
            yield (
                ("formulation",),
                f"robot {robot.name} has loops ({loops}), which the serial formulation would leave open; take "
                "constrained or minimal",
            )
        coordinates = [
            *(f"joint {joint.name}" for joint in robot.joints),
            *(f"motor {joint.name}" for joint in robot.flexible),
        ]
        for i, name in enumerate(self.independent):
            if name not in coordinates:
                yield ("independent", i), f"'{name}' is no coordinate; {did_you_mean(name, coordinates)}"
