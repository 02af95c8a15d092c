"""Table of stages: for each kind of study the keys that a stage reads, its artefacts and its function.

A further stage is a row here and a file in `stages`. Functions are named as text, so that the command line does not
import them.
"""

from collections.abc import Iterable
from dataclasses import dataclass, fields, replace
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from elastid.study import Study


@dataclass(frozen=True)
class Stage:
    """Stage of some kinds of study: function(study, work) -> Artefacts, see `elastid.app.run`.

    leaves: files, folders and patterns that it writes; the first file has the stamp, the second is for programs.
    keys: keys of the study that it reads, such as `fit`, `fit.focus`; `-fit.starts` excludes a key of a section; `text`
    is the text of the study; `experiment` is always included. The function gets defaults for all other keys.
    after: earlier stages whose results it reads if the study has them; `measure?`: the result may be missing.
    needs: section that a study with this stage must have.  conclude: "module:name", called with the run at its end;
    shows the result and raises FitError if it cannot be trusted.
    """

    name: str
    kinds: tuple[str, ...]
    leaves: tuple[str, ...]
    function: str
    keys: str
    after: str = ""
    needs: str = ""
    conclude: str = ""

    @property
    def module(self) -> str:
        """Module of the function."""
        return self.function.partition(":")[0]

    @property
    def texts(self) -> tuple[str, ...]:
        """Artefacts except HDF5 files, which contain their checksums."""
        return tuple(name for name in self.leaves if not name.endswith(".h5"))

    @property
    def sources(self) -> dict[str, bool]:
        """Earlier stages that it reads, with True if the result may be missing."""
        return {name.removesuffix("?"): name.endswith("?") for name in self.after.split()}

    def select_keys(self, study: "Study") -> "Study":
        """Return the study with the keys that the stage reads, and defaults for all others."""
        study_of_name = study if "name" in self.keys.split() else replace(study, name="study")
        selection: Study = _select(study_of_name, ["name", "experiment", *self.keys.split()])
        return selection


def _select(section: Any, keys: Iterable[str]) -> Any:
    """Return a section with the values of these keys, and defaults for all others."""
    values = {}
    for name in [field.name for field in fields(section)]:
        value = getattr(section, name)
        below, without = ([k.partition(".")[2] for k in keys if k.startswith(f"{sign}{name}.")] for sign in ("", "-"))
        if value is not None and name in keys and without:
            value = _select(value, [field.name for field in fields(value) if field.name not in without])
        elif value is not None and below:
            value = _select(value, below)
        if name in keys or below:
            values[name] = value
    return type(section)(**values)


def files_of(study: "Study") -> list[str]:
    """List the files that a study names, relative to its folder: logs and responses."""
    recorded = study.experiment.recorded
    names = [path for file in (() if recorded is None else recorded.files) for path in (file.path, *file.also)]
    tool_specs = [tool.responses for tool in (study.tool, study.validation.tool) if tool is not None]
    specs = (study.experiment.responses, *tool_specs)
    return names + [file.path for spec in specs if spec is not None for file in spec.files]


# Kinds of study with a robot, by the key of `experiment` that defines the data.
SIMULATED, RECORDED, RESPONSES = "simulated", "recorded", "responses"
WITH_A_ROBOT = (SIMULATED, RECORDED, RESPONSES)
# Kinds of study without a robot: responses of logs, or responses of other programs.
FRF, FRF_RESPONSES = "frf", "frf-responses"
# Kinds of friction study.
FRICTION, FRICTION_RECORDED = "friction", "friction-recorded"
OF_FRICTION = (FRICTION, FRICTION_RECORDED)

# Stages before the fit do not depend on tolerances.
ROBOT = "robot -robot.tolerances"
# A plan does not depend on the keys of the search for the optimum and of the intervals.
PLANNED = "fit -fit.starts -fit.start_factor -fit.solver -fit.profile -fit.bootstrap -fit.seed"
# Keys of all stages from the fit on.
FIT_KEYS = "name robot model fit seed"

