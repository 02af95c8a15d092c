"""The verbs between the five nouns: plain functions from a robot and its logs to stiffness with intervals.

    robot = read_robot("robot.yml")
    records = read_records(robot, configurations={"bench": [0]}, rate_hz=1000, channels=[...], files=[...])
    responses = estimate(records, robot)
    result = identify(responses, robot, choose(robot, "k_*", "d_*"))
    print(result["k_1"])

Keyword arguments are keys of a study (`elastid explain`); the rooms below take the sections that are made of them.
"""

from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, TypeVar

from elastid.base.errors import StudyError
from elastid.excitation.spec import MultisineSpec
from elastid.experiment.plan.plan import make_plan
from elastid.experiment.simulated.rig import SimulatedRig
from elastid.experiment.specs.experiment import ExperimentSpec
from elastid.experiment.specs.simulated import SimulatedSpec
from elastid.fit import identify as fitting
from elastid.fit import parameter_choice
from elastid.fit.result import Result
from elastid.fit.spec import FitSpec
from elastid.frf.checks import refuse_mismatch
from elastid.frf.spec import EstimatorSpec
from elastid.model.spec import ModelSpec
from elastid.nonlinear.find import find_friction
from elastid.nonlinear.take_out import estimate_without_friction, on_shafts, shaft_couplings
from elastid.parameters import Parameters
from elastid.record import Record
from elastid.recorded.rig import RecordedRig
from elastid.response import Response, Responses
from elastid.robot import Robot
from elastid.store import friction_study, measured, results
from elastid.store.artefacts import kind_of, opened
from elastid.store.measured import write_records, write_responses
from elastid.store.results import write_fit
from elastid.study import Study, load_robot
from elastid.study.checks import check_study
from elastid.study.loading import convert_to_si
from elastid.study.messages import Problem, validate

Section = TypeVar("Section")


def read_robot(path: Path | str) -> Robot:
    """The robot of a YAML file, or of a table of Denavit and Hartenberg or a URDF that it names.

    StudyError with file, line and column of every error.
    """
    return load_robot(path)


def read_records(
    robot: Robot | None, *, configurations: Mapping[str, Sequence[float]], folder: Path | str = ".", **recorded: Any
) -> tuple[Record, ...]:
    """The records of logs, one for each file, checked and mended; without a robot places are names.

    folder: paths of files start there.  recorded: keys of `experiment.recorded`: rate_hz, channels, files, period ...
    Raises StudyError for arguments that contradict each other, DataError for a log that cannot be used.
    """
    data = {"configurations": dict(configurations), "recorded": recorded}
    study = _consistent(Study("records", robot=robot, experiment=_section(data, ExperimentSpec)), Path(folder))
    rig = RecordedRig(study.places, study.experiment, Path(folder))
    return tuple(rig.measure(experiment) for experiment in rig.experiments)


def simulate(
    robot: Robot, *, excitation: Mapping[str, Any], experiment: Mapping[str, Any], seed: int = 0
) -> tuple[Record, ...]:
    """The records of a simulated robot under a multisine; excitation, experiment: keys of these sections of a study."""
    spec, repeated = _section(excitation, MultisineSpec), _section(experiment, ExperimentSpec)
    study = _consistent(Study("records", seed, robot, excitation=spec, experiment=repeated))
    plan = make_plan(study.excitation or spec, study.experiment, robot, seed=seed)
    rig = SimulatedRig(robot, study.experiment, plan, seed=seed)
    return tuple(rig.measure(trial) for trial in rig.experiments)


def choose(robot: Robot, *names: str, **settings: Mapping[str, Any]) -> Parameters:
    """The numbers of a robot of which names or patterns (`k_*`) are free.

    settings: name to keys of `fit.parameters`, such as fm_1={"start": 0.01} or d_2={"fixed": True}.  Without any, every
    stiffness, and every damping and motor friction that is not zero.  StudyError for unknown names.
    """
    data: dict[str, Any] = {name: {} for name in names} | {name: dict(keys) for name, keys in settings.items()}
    study = Study("fit", robot=robot, experiment=_NO_LOGS, fit=_section({"parameters": data}, FitSpec))
    study, problems = convert_to_si(study)
    _refuse(problems)
    return parameter_choice.choose(study.fit, robot)


