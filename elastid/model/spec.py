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


# Links of a drawn robot: an arm, the way to a centre of mass where the arm ends, or a rod or strut.
StickKind: TypeAlias = Literal["arm", "mass", "strut"]


@section
class ModelSpec:
    """Equations of motion of the robot."""

    # fmt: off
    formulation: Annotated[Formulation | None, Key("Formulation of the equations of motion (default: serial, or "
        "constrained for loops). `serial`: tree of bodies. `constrained`: all coordinates, Lagrange multipliers. "
        "`minimal`: independent coordinates, elastic rods as force elements.", "`constrained` works for every linkage; "
        "`minimal` gives results in independent coordinates and an independent check.")] = None
    variant: Annotated[Variant, Key("Variant of the minimal formulation: exact, or an approximation of parallel "
        "linkages. `rigid_loop`: only driven springs deflect inside loops. `constant_stiffness`: as rigid_loop, with "
        "elastic rods in series with the lever's gear, as in the start posture. `series_stiffness`: the same for every "
        "posture. `bending_outside`: loops ignore their elastic joints. `lumped_rod`: rods are point masses.",
        "an approximation only to quantify its error, or to match another tool; its parameters differ from the "
        "robot's.")] = "exact"
    independent: Annotated[tuple[str, ...], Key("Names of the independent coordinates of the minimal formulation, such "
        "as `joint 2` or `motor 3` (default: chosen by rank).", "to state results in other coordinates; elastid "
        "rejects coordinates that are dependent in a posture.")] = ()
    # fmt: on

    def __post_init__(self) -> None:
        for key, is_set in (("variant", self.variant != "exact"), ("independent", bool(self.independent))):
            if is_set and self.formulation != "minimal":
                raise ValueError(f"{key} is a choice of the minimal formulation; set formulation: minimal")

    def refusals(self, robot: Robot) -> Iterator[tuple[tuple[str | int, ...], str]]:
        """List the keys that do not suit a robot, with reasons: loops in a serial formulation, unknown coordinates."""
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
