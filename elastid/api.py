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
from elastid.experiment.simulated.plant import closed_loop_of
from elastid.experiment.simulated.rig import SimulatedRig
from elastid.experiment.specs.experiment import ExperimentSpec
from elastid.experiment.specs.simulated import SimulatedSpec
from elastid.fit import identify as fitting
from elastid.fit import parameter_selection
from elastid.fit.result import Result
from elastid.fit.spec import FitSpec
from elastid.frf.checks import check_consistency
from elastid.frf.spec import EstimatorSpec
from elastid.logs.rig import RecordedRig
from elastid.model.spec import ModelSpec
from elastid.nonlinear.compensate_friction import shaft_couplings, to_shafts
from elastid.nonlinear.identify_friction import identify_motor_friction
from elastid.nonlinear.net_response import estimate_net_response
from elastid.parameters import Parameters
from elastid.record import Record
from elastid.response import Response, Responses
from elastid.robot import Robot
from elastid.store import friction_study, measured, plan, results
from elastid.store.artefacts import kind_of, open_artefact
from elastid.store.measured import write_records, write_responses
from elastid.store.results import write_fit
from elastid.study import Study, load_robot
from elastid.study.checks import check_study
from elastid.study.loading import convert_to_si
from elastid.study.messages import Problem, validate

Section = TypeVar("Section")


def read_robot(path: Path | str) -> Robot:
    """Read a robot model from a YAML file, which may refer to a Denavit-Hartenberg table or a URDF.

    Parameters
    ----------
    path : Path or str
        Robot model file.

    Returns
    -------
    Robot

    Raises
    ------
    StudyError
        For a file with errors; the message has file, row and column of each.

    Examples
    --------
    >>> from pathlib import Path
    >>> from tempfile import TemporaryDirectory
    >>> text = "{name: bench, bodies: [{name: load, inertia: 0.02, joints: [{name: 1, motor: {inertia: 0.01}}]}]}"
    >>> with TemporaryDirectory() as folder:
    ...     path = Path(folder) / "robot.yml"
    ...     _ = path.write_text(text)
    ...     read_robot(path).driven_names
    ('1',)
    """
    return load_robot(path)


def read_records(
    robot: Robot | None, *, configurations: Mapping[str, Sequence[float]], folder: Path | str = ".", **recorded: Any
) -> tuple[Record, ...]:
    """Read logs as records, one per file, checked and corrected.

    Parameters
    ----------
    robot : Robot or None
        Robot of the logs; without a robot, locations of channels are free names.
    configurations : mapping of str to sequence of float
        Angles of the driven joints by name of the configuration, in rad (m for sliding joints).
    folder : Path or str
        Folder of relative paths in `files`.
    **recorded
        Keys of `experiment.recorded`: rate_hz, channels, files, period ... (`elastid explain experiment.recorded`).

    Returns
    -------
    tuple of Record

    Raises
    ------
    StudyError
        For keys that contradict each other.
    DataError
        For a log that cannot be used.

    Examples
    --------
    >>> from pathlib import Path
    >>> from tempfile import TemporaryDirectory
    >>> import numpy as np
    >>> u = np.tile(np.random.default_rng(0).normal(size=500), 4)
    >>> channels = [{"role": "u", "at": "shaker", "channel": "F", "quantity": "force", "unit": "N"}]
    >>> channels += [{"role": "y", "at": "tip x", "channel": "a", "quantity": "acceleration", "unit": "m/s^2"}]
    >>> with TemporaryDirectory() as folder:
    ...     np.savetxt(Path(folder) / "log.csv", np.c_[u, 2 * u], delimiter=",", header="F,a", comments="")
    ...     files = [{"path": "log.csv", "configuration": "bench"}]
    ...     (record,) = read_records(
    ...         None, configurations={"bench": []}, folder=folder, rate_hz=500, period=1, channels=channels, files=files
    ...     )
    >>> record.u.shape, record.n_periods
    ((2000, 1), 4)
    """
    data = {"configurations": dict(configurations), "recorded": recorded}
    study = _consistent(Study("records", robot=robot, experiment=_section(data, ExperimentSpec)), Path(folder))
    rig = RecordedRig(study.places, study.experiment, Path(folder))
    return tuple(rig.measure(experiment) for experiment in rig.experiments)