def estimate(records: Iterable[Record], robot: Robot | None = None, **estimator: Any) -> Responses:
    """The response of each configuration, with friction of the motors taken out (`friction="none"`: left in).

    robot: whose gears are examined; needed where they couple axes, since friction acts on motors.
    estimator: keys of `estimator`.  Raises StudyError for wrong keys, DataError for records that cannot be estimated
    together.
    """
    spec = _section(estimator, EstimatorSpec)
    groups: dict[str, list[Record]] = {}
    for record in records:
        groups.setdefault(record.configuration.name, []).append(record)
    if not groups:
        refuse_mismatch([])
    E = shaft_couplings(robot)
    shafts = [[on_shafts(record, E) for record in group] for group in groups.values()]
    friction = None if spec.friction == "none" else find_friction(shafts, spec)
    return Responses(estimate_without_friction(group, friction, spec, None, E, robot) for group in groups.values())


def identify(
    responses: Sequence[Response], robot: Robot, parameters: Parameters | None = None, *,
    model: Mapping[str, Any] | None = None, **fit: Any,
) -> Result:  # fmt: skip
    """The parameters of the robot that explain the responses; raises as `elastid.fit.identify`.

    parameters: by default every stiffness, and every damping and motor friction that is not zero.  model, fit: keys of
    these sections of a study, such as model={"formulation": "minimal"}, starts=40, seed=1.
    """
    equations, spec = _section(model or {}, ModelSpec), _section(fit, FitSpec)
    return fitting.identify(responses, robot, spec, model=equations, parameters=parameters)


def load(path: Path | str) -> Any:
    """The value in a file of a run: records.h5, frf.h5, fit.h5, validation.h5 ...; DataError where it is none of them.

    records.h5 is a tuple of `Record`, frf.h5 has a `Response` for each configuration, fit.h5 is a `Result`.
    """
    kind = kind_of(path) or ""
    with opened(path, kind if kind in _READERS else f"one of {', '.join(_READERS)}"):
        return _READERS[kind](path)


def save(path: Path | str, value: Result | Sequence[Response] | Iterable[Record]) -> None:
    """Write a result, responses or records as the file of a run that `load` reads."""
    if isinstance(value, Result):
        write_fit(path, value)
        return
    parts: tuple[Any, ...] = tuple(value) if isinstance(value, Iterable) else ()
    if parts and all(isinstance(part, Response) for part in parts):
        write_responses(path, parts)
    elif parts and all(isinstance(part, Record) for part in parts):
        write_records(path, parts)
    else:
        raise TypeError(f"value is of type {type(value).__name__}; give a Result, or a sequence of Response or Record")


_READERS: dict[str, Callable[[Path | str], Any]] = {
    "plan": measured.read_plan, "records": lambda path: tuple(measured.read_records(path)),
    "frf": measured.read_responses, "modes": measured.read_modes, "fit": results.read_fit,
    "gears": results.read_gears, "validation": results.read_validation, "map": results.read_map,
    "tune": results.read_tune, "loops": results.read_loops, "friction plan": friction_study.read_friction_plan,
    "friction records": friction_study.read_friction_records,
    "constant-velocity torques": friction_study.read_constant_velocity,
    "friction": friction_study.read_friction_result, "filter": friction_study.read_filter,
}  # fmt: skip

# For a study of which only the parameters are read.
_NO_LOGS = ExperimentSpec(simulated=SimulatedSpec())


def _section(data: Mapping[str, Any], kind: type[Section]) -> Section:
    """A section of a study from plain data; StudyError with the key of each error."""
    value, problems = validate(dict(data), kind)
    _refuse(problems)
    section: Section = value
    return section


def _consistent(study: Study, folder: Path = Path()) -> Study:
    """A study in SI whose sections fit together; StudyError else."""
    study, problems = convert_to_si(study)
    _refuse([*check_study(study, folder), *problems])
    return study


def _refuse(problems: Sequence[Problem]) -> None:
    if problems:
        lines = (f"{'.'.join(map(str, problem.path))}: {problem.message}".removeprefix(": ") for problem in problems)
        raise StudyError("study/invalid", "\n".join(lines))
