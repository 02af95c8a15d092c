"""The robot of a study that needs its mass matrix: every joint moves an inertia in every configuration."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from elastid.base.errors import StudyError
from elastid.fit.setup.parameter_choice import choose
from elastid.robot import Body, Robot, unit_axis
from elastid.study.messages import Problem
from elastid.study.sections import Study


def check_moved_inertias(study: Study) -> Iterator[Problem]:
    """The mass matrix is positive definite, also with the starts of the fit; else the body and the axis of a joint."""
    robot = study.as_robot()
    if not _may_be_singular(robot):
        return
    # Brings the equations' library, which other studies do without here.
    from elastid.model.moved_inertia import joint_without_inertia
    from elastid.model.parallel_linkage.closed_posture import assembled

    # A simulated robot moves with the numbers of its file, one that was recorded with those of the fit.
    starting = robot if study.experiment.simulated is not None else _at_start(study)
    for name, angles in study.experiment.configurations.items():
        try:
            q = assembled(robot, np.array(angles, dtype=float))
        except (StudyError, ValueError):
            return  # reported where configurations are checked, or by the stage that closes the loops
        still = joint_without_inertia(robot, q)
        if still is not None and joint_without_inertia(starting, q) is not None:
            yield _problem(robot, still, name)
            return


def _may_be_singular(robot: Robot) -> bool:
    """Whether a motion of some body by its own joints may move no inertia; M is positive definite where none does."""
    return not all(_resists(body) for body in robot.bodies if body.joints)


def _resists(body: Body) -> bool:
    """Whether a body at rest but for its own joints has kinetic energy, whatever the others do."""
    moments = np.linalg.eigvalsh(body.inertia_matrix)
    least = 1e-9 * moments[2]
    if len(body.joints) > 1:
        return bool(body.mass > 0 and moments[0] > least)
    joint = body.joints[0]
    e = unit_axis(joint.axis)
    return bool(body.mass > 0 if joint.slides else e @ body.inertia_matrix @ e > least)


def _at_start(study: Study) -> Robot:
    """The robot with the starts of the parameters that are identified."""
    robot = study.as_robot()
    try:
        parameters = choose(study.fit, robot, tuple(study.experiment.configurations))
        theta = parameters.expand(parameters.x)
        known = {name: value for name, value in zip(parameters.names, theta.tolist(), strict=True)
                 if name.startswith(("m_", "c_", "I_")) and name in robot.numbers}  # fmt: skip
        return robot.with_parameters(known)
    except (StudyError, ValueError):
        return robot  # reported where the parameters are checked


def _problem(robot: Robot, still: int, configuration: str) -> Problem:
    joint = robot.joints[still]
    place, body = next((i, each) for i, each in enumerate(robot.bodies) if joint in each.joints)
    lacks = "no mass" if joint.slides else "neither an inertia about that axis nor a mass off it"
    gives = "mass" if joint.slides else "inertia"
    axis = joint.axis if isinstance(joint.axis, str) else f"[{', '.join(f'{part:g}' for part in joint.axis)}]"
    message = (
        f"body {body.name} and the bodies behind it have {lacks} where joint {joint.name} (axis {axis}) moves them, in "
        f"configuration {configuration}: the mass matrix is singular; give the {gives} of body {body.name}"
    )
    return Problem(("robot", "bodies", place, gives), message)
