"""The sections `tool` and `validation.tool` of a study: responses by forces at the tool, of a hammer or a shaker."""

from __future__ import annotations

from typing import Annotated, get_args

import numpy as np

from elastid.base.section import Key, section
from elastid.base.units import Damping, Stiffness
from elastid.experiment.specs.recorded import ResponsesSpec
from elastid.record import JointLoop, Motors


@section
class ToolSpec:
    """Responses by forces at the tool, of a hammer or a shaker, and the motors while they were measured."""

    # fmt: off
    responses: Annotated[ResponsesSpec, Key("Files of the responses and their channels: role u at `force tool x`, role "
        "y at `frame tool x` or `accelerometer tool x`.", "one file for each posture that was tapped, in any of the "
        "formats; the postures need not have been measured otherwise.")]
    motors: Annotated[Motors, Key("Motors while it was measured: `held` by brakes, `free`, or `controlled` by their "
        "drives with a stiffness and a damping.", "free where drives hold the robot by a soft loop far below the "
        "lines; controlled where their bandwidth reaches the lines.")] = "held"
    stiffness: Annotated[tuple[Stiffness, ...], Key("Stiffness with which each controlled drive holds its motor, on "
        "the link side: position gain, and velocity gain over the integral time.", "the drives' gains, in the order of "
        "the motors; a wrong one shows as a contradiction of the motors' responses.")] = ()
    damping: Annotated[tuple[Damping, ...], Key("Damping by which each controlled drive brakes its motor, on the link "
        "side: the gain of its velocity loop.", "as for stiffness.")] = ()
    # fmt: on

    def __post_init__(self) -> None:
        if self.motors not in get_args(Motors):
            raise ValueError(f"motors is '{self.motors}'; give one of {', '.join(get_args(Motors))}")
        if (self.motors == "controlled") != bool(self.stiffness and self.damping) or bool(self.stiffness) != bool(
            self.damping
        ):
            raise ValueError(
                "stiffness and damping of the drives belong to motors: controlled, one number of each for each motor"
            )
        if len(self.stiffness) != len(self.damping):
            raise ValueError(
                f"{len(self.stiffness)} stiffnesses and {len(self.damping)} dampings; give one of each motor"
            )

    @property
    def loop(self) -> JointLoop | None:
        """The drives of controlled motors."""
        if self.motors != "controlled":
            return None
        return JointLoop(np.array(self.stiffness), np.array(self.damping), np.zeros(len(self.stiffness)))
