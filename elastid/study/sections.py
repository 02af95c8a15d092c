"""Study: the sections of one identification."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace
from typing import Literal, TypeAlias

from elastid.base.display import Display, as_html, as_text
from elastid.base.errors import StudyError
from elastid.base.names import FileName
from elastid.base.section import section
from elastid.design.spec import DesignSpec
from elastid.excitation.spec import MultisineSpec
from elastid.experiment.specs.experiment import ExperimentSpec
from elastid.experiment.specs.structure import Places, Structure
from elastid.fit.spec import FitSpec
from elastid.frf.spec import EstimatorSpec
from elastid.friction_fit.spec import FrictionSpec
from elastid.model.spec import ModelSpec
from elastid.observer.spec import FilterSpec
from elastid.report.spec import ReportSpec
from elastid.response import FrequencyResponse
from elastid.robot import Joint, Robot
from elastid.validation.spec import CompareSpec, ValidationSpec

Kind: TypeAlias = Literal["simulated", "recorded", "responses", "frf", "frf-responses", "friction", "friction-recorded"]


@section
class Study:
    """One identification, from the excitation to the report.

    name: names the run folder. -- a new name for a changed copy keeps the run folder of the first, runs/NAME; without
    it results of both would land in one.
    seed: of everything that is drawn; the same seed gives the same results, bit for bit, for any number of processes.
    -- another number repeats the whole study with other phases, noise and starts; numbers that then move by more than
    their intervals are not to be trusted. 0 is as good as any.
    robot: the path of its file, relative to the study, or the robot itself; left out where responses, recorded or from
    elsewhere, are all that is asked for: places are then names. -- give it as soon as a model is to be fitted; left
    out, the stages end with the responses and their report.
    excitation: needed where the rig is simulated. -- leave it out for logs and responses, whose lines are found in the
    data.
    experiment: configurations, repetitions and the rig. -- it decides the kind of study: simulated to plan or to learn,
    recorded for logs, responses where another program has estimated already.
    design: chooses further configurations. -- give it before robot time is booked: chosen postures reach the intervals
    of drawn ones in fewer measurements. Postures of your own stay beside the chosen ones.
    estimator: from records to frequency responses. -- the defaults suit a closed-loop robot with several realisations;
    change it for records without a period, or for fewer experiments than motors.
    model: the equations that the fit uses. -- needed for linkages where another formulation is wanted; a serial robot
    needs nothing here.
    fit: parameters, weights and search. -- the first key to give is parameters, as soon as not every spring is to be
    identified.
    validation: data that judge the model. -- name one configuration as left out where five or more are measured; the
    report then says how well the model predicts it.
    compare: models of `elastid compare`. -- give variants of your own where a question about the structure is open,
    such as a gear that may be rigid.
    report: its figures. -- only for other formats of figures.
    friction: of joints is identified, from passes and loops, in the place of elasticity from responses. -- give it for
    a study of friction, whose stages are design, measure, levels, friction, follow and report.
    filter: follows friction over the motions of a study of friction. -- {} makes the stage follow run with the
    defaults; its keys are for other numbers than F_c, f and an offset, and for an axis that drifts faster.
    """

    name: FileName
    experiment: ExperimentSpec
    robot: Robot | None = None
    excitation: MultisineSpec | None = None
    design: DesignSpec | None = None
    seed: int = 0
    estimator: EstimatorSpec = EstimatorSpec()
    model: ModelSpec = ModelSpec()
    fit: FitSpec = FitSpec()
    validation: ValidationSpec = ValidationSpec()
    compare: CompareSpec = CompareSpec()
    report: ReportSpec = ReportSpec()
    friction: FrictionSpec | None = None
    filter: FilterSpec | None = None

    def __post_init__(self) -> None:
        """Refuse what random generators refuse."""
        if self.seed < 0:
            raise ValueError(f"seed is {self.seed}; it must not be negative")

    __repr__, _repr_html_ = as_text, as_html

    @property
    def display(self) -> Display:
        """Each section that is given, in words."""
        configurations = ", ".join(self.experiment.configurations)
        rows = [("robot", self.robot.name)] if self.robot is not None else []
        rows += [("configurations", configurations)] if configurations else []
        if self.excitation is not None:
            low, high = self.excitation.band_hz
            rows.append(("excitation", f"{low:g} to {high:g} Hz at {self.excitation.rate_hz:g} Hz"))
        if self.fit.parameters:
            rows.append(("parameters", ", ".join(self.fit.parameters)))
        if self.friction is not None:
            rows.append(("friction of", ", ".join(self.friction.joints) or "all joints"))
        return Display(f"Study {self.name}, {self.kind}, seed {self.seed}", ("section", "content"), rows)

    def as_robot(self) -> Robot:
        """The robot; StudyError for a study without one."""
        if self.robot is None:
            stages = "estimate" if self.experiment.responses is not None else "measure, estimate"
            raise StudyError(
                f"study {self.name} has no robot: its stages are {stages} and report; to fit a model give "
                "robot (the path of its file) and fit.parameters"
            )
        return self.robot

    def as_friction(self) -> FrictionSpec:
        """The section `friction`; StudyError for a study of the other kind."""
        if self.friction is None:
            raise StudyError(f"study {self.name} has no section friction: it identifies elasticity")
        return self.friction

    @property
    def friction_joints(self) -> tuple[Joint, ...]:
        """The joints whose friction is asked for, in the robot's order; all driven ones by default."""
        driven, asked = self.as_robot().driven, self.as_friction().joints
        names = [joint.name for joint in driven]
        chosen = [joint_called(name, names) for name in asked]
        return tuple(joint for joint in driven if not asked or joint.name in chosen)

    @property
    def places(self) -> Places:
        """The robot, or what stands in for it: the structure that the channels of the logs name."""
        return self.robot or Structure.of(self.experiment.channels)

    @property
    def kind(self) -> Kind:
        """The kind of study, which decides its stages: that of its experiment, of friction, or without a robot."""
        if self.friction is not None:
            return "friction" if self.experiment.simulated is not None else "friction-recorded"
        if self.robot is not None:
            return self.experiment.kind
        return "frf-responses" if self.experiment.responses is not None else "frf"

    def fitted(self, responses: Iterable[FrequencyResponse]) -> tuple[FrequencyResponse, ...]:
        """The responses that the fit sees: those of configurations that are not left out for validation."""
        return tuple(one for one in responses if one.configuration.name not in self.validation.left_out)

    @property
    def seeded_fit(self) -> FitSpec:
        """`fit` with the seed of the study unless it has its own."""
        return replace(self.fit, seed=self.seed) if self.fit.seed is None else self.fit


def joint_called(name: str, driven: Sequence[str]) -> str | None:
    """The driven joint of a name or, from 1, of a number; None where there is none."""
    if name in driven:
        return name
    return driven[int(name) - 1] if name.isdigit() and 1 <= int(name) <= len(driven) else None
