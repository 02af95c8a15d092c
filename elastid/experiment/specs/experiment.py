"""The `experiment` section of a study: which configurations, how often, on which rig."""

from __future__ import annotations

from dataclasses import field
from typing import Literal

from elastid.base.section import section
from elastid.base.units import (
    JointPosition,
    Time,
)
from elastid.experiment.specs.recorded import RecordedSpec
from elastid.experiment.specs.responses import ResponsesSpec
from elastid.experiment.specs.simulated import SimulatedSpec

# Whatever is more is a slip of the pen.
MOST_REALISATIONS = 10_000


@section
class ExperimentSpec:
    """Which configurations are measured, how often, and on which rig: simulated, recorded or responses, exactly one.

    configurations: name to positions of the driven joints (rad, or m where a joint slides); a section `design` adds
    others.
    realisations: independent draws of the random phases.  experiments: of every realisation (default: as many as
    motors, each with all motors moving); fewer are for the local methods of `estimator`, which separate inputs by
    neighbouring lines.  periods: measured in each experiment.  transient_periods: before these, left out.
    ramp: time in which torque and movement grow at the start and fade at the end.  hold: rest before and after that.
    simulated: a rig that is a model.  recorded: logs of a rig.  responses: frequency responses from elsewhere.
    """

    configurations: dict[str, tuple[JointPosition, ...]] = field(default_factory=dict)
    realisations: int = 2
    periods: int = 2
    transient_periods: int = 1
    ramp: Time = 0.5
    hold: Time = 0.0
    experiments: int | None = None
    simulated: SimulatedSpec | None = None
    recorded: RecordedSpec | None = None
    responses: ResponsesSpec | None = None

    def __post_init__(self) -> None:
        """Exactly one kind; counts that give a variance."""
        if sum(kind is not None for kind in (self.simulated, self.recorded, self.responses)) != 1:
            raise ValueError("give exactly one of simulated, recorded and responses")
        for name, number, least in (
            ("realisations", self.realisations, "1"),
            ("experiments", 1 if self.experiments is None else self.experiments, "1"),
            ("periods", self.periods, "2, for the noise level"),
            ("transient_periods", self.transient_periods, "0"),
        ):
            if number < int(least[0]):
                raise ValueError(f"{name} is {number}; it must be at least {least}")
        if self.realisations > MOST_REALISATIONS:
            raise ValueError(
                f"realisations is {self.realisations}; more than {MOST_REALISATIONS} help nobody, 2 to 20 do"
            )
        if self.ramp < 0 or self.hold < 0:
            raise ValueError("ramp and hold are times; they must not be negative")

    def runs(self, n_u: int) -> int:
        """How many experiments a realisation has on a robot of n_u motors."""
        return n_u if self.experiments is None else self.experiments

    @property
    def kind(self) -> Literal["simulated", "recorded", "responses"]:
        """Where the data come from, which decides what stages a study has."""
        if self.simulated is not None:
            return "simulated"
        return "recorded" if self.recorded is not None else "responses"
