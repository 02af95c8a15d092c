"""The table of stages: for each kind of study the values that a stage is handed, its artefacts and its function.

A further stage is a row here and a file below `stages`. Functions stand as text, so that the command line, which knows
the names of all stages, loads none of them.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, fields
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeAlias

if TYPE_CHECKING:
    from elastid.study import LoadedStudy, Study

# Name of a file in the study -> the files behind it.
NamedFiles: TypeAlias = Mapping[str, tuple[Path, ...]]


@dataclass(frozen=True)
class Value:
    """A value of the study, handed over as the argument of its last name: a section, a key, a property of Study.

    name: `fit`, `validation.left_out`, `friction_joints`; `text` is the study's text.  without: keys of a section that
    a stage must not depend on, handed over at their defaults; every other key, and every key to come, counts.
    """

    name: str
    without: tuple[str, ...] = ()

    @property
    def argument(self) -> str:
        """The argument of the stage's function."""
        return self.name.rpartition(".")[2]

    def of(self, loaded: LoadedStudy) -> Any:
        """The value in a study."""
        value: Any = loaded if self.name == "text" else loaded.study
        for name in self.name.split("."):
            value = getattr(value, name)
        if not self.without or value is None:
            return value
        return type(value)(**{f.name: getattr(value, f.name) for f in fields(value) if f.name not in self.without})


@dataclass(frozen=True)
class Source:
    """The result of an earlier stage, handed over as the argument <stage>_file, where a study has that stage.

    optional: None is handed over where the file is missing or of another study; the result then says what it lacks.
    """

    stage: str
    optional: bool = False

    @property
    def argument(self) -> str:
        """The argument of the stage's function."""
        return f"{self.stage}_file"


@dataclass(frozen=True)
class Stage:
    """A stage of some kinds of study: function(*, <values>, work) -> Artefacts, see `elastid.app.work`.

    values: of the study.  sources: results of earlier stages.  files(values, folder): named by the study, handed over
    as `files`.  leaves: the first file carries the stamp, the second is for programs.  patterns: of further
    files that it leaves.  outdates: stages whose summary goes when the files of this one are written, unless it is
    current.  needs: a section without which a study has not this stage.  function, conclude: "module:name".
    conclude(run): shows the result at the end of a run; FitError where it cannot be trusted.
    """

    name: str
    kinds: tuple[str, ...]
    leaves: tuple[str, ...]
    function: str
    values: tuple[Value, ...]
    sources: tuple[Source, ...] = ()
    files: Callable[[Mapping[str, Any], Path], NamedFiles] | None = None
    patterns: tuple[str, ...] = ()
    outdates: tuple[str, ...] = ()
    needs: str = ""
    conclude: str = ""

    @property
    def module(self) -> str:
        """The module of its function."""
        return self.function.partition(":")[0]

    @property
    def texts(self) -> tuple[str, ...]:
        """Files, folders and patterns of its artefacts besides HDF5 files, which carry their own checksums."""
        return (*(name for name in self.leaves if not name.endswith(".h5")), *self.patterns)


def values(*names: str) -> tuple[Value, ...]:
    """Values by name."""
    return tuple(map(Value, names))


# Keys of `experiment` that say where its data come from: the kinds of study with a robot.
SIMULATED, RECORDED, RESPONSES = "simulated", "recorded", "responses"
WITH_A_ROBOT = (SIMULATED, RECORDED, RESPONSES)
# Studies without a robot: responses of recorded logs alone, or responses from elsewhere.
FRF, FRF_RESPONSES = "frf", "frf-responses"
# Studies of friction.
FRICTION, FRICTION_RECORDED = "friction", "friction-recorded"
OF_FRICTION = (FRICTION, FRICTION_RECORDED)


def logs(handed: Mapping[str, Any], folder: Path) -> NamedFiles:
    """The logs of a recorded experiment."""
    files = handed["experiment"].as_recorded().files
    return _plain((path for file in files for path in (file.path, *file.also)), folder)


def responses(handed: Mapping[str, Any], folder: Path) -> NamedFiles:
    """The files with frequency responses from elsewhere."""
    spec = handed["experiment"].responses
    return _plain((file.path for file in spec.files) if spec is not None else (), folder)


def tool_responses(handed: Mapping[str, Any], folder: Path) -> NamedFiles:
    """The files with responses at the tool, fitted and predicted."""
    tools = [handed["tool"], handed["validation"].tool if "validation" in handed else None]
    return _plain((file.path for tool in tools if tool is not None for file in tool.responses.files), folder)


def earlier_measurements(handed: Mapping[str, Any], folder: Path) -> NamedFiles:
    """The responses that a design adds to, or whose noise it expects, each with the fit next to it."""
    from elastid.study.checks.experiment import responses_file  # brings pydantic, which help does without

    design = handed["design"]
    paths = () if design is None else filter(None, (*design.measured, design.noise.frf))
    named = {}
    for path in paths:
        frf = responses_file(folder, path)
        fit = frf.with_name("fit.h5")
        named[path] = (frf, fit) if fit.is_file() else (frf,)
    return named


def _plain(paths: Iterable[str], folder: Path) -> NamedFiles:
    return {path: (folder / path,) for path in paths}


# The robot and places of stages before the fit, which do not depend on tolerances.
ROBOT, PLACES = Value("robot", without=("tolerances",)), Value("places", without=("tolerances",))
# Keys of `fit` for its search and its intervals, which no plan depends on.
SEARCH = (
    "starts", "start_factor", "continuation", "solver", "profile",
    "bootstrap", "seed",
)  # fmt: skip


