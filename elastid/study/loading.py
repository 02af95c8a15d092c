"""A study file and the overrides of the command line -> a checked Study; all errors in one StudyError."""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from html import escape
from itertools import takewhile
from pathlib import Path
from typing import Any, TypeAlias

from elastid.base.errors import StudyError, did_you_mean
from elastid.base.escape import comment_lines, printable
from elastid.base.names import SEPARATOR, at_amplitude, is_match, match_names
from elastid.base.units import Quantity, to_si
from elastid.fit.parameter_selection import choose, named_on_demand
from elastid.fit.spec import ParameterSpec
from elastid.parameters import DELAY
from elastid.robot import Robot, Tolerances
from elastid.robot.friction_numbers import friction_numbers, with_numbers
from elastid.robot.tolerances import EXACT, TORQUE_CONSTANT_STD, kind_of
from elastid.study.checks import check_study
from elastid.study.load_file import existing_file, with_load_file
from elastid.study.messages import NO_LOG, Problem, make_error, validate
from elastid.study.robots import read_robot, with_robot
from elastid.study.sections import Study
from elastid.study.source import KeyPath, Place, YamlSource, parse, read_source

# Value in SI and unit of each parameter.
Table: TypeAlias = Mapping[str, tuple[float, str]]

_FIT: KeyPath = ("fit", "parameters")
_TRUTH: KeyPath = ("experiment", "simulated", "truth")


def convert_to_si(study: Study) -> tuple[Study, list[Problem]]:
    """Convert every quantity of a study to float in SI; return also problems: names, units, `choose`."""
    if study.robot is None:
        return study, []
    problems: list[Problem] = []
    numbers = {**study.robot.parameters(study.robot.on_demand), **friction_numbers(study.robot)}
    names = named_on_demand(study.fit.parameters, study.robot)
    table: Table = {**study.robot.parameters(names), DELAY: (0.0, "s")}
    parameters = {
        name: _convert_parameter(spec, name, table, numbers, problems) for name, spec in study.fit.parameters.items()
    }
    study = replace(study, fit=replace(study.fit, parameters=parameters))
    simulated = study.experiment.simulated
    if simulated is not None:
        truth: dict[str, Quantity] = {
            name: _convert(value, [name] if name in numbers else [], (*_TRUTH, name), numbers, problems)
            for name, value in simulated.truth.items()
        }
        study = replace(study, experiment=study.experiment.with_truth(truth))
        problems += _check_truth(study, truth) if not problems else []
    return study, problems or ([] if study.friction is not None else _check_choice(study))


def _convert_parameter(
    spec: ParameterSpec, pattern: str, table: Table, all_numbers: Table, problems: list[Problem]
) -> ParameterSpec:
    """Convert a specification to SI. table: parameters. all_numbers: including geometry and gains that no key names."""
    path = (*_FIT, pattern)
    names = list(match_names(pattern, table))

    def number(value: Quantity, *keys: str | int) -> float:
        return _convert(value, names, (*path, *keys), table, problems)

    if not names:
        advice = did_you_mean(pattern, table, all_numbers)
        problems.append(Problem(path, f"the robot has no parameter '{pattern}'; {advice}", at_key=True))
        return spec
    start = None if spec.start is None else number(spec.start, "start")
    bounds = None if spec.bounds is None else (number(spec.bounds[0], "bounds", 0), number(spec.bounds[1], "bounds", 1))
    prior = spec.prior
    if prior is not None and prior.mean is not None:
        prior = replace(prior, mean=number(prior.mean, "prior", "mean"))
    if spec.tie is not None and (spec.tie.to not in table or spec.tie.to in names):
        message = f"cannot be tied to '{spec.tie.to}'; {did_you_mean(spec.tie.to, table)}"
        problems.append(Problem((*path, "tie", "to"), message))
    return replace(spec, start=start, bounds=bounds, prior=prior)


