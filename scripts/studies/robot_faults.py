"""Faults of a robot: it differs from its model in parameters, loads, gears, links or mounting.

Each function returns the exact responses of the plant's robot with one fault. `axis` is the index of a driven joint.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from study_plants import Plant, exact_responses

from elastid.linear.equilibrium import equilibrium
from elastid.model.formulation import formulate
from elastid.response import Response
from elastid.robot import Body, GearCoupling, Joint, Payload, Robot, Spring
from elastid.robot.simplified import with_joints


def scale(plant: Plant, factor: float, *names: str, added: float = 0.0) -> list[Response]:
    """Multiply parameters of the robot by a factor, and add a constant."""
    values = plant.robot.parameters(tuple(plant.robot.geometry))
    changed = {name: factor * values[name][0] + added for name in names}
    return exact_responses(plant, plant.robot.with_parameters(changed))


def shift(plant: Plant, step: float, name: str) -> list[Response]:
    """Add a constant to a parameter of the robot."""
    return scale(plant, 1.0, name, added=step)


def add_payload(plant: Plant, mass: float, at: Sequence[float], inertia: float | None = None) -> list[Response]:
    """Mount a load on the last body: mass, kg, position, m, inertia, kg m^2 (default: a cube of 0.15 m)."""
    inertia = mass * 0.15**2 / 6 if inertia is None else inertia
    load = Payload(mass, tuple(at), inertia, plant.robot.bodies[-1].name)
    return exact_responses(plant, replace(plant.robot, payload=load))


def increase_payload(plant: Plant, fraction: float, along: float) -> list[Response]:
    """Add a fraction of the last body's mass to the payload, at `along` * (1, 0.3, 0.5) m from the body's centre."""
    body, carried = plant.robot.bodies[-1], plant.robot.payload
    mass, at = fraction * body.mass, np.array(body.center_of_mass) + along * np.array([1.0, 0.3, 0.5])
    if carried is None:
        return add_payload(plant, mass, at, 0.01 * mass)
    total = carried.mass + mass
    center = (carried.mass * np.array(carried.center_of_mass) + mass * at) / total
    load = replace(carried, mass=total, center_of_mass=tuple(center))
    return exact_responses(plant, replace(plant.robot, payload=load))


def unload(plant: Plant) -> list[Response]:
    """Remove the payload."""
    return exact_responses(plant, replace(plant.robot, payload=None))


def wrong_ratio(plant: Plant, axis: int, factor: float) -> list[Response]:
    """Multiply a gear ratio; the model still converts angles and torques with the original ratio."""
    motor = plant.robot.driven[axis].motor
    robot = with_joint(plant.robot, axis, motor=replace(motor, ratio=factor * motor.ratio))  # type: ignore[type-var]
    scale = np.ones(len(robot.driven))
    scale[axis] = factor  # the model's ratio multiplies angles by the factor, and divides torques by it
    return [replace(G, G=G.G * np.outer(scale, scale)) for G in exact_responses(plant, robot)]


def with_joint(robot: Robot, axis: int, **changes: object) -> Robot:
    """Return the robot with replaced fields of a driven joint."""
    name = robot.driven[axis].name
    return with_joints(robot, lambda joint: replace(joint, **changes) if joint.name == name else joint)


def hardening(plant: Plant, axis: int, rise: float) -> list[Response]:
    """Increase the stiffness of a gear by the fraction `rise` at the largest static torque of the configurations."""
    spring, deflections = static_deflections(plant, axis)
    cubic = rise * spring.stiffness / (3 * max(deflections) ** 2)
    return exact_responses(plant, with_joint(plant.robot, axis, spring=replace(spring, cubic=cubic)))


def backlash(plant: Plant, axis: int, fraction: float) -> list[Response]:
    """Add backlash to a gear: a fraction of its smallest static deflection in the configurations."""
    spring, deflections = static_deflections(plant, axis)
    spring = replace(spring, backlash=fraction * min(deflections), rounding=0.5)
    return exact_responses(plant, with_joint(plant.robot, axis, spring=spring))


def static_deflections(plant: Plant, axis: int) -> tuple[Spring, list[float]]:
    """Return the spring of a gear, and its static deflections, rad, in the configurations."""
    model, spring = formulate(plant.robot, plant.model), plant.robot.driven[axis].spring
    torques = [equilibrium(model, model.theta, c).u[axis] for c in plant.configurations]
    return spring, [abs(torque) / spring.stiffness for torque in torques]  # type: ignore[return-value,union-attr]


def couple_motors(plant: Plant, ratio: float, *pairs: tuple[str, str]) -> list[Response]:
    """Couple motors with other axes, like the belts of a wrist; the model assumes uncoupled motors."""
    robot = replace(plant.robot, gears=tuple(GearCoupling(*pair, ratio) for pair in pairs))
    E = robot.mixing
    return [replace(G, G=E @ G.G @ E.T) for G in exact_responses(plant, robot)]


def soft_base(plant: Plant, axis: str, stiffness: float) -> list[Response]:
    """Add an elastic rotation about an axis ("x", "y", "z") between base and first body; stiffness in N m/rad."""
    return _with_elastic_joint(plant, plant.robot.bodies[0], "base", axis, stiffness, 0)


def soft_base_of_gear(plant: Plant, axis: str, ratio: float) -> list[Response]:
    """Add an elastic base with `ratio` times the stiffness of the first gear."""
    return soft_base(plant, axis, ratio * _stiffness(plant, 0))


def torsion(plant: Plant, name: str, stiffness: float) -> list[Response]:
    """Add an elastic rotation of a body about z; stiffness in N m/rad."""
    body = next(body for body in plant.robot.bodies if body.name == name)
    return _with_elastic_joint(plant, body, f"{name}_z", "z", stiffness, len(body.joints))


def torsion_of_gear(plant: Plant, axis: int, ratio: float) -> list[Response]:
    """Add an elastic rotation about z to the body of an axis, with `ratio` times the stiffness of its gear."""
    body = next(body for body in plant.robot.bodies if plant.robot.driven[axis] in body.joints)
    return torsion(plant, body.name, ratio * _stiffness(plant, axis))


def _stiffness(plant: Plant, axis: int) -> float:
    return plant.robot.parameters()[f"k_{plant.robot.driven[axis].name}"][0]


def _with_elastic_joint(plant: Plant, body: Body, name: str, axis: str, stiffness: float, place: int) -> list[Response]:
    joint = Joint(name, axis, Spring(stiffness, 1e-3 * stiffness))  # type: ignore[arg-type]
    elastic = replace(body, joints=(*body.joints[:place], joint, *body.joints[place:]))
    bodies = tuple(elastic if each is body else each for each in plant.robot.bodies)
    return exact_responses(plant, replace(plant.robot, bodies=bodies))


def set_gravity(plant: Plant, *gravity: float) -> list[Response]:
    """Replace gravity (m/s^2, base axes)."""
    return exact_responses(plant, replace(plant.robot, gravity=gravity))  # type: ignore[arg-type]