# A row: name, kinds, leaves, function, keys, earlier stages; then further properties.
STAGES = (
    Stage(
        "design", (SIMULATED,), ("plan.h5", "references/*.csv"), "elastid.app.stages.design:design",
        f"seed robot excitation design model validation.configurations estimator.quantity estimator.friction {PLANNED}"
    ),
    Stage(
        "measure", (SIMULATED,), ("records.h5",), "elastid.app.stages.measure:simulate", f"seed {ROBOT}", "design"
    ),
    Stage("measure", (RECORDED, FRF), ("records.h5",), "elastid.app.stages.measure:import_logs", ROBOT),
    Stage(
        "estimate", (SIMULATED, RECORDED, FRF), ("frf.h5",), "elastid.app.stages.estimate:estimate",
        f"estimator {ROBOT}", "design measure"
    ),
    Stage(
        "estimate", (RESPONSES, FRF_RESPONSES), ("frf.h5",), "elastid.app.stages.estimate:import_responses",
        f"estimator {ROBOT}"
    ),
    Stage(
        "fit", WITH_A_ROBOT, ("fit.h5", "summary.json", "identified_robot*.yml"), "elastid.app.stages.fit:fit",
        f"{FIT_KEYS} loads tool estimator validation.configurations", "estimate",
        conclude="elastid.app.stages.fit_conclusion:conclude"
    ),
    Stage(
        "gears", (SIMULATED, RECORDED), ("gears.h5", "summary.json", "identified_robot*.yml"),
        "elastid.app.stages.gears:gears", f"{FIT_KEYS} estimator gears validation.configurations",
        "design measure estimate fit", needs="gears", conclude="elastid.app.stages.fit_conclusion:conclude"
    ),
    Stage(
        "validate", WITH_A_ROBOT, ("validation.h5", "validation.json"), "elastid.app.stages.validate:validate",
        f"{FIT_KEYS} estimator tool validation", "measure? estimate fit gears"
    ),
    Stage(
        "report", WITH_A_ROBOT, ("report.html", "figures"), "elastid.app.stages.report:report",
        f"{FIT_KEYS} text report", "design estimate fit gears validate"
    ),
    Stage(
        "report", (FRF, FRF_RESPONSES), ("report.html", "figures", "modes.csv", "modes.h5"),
        "elastid.app.stages.report:report_responses", "name estimator modal text report", "estimate"
    ),
    Stage(
        "design", (FRICTION,), ("plan.h5", "references/*.csv"), "elastid.app.stages.friction:design_motions",
        "seed robot friction"
    ),
    Stage(
        "measure", (FRICTION,), ("records.h5",), "elastid.app.stages.friction:simulate_motions", "seed robot", "design"
    ),
    Stage(
        "measure", (FRICTION_RECORDED,), ("records.h5",), "elastid.app.stages.friction:import_motions",
        "robot friction.joints friction.loads"
    ),
    Stage(
        "constant_velocity", OF_FRICTION, ("constant_velocity.h5",), "elastid.app.stages.friction:constant_velocity",
        "robot friction.joints validation.configurations", "measure"
    ),
    Stage(
        "friction", OF_FRICTION, ("friction.h5", "summary.json", "identified_robot.yml"),
        "elastid.app.stages.friction:friction", "name robot friction validation.configurations",
        "measure constant_velocity", conclude="elastid.app.stages.friction:conclude"
    ),
    Stage(
        "follow", OF_FRICTION, ("filter.h5",), "elastid.app.stages.friction:track_friction", "robot filter",
        "measure friction", needs="filter"
    ),
    Stage(
        "report", OF_FRICTION, ("report.html", "figures"), "elastid.app.stages.friction:report_friction",
        "name text report", "design friction follow"
    )
)  # fmt: skip


NAMES = tuple(dict.fromkeys(stage.name for stage in STAGES))  # of all stages, in order


def stages_of(kind: str) -> dict[str, Stage]:
    """Return the stages of a kind of study by name, in order."""
    return {stage.name: stage for stage in STAGES if kind in stage.kinds}


def stages_of_study(study: "Study") -> dict[str, Stage]:
    """Return the stages of a study by name, in order, without stages whose section is missing."""
    stages = (stage for stage in STAGES if study.kind in stage.kinds)
    return {stage.name: stage for stage in stages if not stage.needs or getattr(study, stage.needs) is not None}