def simulate(
    robot: Robot, *, excitation: Mapping[str, Any], experiment: Mapping[str, Any], seed: int = 0
) -> tuple[Record, ...]:
    """Simulate records of a robot under a multisine.

    Parameters
    ----------
    robot : Robot
        Robot with the nominal parameters; `experiment.simulated.truth` changes them.
    excitation : mapping
        Keys of `excitation`: rate_hz, period, band_hz, torque_rms ...
    experiment : mapping
        Keys of `experiment`: configurations, realisations, periods, simulated ...
    seed : int
        Seed of phases and noise.

    Returns
    -------
    tuple of Record
        One record per experiment, on the link side.

    Raises
    ------
    StudyError
        For keys that contradict each other or limits that leave no excitation.

    Examples
    --------
    >>> from elastid import Body, Joint, Motor, Robot, Spring
    >>> joint = Joint("1", spring=Spring(100.0, damping=0.1), motor=Motor(0.01))
    >>> robot = Robot("bench", (Body("load", joints=(joint,), inertia=0.02),))
    >>> excitation = {"rate_hz": 500, "period": 1, "band_hz": [5, 50], "torque_rms": [1]}
    >>> experiment = {"configurations": {"bench": [0]}, "simulated": {"noise": {"torque_std": 0.01}}}
    >>> records = simulate(robot, excitation=excitation, experiment=experiment)
    >>> len(records), records[0].y.shape
    (2, (1000, 1))
    """
    spec, repeated = _section(excitation, MultisineSpec), _section(experiment, ExperimentSpec)
    study = _consistent(Study("records", seed, robot, excitation=spec, experiment=repeated))
    spec, controller = study.excitation or spec, study.experiment.as_simulated().controller
    loop = closed_loop_of(robot, controller, spec.rate_hz, spec.inject)
    plan = make_plan(spec, study.experiment, robot, seed=seed, closed_loop=loop)
    rig = SimulatedRig(robot, study.experiment, plan, seed=seed)
    return tuple(rig.measure(trial) for trial in rig.experiments)


def choose(robot: Robot, *names: str, **settings: Mapping[str, Any]) -> Parameters:
    """Choose the free parameters of a robot.

    Parameters
    ----------
    robot : Robot
        Robot with start values.
    *names : str
        Names or patterns (`k_*`) of free parameters. Default: every stiffness, and every damping and motor friction
        that is not zero.
    **settings
        Keys of `fit.parameters` by name, such as fm_1={"start": 0.01} or d_2={"fixed": True}.

    Returns
    -------
    Parameters

    Raises
    ------
    StudyError
        For unknown names and settings.

    Examples
    --------
    >>> from elastid import Body, Joint, Motor, Robot, Spring
    >>> joint = Joint("1", spring=Spring(100.0, damping=0.1), motor=Motor(0.01))
    >>> robot = Robot("bench", (Body("load", joints=(joint,), inertia=0.02),))
    >>> choose(robot, "k_*", d_1={"bounds": [0.01, 1]}).free_names
    ('k_1', 'd_1')
    """
    data: dict[str, Any] = {name: {} for name in names} | {name: dict(keys) for name, keys in settings.items()}
    study = Study("fit", robot=robot, experiment=_NO_LOGS, fit=_section({"parameters": data}, FitSpec))
    study, problems = convert_to_si(study)
    _refuse(problems)
    return parameter_selection.choose(study.fit, robot)


def estimate(records: Iterable[Record], robot: Robot | None = None, **estimator: Any) -> Responses:
    """Estimate the frequency response of each configuration, with compensated motor friction.

    Parameters
    ----------
    records : iterable of Record
        Records of one or more configurations.
    robot : Robot or None
        Robot of the records; needed if gears couple axes, since friction acts on motors.
    **estimator
        Keys of `estimator`: method, band_hz, friction ... (friction="none" for uncompensated friction).

    Returns
    -------
    Responses
        One Response G (F, n_y, n_u) per configuration, output per torque on the link side.

    Raises
    ------
    StudyError
        For wrong keys.
    DataError
        For records that cannot be estimated together.

    Examples
    --------
    >>> from elastid import Body, Joint, Motor, Robot, Spring
    >>> joint = Joint("1", spring=Spring(100.0, damping=0.1), motor=Motor(0.01))
    >>> robot = Robot("bench", (Body("load", joints=(joint,), inertia=0.02),))
    >>> excitation = {"rate_hz": 500, "period": 1, "band_hz": [5, 50], "torque_rms": [1]}
    >>> experiment = {"configurations": {"bench": [0]}, "simulated": {"noise": {"torque_std": 0.01}}}
    >>> records = simulate(robot, excitation=excitation, experiment=experiment)
    >>> responses = estimate(records)
    >>> responses["bench"].G.shape
    (23, 1, 1)
    """
    spec = _section(estimator, EstimatorSpec)
    groups: dict[str, list[Record]] = {}
    for record in records:
        groups.setdefault(record.configuration.name, []).append(record)
    if not groups:
        check_consistency([])
    E = shaft_couplings(robot)
    shafts = [[to_shafts(record, E) for record in group] for group in groups.values()]
    friction = None if spec.friction == "none" else identify_motor_friction(shafts, spec)
    return Responses(estimate_net_response(group, friction, spec, None, E, robot) for group in groups.values())


