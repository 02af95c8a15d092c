"""The table of stages: which kinds of study have one, what it reads and leaves, and the function that carries it out.

A further stage is a row here and a file below `stages`. Functions stand as text, so that the command line,
which shows a command for each row, loads none of them.
"""

from __future__ import annotations

from dataclasses import dataclass
from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from elastid.study import Study

# Keys of `experiment` that say from where its data come: the kinds of study with a robot.
SIMULATED, RECORDED, RESPONSES = "simulated", "recorded", "responses"
WITH_A_ROBOT = (SIMULATED, RECORDED, RESPONSES)
# Studies without a robot: responses of recorded logs alone, or responses from elsewhere.
FRF, FRF_RESPONSES = "frf", "frf-responses"
# Studies of friction.
FRICTION, FRICTION_RECORDED = "friction", "friction-recorded"
# Keys of `friction` that say what is measured; `law` is that of the stage friction.
FRICTION_EXPERIMENTS = tuple(
    f"friction.{key}" for key in ("joints", "rate_hz", "passes", "loads", "presliding", "at_rest", "warm_up")
)


@dataclass(frozen=True)
class Stage:
    """A stage of some kinds of study: function(run: Run) -> None, which leaves `leaves` in the run folder.

    help: one line for the command of its name.  sections: of the study, or single keys of one, that it reads; those
    that an earlier stage has read come with its result.  reads: the stages whose results it reads, where a study has
    them.  leaves: the first file carries the stamp, the second is what programs read.  beside: patterns of further
    files that it leaves.  function, conclude: "module:name" below elastid.app.stages.  further(loaded, inputs) -> JSON:
    whatever else the result depends on, with the hashes of the stages before; "module:name".  of_reads: whether it
    depends on all that the stages depend on whose results it reads.  needs: a section without which a study has not
    this stage.  conclude(run): shows the result at the end of a run, and raises FitError where it cannot be trusted.
    """

    name: str
    help: str
    kinds: tuple[str, ...]
    sections: tuple[str, ...]
    reads: tuple[str, ...]
    leaves: tuple[str, ...]
    function: str
    beside: tuple[str, ...] = ()
    further: str = ""
    of_reads: bool = True
    needs: str = ""
    conclude: str = ""

    @property
    def texts(self) -> tuple[str, ...]:
        """Files, folders and patterns of what it leaves besides HDF5 files, which carry their own checksums."""
        return (*(name for name in self.leaves if not name.endswith(".h5")), *self.beside)