def _convert(value: Quantity, names: list[str], path: KeyPath, table: Table, problems: list[Problem]) -> float:
    """Convert a number of parameters of one unit to SI; 0 where there is a problem."""
    units = sorted({table[name][1] for name in names})
    if not units:
        message = f"the robot has no parameter '{path[-1]}'; {did_you_mean(str(path[-1]), table)}"
        problems.append(Problem(path, message, True))
    elif len(units) > 1:
        message = f"matches parameters of different units ({', '.join(units)}). Name them one by one"
        problems.append(Problem(path, message))
    else:
        try:
            return to_si(value, units[0])
        except ValueError as error:
            problems.append(Problem(path, str(error)))
    return 0.0


def with_usual_tolerances(study: Study) -> Study:
    """Return the study whose robot has the tolerances of its fit, where its file leaves them to the study.

    Common ones where responses are measured, of torque constants where they turn currents into torques.  A simulated
    rig is as exact as its file, unless its truth has another value of a number that the fit holds.
    """
    robot, experiment = study.robot, study.experiment
    if robot is None or study.friction is not None or robot.tolerances == EXACT:
        return study
    tolerances = robot.tolerances
    if experiment.simulated is not None:
        paths = {name: path for name, (_, path) in (robot.numbers | robot.geometry).items()}
        free = choose(study.fit, robot, tuple(experiment.configurations)).free_names
        fixed = [name for name in experiment.simulated.truth if name in paths and name not in free]
        if tolerances is None and any(kind_of(paths[name]) for name in fixed):
            tolerances = Tolerances()
    else:
        has_current = any(channel.quantity == "current" for channel in experiment.channels)
        tolerances = tolerances or Tolerances()
        if tolerances.torque_constant is None:
            tolerances = replace(tolerances, torque_constant=TORQUE_CONSTANT_STD if has_current else EXACT)
    return replace(study, robot=replace(robot, tolerances=tolerances))


def _check_truth(study: Study, truth: Mapping[str, Quantity]) -> list[Problem]:
    robot = study.as_robot()
    values = {name: float(value) for name, value in truth.items()}
    friction = {name: value for name, value in values.items() if name in friction_numbers(robot)}
    singles = [{name: value} for name, value in values.items() if name not in friction]
    # Together they may be possible where one alone is not, as the three inertias of a slender body.
    if (refusal := _refusal(robot, values)) is None:
        return []
    error, name = next(filter(None, (_refusal(robot, trial) for trial in (*singles, friction))), refusal)
    return [Problem((*_TRUTH, name), f"no robot has this value: {error}")]


def _refusal(robot: Robot, values: Mapping[str, float]) -> tuple[ValueError, str] | None:
    """Return the error of a robot with these numbers, and the first of their names; None for a robot that can be."""
    try:
        with_numbers(robot, values)
    except ValueError as error:
        return error, next(iter(values))
    return None


def _check_choice(study: Study) -> list[Problem]:
    """Return the refusal by `choose` of all parameters together, at the key that its message names."""
    try:
        choose(study.fit, study.as_robot(), tuple(study.experiment.configurations))
    except StudyError as error:
        message = str(error).removeprefix("fit.parameters").lstrip(".: ")
        match = re.match(r"[^\s:.]+", message)
        parameters = study.fit.parameters
        keys = [key for key in parameters if match and is_match(match[0].partition(SEPARATOR)[0], key)]
        keys += [key for key in parameters if match and match[0] == key]
        for key in keys[-1:]:
            if message.startswith((f"{key}:", f"{key}.")):
                message = message.removeprefix(key).lstrip(".: ")
            inner = ("bounds",) if "bound" in message and parameters[key].bounds is not None else ()
            return [Problem((*_FIT, key, *inner), message)]
        return [Problem(_FIT, message)]
    return []


