"""JSON Schema of a study, for completion and hints in editors."""

from __future__ import annotations

from typing import Any

from pydantic import TypeAdapter

from elastid.robot.denavit_hartenberg import DenavitHartenberg
from elastid.robot.urdf import UrdfRobot
from elastid.study.sections import Study

# The name under which `elastid new` writes it beside a study, and to which the study's first line refers.
SCHEMA_NAME = "study.schema.json"


def schema() -> dict[str, Any]:
    """JSON Schema (draft 2020-12) of a study file: every key with its description, unit and default."""
    document = TypeAdapter(Study).json_schema()
    for form in (DenavitHartenberg, UrdfRobot):
        further = TypeAdapter(form).json_schema()
        document["$defs"] |= further.pop("$defs")
        document["$defs"][form.__name__] = further
    document["properties"]["robot"] = {
        "description": "The path of the robot's file, relative to the study, or the robot itself.",
        "anyOf": [
            {"type": "string"},
            *({"$ref": f"#/$defs/{form}"} for form in ("Robot", "DenavitHartenberg", "UrdfRobot")),
        ],
    }
    return {"$schema": "https://json-schema.org/draft/2020-12/schema", **_for_editors(document)}


def _for_editors(node: Any) -> Any:
    """A name such as 1 needs no quotes: a number may stand for a free text. Defaults JSON cannot tell are left out."""
    if isinstance(node, list):
        return [_for_editors(item) for item in node]
    if not isinstance(node, dict):
        return node
    plain = {key: _for_editors(value) for key, value in node.items()}
    if plain.get("type") == "string" and not {"enum", "const", "pattern"} & plain.keys():
        plain["type"] = ["string", "number"]
    if any(word in str(plain.get("default", "")) for word in ("None", "inf")):  # no limit, or no value
        del plain["default"]
    return plain