STAGES = (
    Stage(
        name="design",
        help="Choose configurations, plan the excitation and predict the intervals: plan.h5 and references/*.csv.",
        kinds=(SIMULATED,),
        sections=("seed", "robot", "excitation", "experiment", "design", "model"),
        reads=(),
        leaves=("plan.h5",),
        function="design:design",
        beside=("references/*.csv",),
        further="elastid.app.further_inputs:of_design",
    ),
    Stage(
        name="measure",
        help="Simulate the experiments or import the recorded logs: records.h5.",
        kinds=(SIMULATED,),
        sections=("seed", "robot", "excitation", "experiment"),
        reads=("design",),
        leaves=("records.h5",),
        function="measure:simulate",
        further="elastid.app.further_inputs:of_plan",
        of_reads=False,
    ),
    Stage(
        name="measure",
        help="Simulate the experiments or import the recorded logs: records.h5.",
        kinds=(RECORDED, FRF),
        sections=("seed", "robot", "experiment"),
        reads=(),
        leaves=("records.h5",),
        function="measure:import_logs",
        further="elastid.app.further_inputs:of_logs",
    ),
    Stage(
        name="estimate",
        help="Estimate the frequency responses with their covariance: frf.h5.",
        kinds=(SIMULATED, RECORDED, FRF),
        sections=("estimator",),
        reads=("measure",),
        leaves=("frf.h5",),
        function="estimate:estimate",
    ),
    Stage(
        name="estimate",
        help="Estimate the frequency responses with their covariance: frf.h5.",
        kinds=(RESPONSES, FRF_RESPONSES),
        sections=("seed", "robot", "experiment", "estimator"),
        reads=(),
        leaves=("frf.h5",),
        function="estimate:import_responses",
        further="elastid.app.further_inputs:of_responses",
    ),
    Stage(
        name="fit",
        help="Fit the elastic parameters: fit.h5 and summary.json.",
        kinds=WITH_A_ROBOT,
        sections=("name", "seed", "robot", "model", "fit", "validation.left_out"),
        reads=("estimate",),
        leaves=("fit.h5", "summary.json"),
        function="fit:fit",
        beside=("identified_robot*.yml",),
        conclude="fit:conclude",
    ),
    Stage(
        name="validate",
        help="Judge the fit on left-out configurations and by its residuals: validation.h5 and validation.json.",
        kinds=WITH_A_ROBOT,
        sections=("robot", "model", "validation"),
        reads=("estimate", "fit"),
        leaves=("validation.h5", "validation.json"),
        function="validate:validate",
    ),
    Stage(
        name="report",
        help="Write the page and the figures: report.html and figures/.",
        kinds=WITH_A_ROBOT,
        sections=("name", "report"),
        reads=("design", "estimate", "fit", "validate"),
        leaves=("report.html", "figures"),
        function="report:report",
        further="elastid.app.further_inputs:of_page",
    ),
    Stage(
        name="report",
        help="Write the page and the figures: report.html and figures/.",
        kinds=(FRF, FRF_RESPONSES),
        sections=("name", "report"),
        reads=("estimate",),
        leaves=("report.html", "figures", "peaks.csv"),
        function="report_responses:report",
        further="elastid.app.further_inputs:of_page",
    ),
    Stage(
        name="design",
        help="Plan the passes and other motions within the robot's limits: plan.h5 and references/*.csv.",
        kinds=(FRICTION,),
        sections=("seed", "robot", "experiment", *FRICTION_EXPERIMENTS),
        reads=(),
        leaves=("plan.h5",),
        function="friction_design:design",
        beside=("references/*.csv",),
    ),
    Stage(
        name="measure",
        help="Simulate the motions or import the recorded logs: records.h5.",
        kinds=(FRICTION,),
        sections=(),
        reads=("design",),
        leaves=("records.h5",),
        function="friction_measure:simulate",
    ),
    Stage(
        name="measure",
        help="Simulate the motions or import the recorded logs: records.h5.",
        kinds=(FRICTION_RECORDED,),
        sections=("seed", "robot", "experiment", *FRICTION_EXPERIMENTS),
        reads=(),
        leaves=("records.h5",),
        function="friction_measure:import_logs",
        further="elastid.app.further_inputs:of_logs",
    ),
    Stage(
        name="levels",
        help="Find the friction at each speed, load and temperature: levels.h5.",
        kinds=(FRICTION, FRICTION_RECORDED),
        sections=(),
        reads=("measure",),
        leaves=("levels.h5",),
        function="friction_levels:levels",
    ),
    Stage(
        name="friction",
        help="Identify the law of friction: friction.h5, summary.json and identified_robot.yml.",
        kinds=(FRICTION, FRICTION_RECORDED),
        sections=("name", "friction.law"),
        reads=("measure", "levels"),
        leaves=("friction.h5", "summary.json", "identified_robot.yml"),
        function="friction_law:friction",
        conclude="friction_law:conclude",
    ),
    Stage(
        name="follow",
        help="Follow the friction of each joint over its motions with a Kalman filter, into filter.h5.\n\nThe study's "
        "section filter says which numbers are followed and how fast they may drift; the page shows them with 95 % "
        "bands and says what the motion cannot tell.",
        kinds=(FRICTION, FRICTION_RECORDED),
        sections=("robot", "filter"),
        reads=("measure", "friction"),
        leaves=("filter.h5",),
        function="friction_follow:follow_friction",
        needs="filter",
    ),
    Stage(
        name="report",
        help="Write the page and the figures: report.html and figures/.",
        kinds=(FRICTION, FRICTION_RECORDED),
        sections=("name", "report"),
        reads=("friction", "follow"),
        leaves=("report.html", "figures"),
        function="friction_report:report",
        further="elastid.app.further_inputs:of_page",
    ),
)


def stages_of(kind: str) -> dict[str, Stage]:
    """The stages of a kind of study by name, in order."""
    return {stage.name: stage for stage in STAGES if kind in stage.kinds}


def stages_of_study(study: Study) -> dict[str, Stage]:
    """The stages of a study by name, in order: those of its kind, without those that need a section it has not."""
    found = stages_of(study.kind).items()
    return {name: stage for name, stage in found if not stage.needs or getattr(study, stage.needs) is not None}


def all_names() -> tuple[str, ...]:
    """The names of all stages, in order."""
    return tuple(dict.fromkeys(stage.name for stage in STAGES))


def help_of(name: str) -> str:
    """The line of help of the command of a stage."""
    return next(stage.help for stage in STAGES if stage.name == name)


def function_of(text: str) -> Any:
    """The function that a row names as "module:name"."""
    return getattr(import_module(module_of(text)), text.partition(":")[2])


def module_of(text: str) -> str:
    """The module of the function that a row names as "module:name"."""
    module = text.partition(":")[0]
    return module if "." in module else f"elastid.app.stages.{module}"