@dataclass(frozen=True)
class LoadedStudy:
    """A study, the path of its file, and the text of the files and overrides that it was read from."""

    study: Study
    path: Path
    text: str
    overrides: tuple[str, ...] = ()

    def __repr__(self) -> str:
        return f"{printable(str(self.path))}: {self.study!r}"

    def _repr_html_(self) -> str:
        return f"<p>{escape(printable(str(self.path)))}</p>{self.study.display.html}"


def load(path: Path | str, overrides: Sequence[str] = ()) -> LoadedStudy:
    """Load the study of a YAML file, `overrides`, each as 'key.path=value', taking the place of its keys.

    Raises StudyError with a line `file:line:col: key.path: message (got value)` for each error.
    """
    return _load(Path(path), (overrides,) if isinstance(overrides, str) else tuple(overrides))[0]


def study_data(path: Path | str, overrides: Sequence[str] = ()) -> dict[str, Any]:
    """Return the keys of a study as its file and overrides have them, for a study that is made of another."""
    return dict(_read(Path(path), tuple(overrides))[0].data)


def load_with_logs(path: Path | str, overrides: Sequence[str] = ()) -> LoadedStudy:
    """Load a study and open its logs; StudyError also where they contradict the study, see `study.checks.logs`."""
    loaded, source = _load(Path(path), tuple(overrides))
    if loaded.study.experiment.recorded is not None:
        from elastid.study.checks.logs import check_logs  # brings the reader of logs

        if problems := list(check_logs(loaded.study, loaded.path.parent)):
            raise make_error(source, problems)
    return loaded


def _load(path: Path, overrides: tuple[str, ...]) -> tuple[LoadedStudy, YamlSource]:
    source, robot_errors = _read(path, overrides)
    study, problems = validate(source.data, Study)
    if problems or robot_errors:  # of a robot whose file cannot be read, the errors of that file alone count
        problems = [problem for problem in problems if not robot_errors or problem.path != ("robot",)]
        raise make_error(source, problems, robot_errors)
    study, unit_problems = convert_to_si(study)
    study = with_usual_tolerances(study) if not unit_problems else study
    problems = [*check_study(study, path.parent), *unit_problems]
    if problems:
        raise make_error(source, _with_origin(problems, source.text))
    return LoadedStudy(_exclude_all_amplitudes(study), path, source.text, overrides), source


def _with_origin(problems: Sequence[Problem], text: str) -> list[Problem]:
    """Return problems, the first missing log with its origin from the first comment of the study, `The record: ...`."""
    lines = takewhile(lambda line: line.startswith("#"), text.splitlines())
    comment = " ".join(line.removeprefix("#").strip() for line in lines)
    origin_match = re.search(r"The records?: (.*?)(?=\. [A-Z]|\.?$)", comment)
    first = next((i for i, problem in enumerate(problems) if problem.message.startswith(NO_LOG)), None)
    origin = f" (origin stated in the study: {origin_match[1]})" if origin_match else ""
    return [replace(p, message=p.message + origin * (i == first)) for i, p in enumerate(problems)]


def _exclude_all_amplitudes(study: Study) -> Study:
    """Return the study that leaves the postures of `validation.configurations` out at all of their amplitudes."""
    recorded, postures = study.experiment.recorded, study.validation.configurations
    if study.friction is not None or not postures:
        return study
    n_amplitudes = 1 if study.excitation is None else len(study.excitation.amplitudes)
    amplitudes = {name: list(range(1, n_amplitudes + 1)) for name in postures}
    if recorded is not None:
        amplitudes = {q: sorted({f.amplitude for f in recorded.files if f.configuration == q}) for q in postures}
    names = tuple(at_amplitude(name, amplitude) for name in postures for amplitude in amplitudes[name])
    return replace(study, validation=replace(study.validation, configurations=names))


