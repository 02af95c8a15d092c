"""The five nouns: Robot, Record, Response, Parameters, Result, each the class of a value with its constructors.

    robot = Robot.read("robot.yml")
    records = Record.read(robot, configurations={"bench": [0]}, rate_hz=1000, channels=[...], files=[...])
    responses = Response.estimate(records, robot)
    result = Result.fit(responses, robot, Parameters.choose(robot, "k_*", "d_*"))
    print(result["k_1"])

The values are those of `elastid.robot`, `record`, `response`, `parameters` and `fit.result`, which know nothing of the
rooms above them; the constructors here call these rooms. Keyword arguments are keys of a study (`elastid explain`).
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, TypeVar

from elastid import parameters as parameter_room
from elastid import record as record_room
from elastid import response as response_room
from elastid.base.errors import StudyError
from elastid.experiment.specs.experiment import ExperimentSpec
from elastid.experiment.specs.simulated import SimulatedSpec
from elastid.fit import result as result_room
from elastid.fit.identify import identify
from elastid.fit.parameter_choice import choose
from elastid.fit.spec import FitSpec
from elastid.frf.spec import EstimatorSpec
from elastid.model.spec import ModelSpec
from elastid.nonlinear.find import find_friction
from elastid.nonlinear.places import on_shafts, shaft_couplings
from elastid.nonlinear.take_out import estimate_without_friction
from elastid.recorded.rig import RecordedRig
from elastid.robot import Robot as RobotValue
from elastid.store.measured import read_records, read_responses
from elastid.store.results import read_fit
from elastid.study import Study, load_robot
from elastid.study.checks import check_study
from elastid.study.loading import convert_to_si
from elastid.study.messages import Problem, validate

Section = TypeVar("Section")


class _Noun(type):
    """The class of a noun: it makes, and recognises, values of the class that it stands for."""

    def __call__(cls, *args: Any, **kwargs: Any) -> Any:
        return cls.__mro__[1](*args, **kwargs)

    def __instancecheck__(cls, value: Any) -> bool:
        return isinstance(value, cls.__mro__[1])


class Robot(RobotValue, metaclass=_Noun):
    """A robot: bodies, joints, springs, motors, loops; `Robot(name, bodies, ...)` or `Robot.read(path)`."""

    @staticmethod
    def read(path: Path | str) -> RobotValue:
        """The robot of a YAML file, or of a table of Denavit and Hartenberg or a URDF that it names.

        StudyError with file, line and column of every error.
        """
        return load_robot(path)


class Record(record_room.Record, metaclass=_Noun):
    """The sampled signals of one experiment; `Record.read(robot, ...)` of logs or `Record.load(path)` of records.h5."""

    @staticmethod
    def read(
        robot: RobotValue | None,
        *,
        configurations: Mapping[str, Sequence[float]],
        folder: Path | str = ".",
        **recorded: Any,
    ) -> tuple[record_room.Record, ...]:
        """The records of logs, one for each file, checked and mended; without a robot places are names.

        folder: paths of files start there.  recorded: keys of `experiment.recorded`: rate_hz, channels, files, period
        ...  Raises StudyError for arguments that contradict each other, DataError for a log that cannot be used.
        """
        data = {"configurations": dict(configurations), "recorded": recorded}
        study = Study("records", robot=robot, experiment=_section(data, ExperimentSpec))
        study, problems = convert_to_si(study)
        _refuse([*check_study(study, Path(folder)), *problems])
        rig = RecordedRig(study.places, study.experiment, Path(folder))
        return tuple(rig.measure(experiment) for experiment in rig.experiments)

    @staticmethod
    def load(path: Path | str) -> tuple[record_room.Record, ...]:
        """The records of records.h5."""
        return tuple(read_records(path))


class Response(response_room.FrequencyResponse, metaclass=_Noun):
    """G (F, n_y, n_u) of one configuration; `Response.estimate(records)` or `Response.load(path)` of frf.h5."""

    @staticmethod
    def estimate(
        records: Iterable[record_room.Record], robot: RobotValue | None = None, **estimator: Any
    ) -> response_room.Responses:
        """The response of each configuration, with friction of the motors taken out (`friction="none"`: left in).

        robot: whose gears are examined; needed where they couple axes, since friction acts on motors.
        estimator: keys of `estimator`.  Raises StudyError for wrong keys, DataError for records that cannot be
        estimated together.
        """
        spec = _section(estimator, EstimatorSpec)
        groups: dict[str, list[record_room.Record]] = {}
        for record in records:
            groups.setdefault(record.configuration.name, []).append(record)
        E = shaft_couplings(robot)
        shafts = [[on_shafts(record, E) for record in group] for group in groups.values()]
        friction = None if spec.friction == "none" else find_friction(shafts, spec)
        parts = (estimate_without_friction(group, friction, spec, None, E, robot) for group in groups.values())
        return response_room.Responses(parts)

    @staticmethod
    def load(path: Path | str) -> response_room.Responses:
        """The responses of frf.h5."""
        return read_responses(path)


class Parameters(parameter_room.ParameterSet, metaclass=_Noun):
    """Numbers of a robot with units, bounds and priors, those that are identified free; `Parameters.choose(robot)`."""

    @staticmethod
    def choose(robot: RobotValue, *names: str, **settings: Mapping[str, Any]) -> parameter_room.ParameterSet:
        """The numbers of a robot of which names or patterns (`k_*`) are free.

        settings: name to keys of `fit.parameters`, such as fm_1={"start": 0.01} or d_2={"fixed": True}.  Without any,
        every stiffness, and every damping and motor friction that is not zero.  StudyError for unknown names.
        """
        data: dict[str, Any] = {name: {} for name in names} | {name: dict(keys) for name, keys in settings.items()}
        study = Study("fit", robot=robot, experiment=_NO_LOGS, fit=_section({"parameters": data}, FitSpec))
        study, problems = convert_to_si(study)
        _refuse(problems)
        return choose(study.fit, robot)


class Result(result_room.FitResult, metaclass=_Noun):
    """Estimates with intervals, covariance, status; `Result.fit(responses, robot)` or `Result.load(path)` of fit.h5."""

    @staticmethod
    def fit(
        responses: Iterable[response_room.FrequencyResponse],
        robot: RobotValue,
        parameters: parameter_room.ParameterSet | None = None,
        *,
        model: Mapping[str, Any] | None = None,
        **fit: Any,
    ) -> result_room.FitResult:
        """The parameters of the robot that explain the responses; raises as `elastid.identify`.

        parameters: by default every stiffness, and every damping and motor friction that is not zero.  model, fit:
        keys of these sections of a study, such as model={"formulation": "minimal"}, starts=40, seed=1.
        """
        equations = _section(model or {}, ModelSpec)
        return identify(tuple(responses), robot, _section(fit, FitSpec), model=equations, parameters=parameters)

    @staticmethod
    def load(path: Path | str) -> result_room.FitResult:
        """The result of fit.h5."""
        return read_fit(path)


# For a study of which only the parameters are read.
_NO_LOGS = ExperimentSpec(simulated=SimulatedSpec())


def _section(data: Mapping[str, Any], kind: type[Section]) -> Section:
    """A section of a study from plain data; StudyError with the key of each error."""
    value, problems = validate(dict(data), kind)
    _refuse(problems)
    section: Section = value
    return section


def _refuse(problems: Sequence[Problem]) -> None:
    if problems:
        lines = (f"{'.'.join(map(str, problem.path))}: {problem.message}".removeprefix(": ") for problem in problems)
        raise StudyError("study/invalid", "\n".join(lines))
