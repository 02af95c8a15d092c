"""Sections of a study, which describes one identification, and of a fleet, one study over many robots and dates."""

from collections.abc import Iterable, Sequence
from dataclasses import field, replace
from datetime import date
from typing import TYPE_CHECKING, Annotated, Any, Literal, TypeAlias

from elastid.base.display import Display, as_html, as_text
from elastid.base.errors import StudyError
from elastid.base.names import FileName
from elastid.base.section import Key, section
from elastid.design.spec import DesignSpec
from elastid.excitation.spec import MultisineSpec
from elastid.experiment.specs.channels import Places, Structure
from elastid.experiment.specs.experiment import ExperimentSpec, ToolSpec
from elastid.fit.load_tests import LoadsSpec
from elastid.fit.spec import FitSpec
from elastid.frf.spec import EstimatorSpec
from elastid.friction_study.spec import FilterSpec, FrictionSpec
from elastid.modal.spec import ModalSpec
from elastid.model.spec import ModelSpec
from elastid.nonlinear.spec import GearsSpec
from elastid.robot import Joint, Robot
from elastid.validation.spec import CompareSpec, ValidationSpec

if TYPE_CHECKING:
    from elastid.response import Response


@section
class ReportSpec:
    """The figures of the report."""

    # fmt: off
    formats: Annotated[tuple[Literal["png"], ...], Key("File formats of the figures, in addition to the page.",
        "for figures in documents of every run; `elastid run STUDY report --png` writes them once.")] = ()
    # fmt: on


Kind: TypeAlias = Literal["simulated", "recorded", "responses", "frf", "frf-responses", "friction", "friction-recorded"]


@section
class Study:
    """One identification, from the excitation to the report."""

    # fmt: off
    name: Annotated[FileName, Key("Name of the study and of its run folder.", "give a changed copy a new name to keep "
        "the results of the first in runs/NAME.")]
    seed: Annotated[int, Key("Seed of all random numbers; the same seed gives the same results, bit for bit.",
        "repeat the study with another seed to see the influence of phases, noise and starts on the "
        "estimates.", least=0)] = 0
    robot: Annotated[Robot | None, Key("Robot model: path of its file, relative to the study, or the model itself "
        "(default: none, the study ends with the frequency responses).", "give it to fit a model.")] = None
    excitation: Annotated[MultisineSpec | None, Key("Multisine that excites the joints of a simulated rig (default: "
        "for logs and responses, the excited lines in the data).", "give it for a simulated rig.")] = None
    experiment: Annotated[ExperimentSpec, Key("Configurations, repetitions and the rig.", "simulated to plan or to "
        "learn, recorded for logs, responses for estimates of another program.")] = field(kw_only=True)
    design: Annotated[DesignSpec | None, Key("Choice of further configurations before the measurement (default: "
        "experiment.configurations only).", "give it before you book robot time: optimal configurations need fewer "
        "measurements than random ones.")] = None
    estimator: Annotated[EstimatorSpec, Key("Estimation of frequency responses from the records.", "change it for "
        "aperiodic records, or for fewer experiments than motors.")] = EstimatorSpec()
    modal: Annotated[ModalSpec, Key("Modal analysis of a structure without a robot model.", "give poles_hz to choose "
        "the modes yourself.")] = ModalSpec()
    model: Annotated[ModelSpec, Key("Formulation of the equations of motion.", "change it for linkages; a serial robot "
        "needs nothing here.")] = ModelSpec()
    fit: Annotated[FitSpec, Key("Identification of the parameters: parameters, weights and search.", "give parameters "
        "first, to identify some of the springs only.")] = FitSpec()
    loads: Annotated[LoadsSpec | None, Key("Static load tests that are fitted together with the responses (default: "
        "responses only).", "give them to identify springs of the wrist, or to compare static and dynamic "
        "stiffness.")] = None
    tool: Annotated[ToolSpec | None, Key("Responses to forces at the tool (hammer or shaker) that are fitted together "
        "with the motors' responses (default: motors' responses only).", "a few hammer hits in two configurations "
        "narrow the intervals of wrist springs considerably.")] = None
    gears: Annotated[GearsSpec | None, Key("Estimation of nonlinear gear effects: friction, load-dependent friction, "
        "hardening, hysteresis, transmission error and ripple (default: linear gears, no stage gears).", "give {} to "
        "run the stage gears after the fit; the stiffnesses then apply at zero torque.")] = None
    validation: Annotated[ValidationSpec, Key("Data that are reserved for validation.", "reserve one configuration of "
        "five or more to measure the prediction error.")] = ValidationSpec()
    compare: Annotated[CompareSpec, Key("Models that `elastid compare` fits and ranks.", "give variants to decide a "
        "question of structure, such as a rigid gear.")] = CompareSpec()
    report: Annotated[ReportSpec, Key("Figures of the report.", "change it for other file formats.")] = ReportSpec()
    friction: Annotated[FrictionSpec | None, Key("Friction study: identification of joint friction from time records "
        "instead of elasticity from responses (default: study of elasticity).", "its stages are design, measure, "
        "constant_velocity, friction, follow and report.")] = None
    filter: Annotated[FilterSpec | None, Key("Kalman filter that tracks friction over the motions of a friction study "
        "(default: no filter, no stage follow).", "give {} to run the stage follow with the default states F_c, f and "
        "offset.")] = None
    # fmt: on

    __repr__, _repr_html_ = as_text, as_html

    @property
    def display(self) -> Display:
        """Sections that are given, in words."""
        rows = {"robot": self.robot.name} if self.robot is not None else {}
        rows["configurations"] = ", ".join(self.experiment.configurations)
        if self.excitation is not None:
            low, high = self.excitation.band_hz
            rows["excitation"] = f"{low:g} to {high:g} Hz at {self.excitation.rate_hz:g} Hz"
        rows["parameters"] = ", ".join(self.fit.parameters)
        if self.friction is not None:
            rows["friction of"] = ", ".join(self.friction.joints) or "all joints"
        content = [row for row in rows.items() if row[1]]
        return Display(f"Study '{self.name}' (kind: {self.kind}), seed {self.seed}", ("section", "content"), content)

    def as_robot(self) -> Robot:
        """Return the robot; StudyError for a study without one."""
        if self.robot is None:
            stages = "estimate" if self.experiment.responses is not None else "measure, estimate"
            text = f"its stages are {stages} and report; to fit a model give robot (the path of its file) and"
            raise StudyError("study/stage", f"{text} fit.parameters", f"study {self.name} has no robot")
        return self.robot

    def as_friction(self) -> FrictionSpec:
        """Return the section `friction`; StudyError for a study of the other kind."""
        if self.friction is None:
            raise StudyError("study/stage", f"study {self.name} has no section friction: it identifies elasticity")
        return self.friction

    @property
    def friction_joints(self) -> tuple[Joint, ...]:
        """Joints whose friction is identified, in the robot's order, by default all driven joints."""
        driven, choice = self.as_robot().driven, self.as_friction().joints
        names = [joint.name for joint in driven]
        selection = [joint_called(name, names) for name in choice]
        return tuple(joint for joint in driven if not choice or joint.name in selection)

    @property
    def places(self) -> Places:
        """The robot, or without one the structure with the channels of the logs."""
        return self.robot or Structure.from_channels(self.experiment.channels)

    @property
    def kind(self) -> Kind:
        """Kind of study, which selects its stages: kind of its experiment, friction, or without a robot."""
        if self.friction is not None:
            return "friction" if self.experiment.simulated is not None else "friction-recorded"
        if self.robot is not None:
            return self.experiment.kind
        return "frf-responses" if self.experiment.responses is not None else "frf"

    def fitted(self, responses: "Iterable[Response]") -> "tuple[Response, ...]":
        """Return responses for the fit, without validation configurations."""
        return tuple(G for G in responses if G.configuration.name not in self.validation.configurations)

    @property
    def seeded_fit(self) -> FitSpec:
        """`fit` with the seed of the study unless it has its own."""
        return replace(self.fit, seed=self.seed) if self.fit.seed is None else self.fit