def _read(path: Path, overrides: Sequence[str]) -> tuple[YamlSource, str]:
    """Return study, robot and overrides as one source; and the errors of the robot's file."""
    source, robot_errors = read_source(path, str(path)), ""
    if not isinstance(source.data, dict):
        text = "a study is a mapping with the keys name, robot, experiment ...; `elastid new DIR` writes one"
        raise StudyError("study/invalid", text, f"{path}:1:1")
    # `--set robot=other.yml` comes before that file is read, all other overrides reach into it.
    pairs = [_split(override) for override in overrides]
    for keys, value, option in pairs:
        if keys == ("robot",):
            source = _override(source, keys, value, option)
    robot = source.data.get("robot")
    folder = (path.parent / robot).parent if isinstance(robot, str) else path.parent
    try:
        source = _with_robot_file(source, path)
    except StudyError as error:
        source, robot_errors = _without_robot(source), str(error)
    for keys, value, option in pairs:
        if keys != ("robot",):
            source = _override(source, keys, value, option)
    source = replace(source, text=source.text + "".join(comment_lines(f"--set {override}") for override in overrides))
    try:
        source = with_robot(source, folder)
    except StudyError as error:
        return _without_robot(source), str(error)
    loads = source.data.get("loads")
    has_file = isinstance(loads, dict) and isinstance(loads.get("file"), str)
    return with_load_file(source, path.parent) if has_file else source, robot_errors


def _without_robot(source: YamlSource) -> YamlSource:
    return replace(source, data={key: value for key, value in source.data.items() if key != "robot"})


def _with_robot_file(source: YamlSource, path: Path) -> YamlSource:
    robot = source.data.get("robot")
    if not isinstance(robot, str):
        return source
    place = source.place(("robot",), of_value=True)
    file = existing_file("robot", path.parent / robot, place)
    try:
        robot_source = read_robot(file)
    except StudyError as error:
        raise StudyError("robot/file", f"robot: {file} is no robot:\n{error}", place) from None
    text = f"{source.text.rstrip()}\n\n{comment_lines(robot)}{robot_source.text}"
    return YamlSource({**source.data, **robot_source.data}, {**source.places, **robot_source.places}, text)


def _split(override: str) -> tuple[KeyPath, YamlSource, str]:
    option = f"--set {override}"
    dotted, equals, text = override.partition("=")
    if not equals or not dotted.strip():
        raise StudyError("options/invalid", "give --set as key.path=value, for example --set fit.starts=5", option)
    try:
        value = parse(text, "value", rank=2)
    except StudyError as error:
        raise StudyError("options/invalid", str(error), option) from None
    keys = tuple(key.strip() for key in dotted.replace("[", ".").replace("]", "").split("."))
    if len(keys) > 50:
        raise StudyError("options/invalid", "nested too deeply for a study", "--set")
    return keys, value, option


def _override(source: YamlSource, keys: KeyPath, value: YamlSource, option: str) -> YamlSource:
    place = Place(2, 0, 0, option)
    data, path = _put(source.data, keys, value.data, option)
    kept_places = {steps: places for steps, places in source.places.items() if steps[: len(path)] != path}
    new_places = {path[:i]: (place, place) for i in range(1, len(path) + 1) if path[:i] not in kept_places}
    below = {(*path, *keys_below): (place, place) for keys_below in value.places}
    return YamlSource(data, {**kept_places, **new_places, **below}, source.text)


def _put(data: Any, keys: KeyPath, value: Any, option: str) -> tuple[Any, KeyPath]:
    """Return data with `value` at `keys`, and the keys as in the data (list indices as numbers)."""
    if not keys:
        return value, ()
    step, further = keys[0], keys[1:]
    if isinstance(data, list):
        if not str(step).isdigit() or int(step) >= len(data):
            text = f"'{step}' must be a number from 0 to {len(data) - 1}, the index of a list"
            raise StudyError("options/invalid", text, option)
        index = int(step)
        entry, path = _put(data[index], further, value, option)
        return [*data[:index], entry, *data[index + 1 :]], (index, *path)
    mapping = data if isinstance(data, dict) else {}
    entry, path = _put(mapping.get(step), further, value, option)
    return {**mapping, step: entry}, (step, *path)
