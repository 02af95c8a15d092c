"""modelDescription.xml of both versions, and what tells a tool how to build the sources."""

from __future__ import annotations

from xml.etree import ElementTree as ET

from elastid.export.fmu.variables import Layout, Variable

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
