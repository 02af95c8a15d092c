"""Description of a functional mock-up unit in XML, FMI 2.0 and 3.0: its real variables and its sources."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, TypeAlias
from xml.etree import ElementTree as ET

from elastid.base.escape import xml_text

Causality: TypeAlias = Literal["independent", "input", "output", "parameter"]
Variability: TypeAlias = Literal["continuous", "discrete", "tunable", "fixed"]


@dataclass(frozen=True)
class Variable:
    """Real variable; its value reference is its index in the list of all variables."""

    name: str
    causality: Causality
    variability: Variability
    text: str
    start: float


@dataclass(frozen=True)
class Layout:
    """All real variables, and the index of the first variable of each group by its name."""

    variables: tuple[Variable, ...]
    starts: dict[str, int]

    @property
    def outputs(self) -> list[int]:
        """References of the outputs."""
        return [i for i, variable in enumerate(self.variables) if variable.causality == "output"]


IDENTIFIER = "robot"


def description(
    version: int, sources: Sequence[str], name: str, token: str, layout: Layout, configurations: tuple[str, ...],
    step_s: float,
) -> str:  # fmt: skip
    """Return modelDescription.xml of FMI 2.0 or 3.0."""
    is_2, state = version == 2, "FMUstate" if version == 2 else "FMUState"
    head = {
        "fmiVersion": f"{version}.0", "modelName": name, "guid" if is_2 else "instantiationToken": token,
        "generationTool": "elastid", "variableNamingConvention": "flat",
    }  # fmt: skip
    root = ET.Element("fmiModelDescription", head | ({"numberOfEventIndicators": "0"} if is_2 else {}))
    can = ("canHandleVariableCommunicationStepSize", f"canGetAndSet{state}", f"canSerialize{state}")
    simulation = ET.SubElement(root, "CoSimulation", {"modelIdentifier": IDENTIFIER} | dict.fromkeys(can, "true"))
    if is_2:
        files = ET.SubElement(simulation, "SourceFiles")
        for source in sources:
            ET.SubElement(files, "File", name=source)
    ET.SubElement(ET.SubElement(root, "LogCategories"), "Category", name="logStatusError")
    ET.SubElement(root, "DefaultExperiment", startTime="0", stopTime="1", stepSize=repr(step_s))
    variables = ET.SubElement(root, "ModelVariables")
    (_describe_2 if is_2 else _describe_3)(variables, ET.SubElement(root, "ModelStructure"), layout, configurations)
    return _text(root)


def _describe_2(variables: ET.Element, structure: ET.Element, layout: Layout, names: tuple[str, ...]) -> None:
    """Add variables, each with its type in an element below it, and unknowns by their indices from 1."""
    for reference, variable in enumerate(layout.variables):
        scalar = ET.SubElement(variables, "ScalarVariable", _attributes(variable, reference))
        ET.SubElement(scalar, "Real", _start_attribute(variable))
    posture = ET.SubElement(variables, "ScalarVariable", _configuration(len(layout.variables), names))
    ET.SubElement(posture, "Integer", start="1", min="1", max=str(len(names)))
    for name in ("Outputs", "InitialUnknowns"):
        section = ET.SubElement(structure, name)
        for reference in layout.outputs:
            ET.SubElement(section, "Unknown", index=str(reference + 1))


def _describe_3(variables: ET.Element, structure: ET.Element, layout: Layout, names: tuple[str, ...]) -> None:
    """Add variables as elements of their types, and unknowns by their value references."""
    for reference, variable in enumerate(layout.variables):
        ET.SubElement(variables, "Float64", _attributes(variable, reference) | _start_attribute(variable))
    limits = {"start": "1", "min": "1", "max": str(len(names))}
    ET.SubElement(variables, "Int32", _configuration(len(layout.variables), names) | limits)
    for section in ("Output", "InitialUnknown"):
        for reference in layout.outputs:
            ET.SubElement(structure, section, valueReference=str(reference))


def build_description(sources: Sequence[str]) -> str:
    """Return sources/buildDescription.xml of FMI 3.0."""
    root = ET.Element("fmiBuildDescription", fmiVersion="3.0")
    build = ET.SubElement(root, "BuildConfiguration", modelIdentifier=IDENTIFIER)
    files = ET.SubElement(build, "SourceFileSet", language="C99")
    for source in sources:
        ET.SubElement(files, "SourceFile", name=source)
    return _text(root)


def _attributes(variable: Variable, reference: int) -> dict[str, str]:
    attributes = {"name": variable.name, "valueReference": str(reference), "description": variable.text}
    return attributes | {"causality": variable.causality, "variability": variable.variability}


def _configuration(reference: int, names: tuple[str, ...]) -> dict[str, str]:
    choices = ", ".join(f"{number} {name}" for number, name in enumerate(names, start=1))
    text = f"posture of the start, from 1: {choices}"
    return _attributes(Variable("configuration", "parameter", "fixed", text, 1.0), reference)


def _start_attribute(variable: Variable) -> dict[str, str]:
    """Return the start value of an input or parameter; empty for outputs, which are computed."""
    return {"start": repr(variable.start)} if variable.causality in ("input", "parameter") else {}


def _text(root: ET.Element) -> str:
    return '<?xml version="1.0" encoding="UTF-8"?>\n' + xml_text(root) + "\n"
