"""modelDescription.xml of both versions: variables by their value references, and the build of the sources."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, TypeAlias
from xml.etree import ElementTree as ET

import numpy as np

from elastid.base.arrays import FloatArray
from elastid.export.intervals import HELD, known_numbers
from elastid.fit.fitted_robot import FittedRobot
from elastid.friction.static import CURVE
from elastid.linear.equilibrium import OperatingPoint
from elastid.simulation.dynamics import Contacts

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
    position = equations.B.T @ points[0].q
    groups: dict[str, list[Variable]] = {
        "TIME": [Variable("time", "independent", "continuous", "Time, s", 0.0)],
        "TORQUE": _of(motors, "torque", "input", "continuous", "link-side torque added to the feedback", points[0].u),
        "POSITION": _of(motors, "reference", "input", "continuous", "angle that the controller aims at", position),
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


IDENTIFIER = "robot"
SOURCES = {2: ("fmi2.c", "robot.c", "equations.c"), 3: ("fmi3.c", "robot.c", "equations.c")}
_CONFIGURATION = "posture of the start, from 1: "


def description_2(name: str, guid: str, layout: Layout, configurations: tuple[str, ...], step_s: float) -> str:
    """Of FMI 2.0."""
    root = ET.Element(
        "fmiModelDescription", fmiVersion="2.0", modelName=name, guid=guid, generationTool="elastid",
        variableNamingConvention="flat", numberOfEventIndicators="0",
    )  # fmt: skip
    simulation = ET.SubElement(
        root, "CoSimulation", modelIdentifier=IDENTIFIER, canHandleVariableCommunicationStepSize="true",
        canGetAndSetFMUstate="true", canSerializeFMUstate="true",
    )  # fmt: skip
    files = ET.SubElement(simulation, "SourceFiles")
    for source in SOURCES[2]:
        ET.SubElement(files, "File", name=source)
    categories = ET.SubElement(root, "LogCategories")
    ET.SubElement(categories, "Category", name="logStatusError")
    _experiment(root, step_s)
    variables = ET.SubElement(root, "ModelVariables")
    for reference, variable in enumerate(layout.variables):
        scalar = ET.SubElement(variables, "ScalarVariable", _attributes(variable, reference))
        ET.SubElement(scalar, "Real", _start(variable))
    chosen = ET.SubElement(variables, "ScalarVariable", _configuration(len(layout.variables), configurations))
    ET.SubElement(chosen, "Integer", start="1", min="1", max=str(len(configurations)))
    structure = ET.SubElement(root, "ModelStructure")
    for part in ("Outputs", "InitialUnknowns"):
        section = ET.SubElement(structure, part)
        for index, variable in enumerate(layout.variables, start=1):
            if variable.causality == "output":
                ET.SubElement(section, "Unknown", index=str(index))
    return _text(root)


def description_3(name: str, token: str, layout: Layout, configurations: tuple[str, ...], step_s: float) -> str:
    """Of FMI 3.0."""
    root = ET.Element(
        "fmiModelDescription", fmiVersion="3.0", modelName=name, instantiationToken=token, generationTool="elastid",
        variableNamingConvention="flat",
    )  # fmt: skip
    ET.SubElement(
        root, "CoSimulation", modelIdentifier=IDENTIFIER, canHandleVariableCommunicationStepSize="true",
        canGetAndSetFMUState="true", canSerializeFMUState="true",
    )  # fmt: skip
    categories = ET.SubElement(root, "LogCategories")
    ET.SubElement(categories, "Category", name="logStatusError")
    _experiment(root, step_s)
    variables = ET.SubElement(root, "ModelVariables")
    for reference, variable in enumerate(layout.variables):
        ET.SubElement(variables, "Float64", _attributes(variable, reference) | _start(variable))
    limits = {"start": "1", "min": "1", "max": str(len(configurations))}
    ET.SubElement(variables, "Int32", _configuration(len(layout.variables), configurations) | limits)
    structure = ET.SubElement(root, "ModelStructure")
    for part in ("Output", "InitialUnknown"):
        for reference, variable in enumerate(layout.variables):
            if variable.causality == "output":
                ET.SubElement(structure, part, valueReference=str(reference))
    return _text(root)


def build_description() -> str:
    """sources/buildDescription.xml of FMI 3.0."""
    root = ET.Element("fmiBuildDescription", fmiVersion="3.0")
    build = ET.SubElement(root, "BuildConfiguration", modelIdentifier=IDENTIFIER)
    files = ET.SubElement(build, "SourceFileSet", language="C99")
    for source in SOURCES[3]:
        ET.SubElement(files, "SourceFile", name=source)
    return _text(root)


def _attributes(variable: Variable, reference: int) -> dict[str, str]:
    return {
        "name": variable.name,
        "valueReference": str(reference),
        "description": variable.text,
        "causality": variable.causality,
        "variability": variable.variability,
    }


def _configuration(reference: int, names: tuple[str, ...]) -> dict[str, str]:
    listed = ", ".join(f"{number} {name}" for number, name in enumerate(names, start=1))
    return {
        "name": "configuration",
        "valueReference": str(reference),
        "description": _CONFIGURATION + listed,
        "causality": "parameter",
        "variability": "fixed",
    }


def _start(variable: Variable) -> dict[str, str]:
    """Inputs and parameters have a start; outputs are computed."""
    return {"start": repr(variable.start)} if variable.causality in ("input", "parameter") else {}


def _experiment(root: ET.Element, step_s: float) -> None:
    ET.SubElement(root, "DefaultExperiment", startTime="0", stopTime="1", stepSize=repr(step_s))


def _text(root: ET.Element) -> str:
    ET.indent(root)
    return '<?xml version="1.0" encoding="UTF-8"?>\n' + ET.tostring(root, encoding="unicode") + "\n"