def identify(
    responses: Sequence[Response], robot: Robot, parameters: Parameters | None = None, *,
    model: Mapping[str, Any] | None = None, **fit: Any,
) -> Result:  # fmt: skip
    """Identify the parameters of a robot from frequency responses.

    Parameters
    ----------
    responses : sequence of Response
        Measured responses, one per configuration.
    robot : Robot
        Robot model with start values.
    parameters : Parameters or None
        Free parameters of `choose`. Default: every stiffness, and every damping and motor friction that is not zero.
    model : mapping or None
        Keys of `model`, such as {"formulation": "minimal"}.
    **fit
        Keys of `fit`: starts, band_hz, weights, seed ...

    Returns
    -------
    Result
        Estimates in SI with 95 % intervals, covariance and status.

    Raises
    ------
    StudyError
        For wrong keys, unknown names and responses that do not fit the robot.
    FitError
        If no start leads to an optimum.

    Examples
    --------
    >>> from elastid import Body, Joint, Motor, Robot, Spring
    >>> joint = Joint("1", spring=Spring(100.0, damping=0.1), motor=Motor(0.01))
    >>> robot = Robot("bench", (Body("load", joints=(joint,), inertia=0.02),))
    >>> excitation = {"rate_hz": 500, "period": 1, "band_hz": [5, 50], "torque_rms": [1]}
    >>> experiment = {"configurations": {"bench": [0]}, "simulated": {"noise": {"torque_std": 0.01}}}
    >>> records = simulate(robot, excitation=excitation, experiment=experiment)
    >>> result = identify(estimate(records), robot, choose(robot, "k_*"), starts=2)
    >>> result.status, round(result["k_1"].value)
    ('converged', 100)
    """
    equations, spec = _section(model or {}, ModelSpec), _section(fit, FitSpec)
    return fitting.identify(responses, robot, spec, model=equations, parameters=parameters)


def load(path: Path | str) -> Any:
    """Read a file of a run.

    Parameters
    ----------
    path : Path or str
        records.h5 (tuple of Record), frf.h5 (Responses), fit.h5 (Result), validation.h5 ...

    Returns
    -------
    value
        The value in the file.

    Raises
    ------
    DataError
        For other files, and for damaged ones.

    Examples
    --------
    >>> from tempfile import TemporaryDirectory
    >>> from elastid import Body, Joint, Motor, Robot, Spring
    >>> joint = Joint("1", spring=Spring(100.0, damping=0.1), motor=Motor(0.01))
    >>> robot = Robot("bench", (Body("load", joints=(joint,), inertia=0.02),))
    >>> excitation = {"rate_hz": 500, "period": 1, "band_hz": [5, 50], "torque_rms": [1]}
    >>> experiment = {"configurations": {"bench": [0]}, "simulated": {"noise": {"torque_std": 0.01}}}
    >>> records = simulate(robot, excitation=excitation, experiment=experiment)
    >>> with TemporaryDirectory() as folder:
    ...     save(f"{folder}/records.h5", records)
    ...     load(f"{folder}/records.h5")[0].inputs
    ('motor 1',)
    """
    kind = kind_of(path) or ""
    with open_artefact(path, kind if kind in _READERS else f"one of {', '.join(_READERS)}"):
        return _READERS[kind](path)


def save(path: Path | str, value: Result | Sequence[Response] | Iterable[Record]) -> None:
    """Write a value as the file of a run that `load` reads.

    Parameters
    ----------
    path : Path or str
        File to write, such as fit.h5.
    value : Result, sequence of Response or iterable of Record
        Value to write.

    Raises
    ------
    TypeError
        For another value.

    Examples
    --------
    >>> from tempfile import TemporaryDirectory
    >>> import numpy as np
    >>> from elastid import Configuration, Response
    >>> G = np.ones((2, 1, 1), complex)
    >>> posture = Configuration("bench", [0.0])
    >>> response = Response(np.array([5.0, 6.0]), G, ("motor 1",), ("motor 1",), "position", posture)
    >>> with TemporaryDirectory() as folder:
    ...     save(f"{folder}/frf.h5", [response])
    ...     load(f"{folder}/frf.h5")["bench"].freq_hz.tolist()
    [5.0, 6.0]
    """
    if isinstance(value, Result):
        write_fit(path, value)
        return
    responses = tuple(value) if isinstance(value, Iterable) else ()
    if responses and all(isinstance(response, Response) for response in responses):
        write_responses(path, responses)
    elif responses and all(isinstance(response, Record) for response in responses):
        write_records(path, responses)
    else:
        raise TypeError(f"value is of type {type(value).__name__}; give a Result, or a sequence of Response or Record")


_READERS: dict[str, Callable[[Path | str], Any]] = {
    "plan": plan.read_plan, "records": lambda path: tuple(measured.read_records(path)),
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
    """Read a section of a study from plain data; StudyError with the key of each error."""
    value, problems = validate(dict(data), kind)
    _refuse(problems)
    section: Section = value
    return section


def _consistent(study: Study, folder: Path = Path()) -> Study:
    """Return a study in SI whose sections fit together; StudyError otherwise."""
    study, problems = convert_to_si(study)
    _refuse([*check_study(study, folder), *problems])
    return study


def _refuse(problems: Sequence[Problem]) -> None:
    if problems:
        lines = (f"{'.'.join(map(str, problem.path))}: {problem.message}".removeprefix(": ") for problem in problems)
        raise StudyError("study/invalid", "\n".join(lines))
