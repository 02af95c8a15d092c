"""Target of `elastid export`: a row that a file of this package or an installed package declares."""

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from pathlib import Path

# Arguments that the function `write` of a target can have, and their meanings.
VALUES = {
    "model": "FittedRobot with the identified parameters, of one robot or group of configurations",
    "linear_model": "FittedRobot with the stiffness of each gear at zero torque",
    "geared": "Robot with the gear effects; None if the study has no section gears",
    "robot": "Robot with the identified friction and gear effects",
    "robot_file": "text of the robot model with the identified parameters",
    "known": "text rows with the 95 % interval of each parameter",
    "actuators": "Actuators: joint parameters with intervals", "draws": "DrawnRobots: posterior samples",
    "responses": "measured Response of each configuration",
    "modes": "Modes of each response of a study without a robot",
    "geometry": "GeometrySpec of a study without a robot, None if it is not stated",
    "friction_result": "FrictionResult of a friction study", "observers": "TrackedFriction of each joint, by its name",
    "name": "name of the study", "title": "name of the study, with the label of the group of configurations",
    "warn": "function that prints a warning",
}  # fmt: skip


@dataclass(frozen=True)
class Target:
    """Target of an export, for studies whose results have all of its arguments.

    tag: name on the command line; if several rows have it, the first row that is possible is used.  arguments: names
    from `VALUES`.  content: parts of the identified model in the files.  write(folder, **values): makes the folder,
    writes the files and returns their paths.  has_gear_effects: the files contain all effects of stage gears.
    """

    tag: str
    arguments: tuple[str, ...]
    content: str
    write: Callable[..., Iterable[Path]]
    has_gear_effects: bool = False
