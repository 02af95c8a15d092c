"""Target: a row of `elastid export`, as each file of this room declares it and a package of a user may."""

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from pathlib import Path

# Values that `write` of a target may take by name, and the meaning of each.
VALUES = {
    "model": "FittedRobot with the identified parameters, of one robot or group of configurations",
    "linear_model": "FittedRobot with the stiffness of each gear at zero torque",
    "geared": "Robot with the gear effects; None if the study has no section gears",
    "robot": "Robot with the identified friction and gear effects",
    "robot_file": "text of the robot model with the identified parameters",
    "known": "text rows with the 95 % interval of each parameter",
    "actuators": "Actuators: joint parameters with intervals",
    "draws": "DrawnRobots: posterior samples",
    "responses": "measured Response of each configuration",
    "modes": "Modes of each response of a study without a robot",
    "geometry": "GeometrySpec of a study without a robot, None if it is not stated",
    "friction_result": "FrictionResult of a friction study",
    "observers": "TrackedFriction of each joint, by its name",
    "name": "name of the study",
    "title": "name of the study, with the label of the group of configurations",
    "warn": "function that prints a warning",
}


@dataclass(frozen=True)
class Target:
    """Target of an export from a study whose results have all of its arguments.

    tag: name on the command line; several rows may share it, and the first whose values a study has is written.
    arguments: names from `VALUES`.  content: parts of the identified model in the files.  write(folder, **values) ->
    the files, in a folder that it makes.  has_gear_effects: the files contain all effects of stage gears.
    """

    tag: str
    arguments: tuple[str, ...]
    content: str
    write: Callable[..., Iterable[Path]]
    has_gear_effects: bool = False
