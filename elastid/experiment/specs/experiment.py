"""The sections `experiment` (configurations, how often, on which rig) and `tool` (forces of a hammer or a shaker)."""

from dataclasses import field, replace
from typing import Annotated, Literal, TypeAlias

import numpy as np

from elastid.base.errors import StudyError
from elastid.base.names import FileName
from elastid.base.section import Key, section
from elastid.base.units import Damping, JointPosition, Quantity, Stiffness, Time
from elastid.experiment.specs.channels import ChannelSpec
from elastid.experiment.specs.logs import RecordedSpec, ResponsesSpec
from elastid.experiment.specs.simulated import SimulatedSpec
from elastid.record import Configuration, JointLoop, Motors

# More are taken for a typing error.
MAX_REALISATIONS = 10_000

# The kinds of an experiment: from where its data come.
RigSpec: TypeAlias = SimulatedSpec | RecordedSpec | ResponsesSpec


@section
class ExperimentSpec:
    """Configurations to measure, repetitions, and the rig: simulated, recorded or responses, exactly one."""

    # fmt: off
    configurations: Annotated[dict[FileName, tuple[JointPosition, ...]], Key("Measured configurations: name to "
        "positions of the driven joints (rad, or m for sliding joints); `design` adds others.", "choose three to five "
        "configurations that load the springs differently; one seldom separates the springs of one "
        "axis.")] = field(default_factory=dict)
    realisations: Annotated[int, Key("Number of independent realisations of the random phases on a simulated rig; logs "
        "number their own.", "4 to 10 with friction, since variance and distortion decrease as 1/number; at least two "
        "to estimate the distortion.", least=1, most=MAX_REALISATIONS)] = 2
    periods: Annotated[int, Key("Number of measured periods per experiment of a simulated rig.", "more if noise "
        "dominates, since its variance decreases as 1/number; at least two to estimate the noise.", least=2)] = 2
    transient_periods: Annotated[int, Key("Number of discarded periods before the measured ones on a simulated rig.",
        "more if resonances decay more slowly than a period; with 0, estimator.transient_periods detects the "
        "transient.", least=0)] = 1
    ramp: Annotated[Time, Key("Time in which torque and movement of a simulated rig fade in and out.", "longer if the "
        "start trips a drive; 0.5 s is several periods of a first mode of 5 to 10 Hz.", least=0)] = 0.5
    hold: Annotated[Time, Key("Time at zero velocity of a simulated rig before the start and after the end.",
        "a second if a logger needs time to start.", least=0)] = 0.0
    experiments: Annotated[int | None, Key("Number of experiments per realisation (default: number of motors, each "
        "with all motors moving).", "fewer save robot time, but require a local method of `estimator` and many lines "
        "within each resonance.", least=1)] = None
    simulated: Annotated[SimulatedSpec | None, Key("Simulated rig: a model instead of the real robot (default: "
        "recorded data).", "to plan an experiment and to check identifiability before the robot is booked.")] = None
    recorded: Annotated[RecordedSpec | None, Key("Recorded rig: existing logs (default: simulated rig or responses).",
        "for logs of the real robot; channels and files describe their content.")] = None
    responses: Annotated[ResponsesSpec | None, Key("Frequency responses estimated by another program (default: "
        "simulated rig or logs).", "for FRFs with or without uncertainty; prefer records if they exist, since they "
        "show distortion and transients.")] = None
    without_payload: Annotated[tuple[FileName, ...], Key("Names of the configurations measured without the payload of "
        "the robot model.", "the same configurations with and without a weighed payload separate drive gains, "
        "`gain_u_motor_1`, from inertias.")] = ()
    # fmt: on

    def __post_init__(self) -> None:
        if sum(kind is not None for kind in (self.simulated, self.recorded, self.responses)) != 1:
            raise ValueError("give exactly one of simulated, recorded and responses; a planned experiment is simulated")

    def runs(self, n_u: int) -> int:
        """Return how many experiments a realisation has on a robot of n_u motors."""
        return n_u if self.experiments is None else self.experiments

    @property
    def postures(self) -> dict[str, Configuration]:
        """The configurations that are measured, by name."""
        return {
            name: Configuration(name, np.array(angles, dtype=float), name not in self.without_payload)
            for name, angles in self.configurations.items()
        }

    @property
    def rig(self) -> RigSpec:
        """The section of the experiment's kind, for a match statement."""
        return next(kind for kind in (self.simulated, self.recorded, self.responses) if kind is not None)

    @property
    def kind(self) -> Literal["simulated", "recorded", "responses"]:
        """The key of that section, which decides the stages of a study."""
        if self.simulated is not None:
            return "simulated"
        return "responses" if self.recorded is None else "recorded"

    @property
    def channels(self) -> tuple[ChannelSpec, ...]:
        """The channels of logs or of responses from elsewhere; none of a simulation."""
        return () if isinstance(self.rig, SimulatedSpec) else self.rig.channels

    def as_simulated(self) -> SimulatedSpec:
        """Return the section `simulated`; StudyError for an experiment of another kind."""
        if self.simulated is None:
            raise StudyError(
                "study/stage", f"designing and simulating need the section simulated, not {self.kind}", "experiment"
            )
        return self.simulated

    def as_recorded(self) -> RecordedSpec:
        """Return the section `recorded`; StudyError for an experiment of another kind."""
        if self.recorded is None:
            raise StudyError("study/stage", f"logs need the section recorded, not {self.kind}", "experiment")
        return self.recorded

    def with_truth(self, truth: dict[str, Quantity]) -> "ExperimentSpec":
        """Return experiment with another truth of the simulated robot; an empty one is the nominal robot."""
        return replace(self, simulated=replace(self.as_simulated(), truth=truth))


@section
class ToolSpec:
    """Responses by forces at the tool, of a hammer or a shaker, and the motors while they were measured."""

    # fmt: off
    responses: Annotated[ResponsesSpec, Key("Files of the responses and their channels: role u at `force tool x`, role "
        "y at `frame tool x` or `accelerometer tool x`.", "one file for each posture that was tapped, in any of the "
        "formats; the postures need not have been measured otherwise.")]
    motors: Annotated[Motors, Key("Motors while it was measured: `locked` by brakes, `free`, or `controlled` by their "
        "drives with a stiffness and a damping.", "free where drives hold the robot by a soft loop far below the "
        "lines; controlled where their bandwidth reaches the lines.")] = "locked"
    stiffness: Annotated[tuple[Stiffness, ...], Key("Link-side stiffness of each controlled drive: position gain, and "
        "velocity gain over the integral time.", "the drives' gains, in the order of the motors; a wrong one "
        "contradicts the motors' responses.", least=0)] = ()
    damping: Annotated[tuple[Damping, ...], Key("Link-side damping of each controlled drive: the gain of its velocity "
        "loop.", "the drives' gains, as for stiffness; 0 for a drive without a velocity loop.", least=0)] = ()
    # fmt: on

    def __post_init__(self) -> None:
        """Refuse drives of motors that are not controlled, controlled motors without them, and negative numbers."""
        n = len(self.stiffness)
        if n != len(self.damping) or (self.motors == "controlled") != (n > 0):
            raise ValueError(
                f"{n} stiffnesses and {len(self.damping)} dampings of drives, and motors are {self.motors}. Give one "
                "of each per controlled motor, otherwise none"
            )

    @property
    def loop(self) -> JointLoop | None:
        """The drives of controlled motors."""
        if self.motors != "controlled":
            return None
        return JointLoop(np.array(self.stiffness), np.array(self.damping), np.zeros(len(self.stiffness)))