# Values of everything that is said of a fit: the truth of a simulated rig among them.
FITTED = values("name", "robot", "experiment", "model", "seeded_fit")

# A row: name, kinds, leaves, function; then what it is handed, and what else is particular to it.
STAGES = (
    Stage(
        "design", (SIMULATED,), ("plan.h5",), "elastid.app.stages.design:design",
        values=(
            *values("seed", "robot", "excitation", "experiment", "design", "model", "validation.left_out"),
            *values("estimator.quantity", "estimator.friction"), Value("fit", without=SEARCH),
        ),
        files=earlier_measurements, patterns=("references/*.csv",),
    ),
    Stage(
        "measure", (SIMULATED,), ("records.h5",), "elastid.app.stages.measure:simulate",
        values=(*values("seed", "experiment"), ROBOT), sources=(Source("design"),),
    ),
    Stage(
        "measure", (RECORDED, FRF), ("records.h5",), "elastid.app.stages.measure:import_logs",
        values=(*values("experiment"), PLACES), files=logs,
    ),
    Stage(
        "estimate", (SIMULATED, RECORDED, FRF), ("frf.h5",), "elastid.app.stages.estimate:estimate",
        values=(*values("estimator"), ROBOT), sources=(Source("design"), Source("measure")),
    ),
    Stage(
        "estimate", (RESPONSES, FRF_RESPONSES), ("frf.h5",), "elastid.app.stages.estimate:import_responses",
        values=(*values("experiment", "estimator"), ROBOT, PLACES), files=responses,
    ),
    Stage(
        "fit", WITH_A_ROBOT, ("fit.h5", "summary.json"), "elastid.app.stages.fit:fit",
        values=(*FITTED, *values("seed", "loads", "tool", "estimator"), Value("validation.left_out")),
        files=tool_responses, sources=(Source("estimate"),),
        patterns=("identified_robot*.yml",), outdates=("validate",), conclude="elastid.app.stages.fit:conclude",
    ),
    Stage(
        "gears", (SIMULATED, RECORDED), ("gears.h5", "summary.json"), "elastid.app.stages.gears:gears",
        values=(*FITTED, *values("estimator", "gears", "validation.left_out")),
        sources=(Source("design"), Source("measure"), Source("estimate"), Source("fit")),
        patterns=("identified_robot*.yml",), outdates=("validate",), needs="gears",
        conclude="elastid.app.stages.fit:conclude",
    ),
    Stage(
        "validate", WITH_A_ROBOT, ("validation.h5", "validation.json"), "elastid.app.stages.validate:validate",
        values=(*FITTED, *values("estimator", "tool", "validation")), files=tool_responses,
        sources=(Source("measure", optional=True), Source("estimate"), Source("fit"), Source("gears")),
    ),
    Stage(
        "report", WITH_A_ROBOT, ("report.html", "figures"), "elastid.app.stages.report:report",
        values=(*FITTED, *values("text", "report")),
        sources=(Source("design"), Source("estimate"), Source("fit"), Source("gears"), Source("validate")),
    ),
    Stage(
        "report", (FRF, FRF_RESPONSES), ("report.html", "figures", "modes.csv", "modes.h5"),
        "elastid.app.stages.report:report_responses",
        values=values("name", "experiment", "estimator", "modal", "text", "report"), sources=(Source("estimate"),),
        files=responses,
    ),
    Stage(
        "design", (FRICTION,), ("plan.h5",), "elastid.app.stages.friction:design_motions",
        values=values("seed", "robot", "friction_joints", "experiment", "friction"), patterns=("references/*.csv",),
    ),
    Stage(
        "measure", (FRICTION,), ("records.h5",), "elastid.app.stages.friction:simulate_motions",
        values=values("seed", "robot", "experiment"), sources=(Source("design"),),
    ),
    Stage(
        "measure", (FRICTION_RECORDED,), ("records.h5",), "elastid.app.stages.friction:import_motions",
        values=values("robot", "friction_joints", "experiment", "friction.loads"), files=logs,
    ),
    Stage(
        "levels", OF_FRICTION, ("levels.h5",), "elastid.app.stages.friction:levels",
        values=values("robot", "friction_joints", "validation.left_out"), sources=(Source("measure"),),
    ),
    Stage(
        "friction", OF_FRICTION, ("friction.h5", "summary.json", "identified_robot.yml"),
        "elastid.app.stages.friction:friction",
        values=values("name", "robot", "experiment", "friction", "validation.left_out"),
        sources=(Source("measure"), Source("levels")),
        conclude="elastid.app.stages.friction:conclude",
    ),
    Stage(
        "follow", OF_FRICTION, ("filter.h5",), "elastid.app.stages.friction:follow_friction",
        values=values("robot", "filter"), sources=(Source("measure"), Source("friction")), needs="filter",
    ),
    Stage(
        "report", OF_FRICTION, ("report.html", "figures"), "elastid.app.stages.friction:report_friction",
        values=values("name", "text", "report"), sources=(Source("design"), Source("friction"), Source("follow")),
    ),
)  # fmt: skip


# Every name of a stage, in order.
NAMES = tuple(dict.fromkeys(stage.name for stage in STAGES))


def stages_of(kind: str) -> dict[str, Stage]:
    """The stages of a kind of study by name, in order."""
    return {stage.name: stage for stage in STAGES if kind in stage.kinds}


def stages_of_study(study: Study) -> dict[str, Stage]:
    """The stages of a study by name, in order: those of its kind, without those that need a section it has not."""
    stages = (stage for stage in STAGES if study.kind in stage.kinds)
    return {stage.name: stage for stage in stages if not stage.needs or getattr(study, stage.needs) is not None}
