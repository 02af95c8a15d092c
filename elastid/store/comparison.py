"""compare.json: the models of `elastid compare` in their order, and the trials of a search."""

from __future__ import annotations

import json
from pathlib import Path

from elastid.store.files import Stamp, text_file
from elastid.store.json_values import from_json, json_value, or_text
from elastid.validation.comparison import Comparison

SCHEMA = 1


def write_comparison(path: Path, comparison: Comparison, stamp: Stamp) -> None:
    """compare.json. stamp: of the frequency responses that the models were fitted to."""
    content = {
        "schema": SCHEMA,
        "responses": stamp.inputs,
        "code": stamp.code,
        "made by": stamp.software,
        "verdict": comparison.verdict,
        "configurations": comparison.configurations,
        "models": comparison.rows,
        "search": comparison.trials,
    }
    with text_file(path) as file:
        json.dump(json_value(content, or_text), file, indent=1, allow_nan=False)
        file.write("\n")


def read_comparison(path: Path, stamp: Stamp) -> Comparison | None:
    """The comparison in compare.json; None where there is none, or one of other frequency responses."""
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
        if (content["schema"], content["responses"]) != (SCHEMA, stamp.inputs):
            return None
        names = {"configurations": "configurations", "verdict": "verdict", "rows": "models", "trials": "search"}
        comparison: Comparison = from_json({name: content[key] for name, key in names.items()}, Comparison)
    except (OSError, ValueError, TypeError, KeyError, AttributeError):  # missing or damaged
        return None
    return comparison
