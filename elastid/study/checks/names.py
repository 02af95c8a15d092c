"""Names that several sections refer to: configurations, places on the robot, inputs and outputs."""

from collections.abc import Callable, Iterable, Iterator, Sequence

from elastid.base.errors import ElastidError, did_you_mean
from elastid.robot import Robot
from elastid.study.messages import Problem
from elastid.study.sections import Study
from elastid.study.source import KeyPath


def refusal_of(check: Callable[..., object], *arguments: object) -> str:
    """Return the message of the error that a check raises; empty without one."""
    try:
        check(*arguments)
    except ElastidError as error:
        return str(error)
    return ""


def unknown(path: KeyPath, noun: str, name: str, valid: Iterable[str]) -> Problem:
    """Make the problem of a name without a counterpart."""
    return Problem(path, f"no {noun} is called '{name}'; {did_you_mean(name, valid)}")


def check_names(path: KeyPath, noun: str, names: Sequence[str], valid: Sequence[str]) -> Iterator[Problem]:
    """Yield problems of entries in a list of names that are not known."""
    for i, name in enumerate(names):
        if name not in valid:
            yield unknown((*path, i), noun, name, valid)


def check_units(path: KeyPath, values: object, robot: Robot) -> Iterator[Problem]:
    """Check that a number for all motors, or one for each, has the unit of its joint's motion."""
    entries = values if isinstance(values, tuple) else (values,) * robot.n_u
    for i, (value, joint) in enumerate(zip(entries, robot.driven, strict=False)):
        refusal = joint.refusal_of(value) if isinstance(value, float) else ""
        if refusal and isinstance(values, tuple):
            yield Problem((*path, i), refusal)
        elif refusal:
            yield Problem(path, f"{refusal}, or one number for each motor")
            return


def list_configurations(study: Study) -> list[str]:
    """Return names of configurations, given ones first, then those that a design may choose."""
    names = list(study.experiment.configurations)
    if study.design is None:
        return names
    # A design that fits as many as it can into a robot_time may use 99 names.
    return [*names, *study.design.candidates.given, *(f"c{i + 1}" for i in range(study.design.count or 99))]


def _locations(study: Study, role: str) -> list[str]:
    """Return locations of the channels of a role, in all files."""
    recorded, configurations = study.experiment.recorded, list_configurations(study)
    locations = [] if recorded is None else [at for name in configurations for at in recorded.places_of(name, role)]
    return list(dict.fromkeys(locations)) or [c.at for c in study.experiment.channels if c.role == role]


def list_inputs(study: Study) -> list[str]:
    """Return locations of the inputs."""
    return _locations(study, "u") or list(study.as_robot().motor_locations)


def list_outputs(study: Study) -> list[str]:
    """Return locations of the outputs; empty if only the frf.h5 of another run names them."""
    simulated, channels = study.experiment.simulated, study.experiment.channels
    if channels or study.experiment.kind == "responses":
        return _locations(study, "y")
    return list(simulated.outputs if simulated is not None and simulated.outputs else study.as_robot().motor_locations)
