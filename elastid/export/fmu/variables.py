"""The variables of a unit in the order of their value references, and where each group begins."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, TypeAlias

import numpy as np

from elastid.base.arrays import FloatArray
from elastid.export.intervals import HELD, known_numbers
from elastid.fit.fitted_robot import FittedRobot
from elastid.friction.law import CURVE
from elastid.linear.equilibrium import OperatingPoint
from elastid.simulation.friction_states import Contacts

Causality: TypeAlias = Literal["independent", "input", "output", "parameter"]
Variability: TypeAlias = Literal["continuous", "discrete", "tunable", "fixed"]


@dataclass(frozen=True)
class Variable:
    """A real variable: its value reference is its place in a list of all."""

    name: str
    causality: Causality
    variability: Variability
    text: str
    start: float


@dataclass(frozen=True)
class Layout:
    """All real variables, and by name the place where each group begins."""

    variables: tuple[Variable, ...]
    places: dict[str, int]


def layout(
    model: FittedRobot, contacts: Contacts, points: tuple[OperatingPoint, ...], rate_hz: float, step_s: float
) -> Layout:
    """The variables of a robot that starts at rest in the first of its configurations."""
    equations = model.model
    motors, joints = equations.inputs, [joint.name for joint in equations.robot.joints]
    at = equations.B.T @ points[0].q
    groups: dict[str, list[Variable]] = {
        "TIME": [Variable("time", "independent", "continuous", "Time, s", 0.0)],
        "TORQUE": _of(motors, "torque", "input", "continuous", "link-side torque beside the feedback", points[0].u),
        "POSITION": _of(motors, "reference", "input", "continuous", "angle that the controller aims at", at),
        "VELOCITY": _of(motors, "reference_speed", "input", "continuous", "speed that the controller aims at"),
        "ANGLE": _of(motors, "angle", "output", "continuous", "angle over its gear ratio"),
        "SPEED": _of(motors, "speed", "output", "continuous", "speed over its gear ratio"),
        "APPLIED": _of(motors, "applied", "output", "continuous", "torque with feedback, link side"),
        "HOLDING": _of(motors, "holding", "output", "continuous", "torque that holds the posture of the start"),
        "JOINT": _of([f"joint {name}" for name in joints], "angle", "output", "continuous", "angle"),
        "THETA": _numbers(model),
        "FRICTION": _friction(contacts),
        "KP": _of(motors, "kp", "parameter", "tunable", "feedback of its angle, N*m/rad of the link side"),
        "KD": _of(motors, "kd", "parameter", "tunable", "feedback of its speed, N*m*s/rad of the link side"),
        "KI": _of(motors, "ki", "parameter", "tunable", "integral of the feedback, 1/s"),
        "RATE": [Variable("controller_rate", "parameter", "fixed", "Rate of the controller, Hz", rate_hz)],
        "STEP": [Variable("largest_step", "parameter", "fixed", "Longest step of integration, s", step_s)],
    }
    places, first = {}, 0
    for name, members in groups.items():
        places[name] = first
        first += len(members)
    return Layout(tuple(variable for members in groups.values() for variable in members), places)


def _of(
    motors: list[str] | tuple[str, ...],
    name: str,
    causality: Causality,
    variability: Variability,
    text: str,
    start: FloatArray | None = None,
) -> list[Variable]:
    """A variable of each motor or joint."""
    values = np.zeros(len(motors)) if start is None else start
    return [
        Variable(f"{name} of {motor}", causality, variability, f"{motor[0].upper()}{motor[1:]}: {text}", float(value))
        for motor, value in zip(motors, values, strict=True)
    ]


def _numbers(model: FittedRobot) -> list[Variable]:
    """The parameters of the equations: stiffnesses, dampings, masses and so on, with what the fit knows of them."""
    units = {name: unit for name, (_, unit) in model.robot.parameters().items()}
    known = {number.name: number.words for number in known_numbers(model)}
    texts = {name: f"{name} of the robot, {units.get(name, 'SI')}; {known.get(name, HELD)}" for name in units}
    return [
        Variable(name, "parameter", "tunable", texts.get(name, name), float(value))
        for name, value in zip(model.model.parameters, model.model.theta, strict=True)
    ]


def _friction(contacts: Contacts) -> list[Variable]:
    """The numbers of every friction law, link side."""
    names = [f"{number} of friction at {law.place}" for law in contacts.laws for number in CURVE]
    return [
        Variable(name, "parameter", "tunable", f"{name}, link side, SI", float(value))
        for name, value in zip(names, contacts.curves, strict=True)
    ]
