"""The sections `tool` and `validation.tool` of a study: responses by forces at the tool, of a hammer or a shaker."""

from __future__ import annotations

from typing import Annotated

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
        "side: the gain of its velocity loop.", "the drives' gains, as for stiffness; 0 of a drive without a velocity "
        "loop.")] = ()
    # fmt: on

    def __post_init__(self) -> None:
        """Refuse drives of motors that are not controlled, controlled motors without them, and negative numbers."""
        n = len(self.stiffness)
        if n != len(self.damping) or (self.motors == "controlled") != (n > 0):
            raise ValueError(
                f"{n} stiffnesses and {len(self.damping)} dampings of drives, and motors are {self.motors}: give one "
                "of each for each motor where they are controlled, and none otherwise"
            )
        for name, values in (("stiffness", self.stiffness), ("damping", self.damping)):
            if min(values, default=0.0) < 0:
                raise ValueError(f"{name} is {min(values):g}; a drive that holds its motor has none below zero")

    @property
    def loop(self) -> JointLoop | None:
        """The drives of controlled motors."""
        if self.motors != "controlled":
            return None
        return JointLoop(np.array(self.stiffness), np.array(self.damping), np.zeros(len(self.stiffness)))