@section
class MemberSpec:
    """One robot on one date."""

    # fmt: off
    robot: Annotated[FileName, Key("Name of the robot.", "use the serial number, since trends follow it over the "
        "years.")]
    date: Annotated[str, Key("Date of the measurement, year-month-day.", "date of the measurement, not of the "
        "analysis; two dates give a trend, three show whether it is steady.")]
    set: Annotated[dict[str, Any], Key("Keys of the study that this member overrides, as dotted paths.",
        "mainly paths of logs, such as experiment.recorded.files.0.path.")] = field(default_factory=dict)
    # fmt: on

    def __post_init__(self) -> None:
        try:
            date.fromisoformat(self.date)
        except ValueError:
            raise ValueError(f"date is '{self.date}'. Write it as year-month-day, for example 2026-03-31") from None


@section
class FleetSpec:
    """One study over robots and dates."""

    # fmt: off
    name: Annotated[FileName, Key("Name of the fleet and of its run folder.", "keep the name when the fleet grows; "
        "only new members are then run.")]
    study: Annotated[str, Key("Path of the study that every member runs, relative to this file.", "choose a study that "
        "runs for a single member; `set` overrides keys that differ between members.")]
    members: Annotated[tuple[MemberSpec, ...], Key("Members of the fleet, listed here.", "for a few robots; from ten "
        "robots on, use a table.")] = ()
    table: Annotated[str | None, Key("CSV file with columns robot, date and keys of the study, one row per member "
        "(default: members only).", "if a spreadsheet or database lists the measurements.")] = None
    set: Annotated[dict[str, Any], Key("Keys of the study for all members; {robot} and {date} are replaced by the "
        "values of the member.", "for paths of logs with {robot} and {date}, and for settings of the whole fleet such "
        "as fewer starts.")] = field(default_factory=dict)
    false_discovery_rate: Annotated[float, Key("Expected fraction of false alarms among the reported differences and "
        "trends.", "0.01 if each finding stops a robot; higher if an inspection is cheap.", above=0, below=1)] = 0.05
    # fmt: on

    def __post_init__(self) -> None:
        if bool(self.members) == bool(self.table):
            raise ValueError("give either members or table")


def joint_called(name: str, driven: Sequence[str]) -> str | None:
    """Return driven joint by name or by number from 1; None if it does not exist."""
    if name in driven:
        return name
    return driven[int(name) - 1] if name.isdigit() and 1 <= int(name) <= len(driven) else None
