"""JSON Schema of a study, for completion and hints in editors."""

from __future__ import annotations

from typing import Any

from pydantic import TypeAdapter

from elastid.study.reference import HEADINGS, ROBOT_FORMS, advice_of, list_sections, texts_of
from elastid.study.sections import Study

# The name under which `elastid new` writes it beside a study, and to which the study's first line refers.
SCHEMA_NAME = "study.schema.json"


def make_schema() -> dict[str, Any]:
    """JSON Schema (draft 2020-12) of a study file: every key with its text, unit and default."""
    document = TypeAdapter(Study).json_schema()
    definitions = document.pop("$defs")
    for form in ROBOT_FORMS:
        definition = TypeAdapter(form).json_schema()
        definitions |= definition.pop("$defs")
        definitions[form.__name__] = definition
    for name, section in list_sections().items():
        _add_texts(document if section is Study else definitions[name], section)
    document["properties"]["robot"] = {
        "description": document["properties"]["robot"]["description"],
        "anyOf": [{"type": "string"}, *({"$ref": f"#/$defs/{form.__name__}"} for form in ROBOT_FORMS)],
    }
    document["$defs"] = definitions
    return {"$schema": "https://json-schema.org/draft/2020-12/schema", **_for_editors(document)}


def _add_texts(definition: dict[str, Any], section: type) -> None:
    """The texts of a section and of its keys as descriptions: text, units that a type names already, advice."""
    definition["description"], texts = texts_of(section)
    advice, needed = advice_of(section), definition.get("required", ())
    for key, text in texts.items():
        entry = definition["properties"][key]
        parts = [_sentence(text), _sentence(entry.get("description", ""))]
        parts += [f"{HEADINGS[key in needed]}: {advice[key]}"] if key in advice else []
        entry["description"] = " ".join(filter(None, parts))


def _sentence(text: str) -> str:
    """A text that ends like a sentence."""
    return text if not text or text[-1] in ".?!" else f"{text}."


def _for_editors(node: Any) -> Any:
    """A name such as 1 needs no quotes: a number may stand for a free text. Defaults that JSON lacks are left out."""
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
