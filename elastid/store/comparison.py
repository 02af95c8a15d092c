"""compare.json: the models of `elastid compare` in their order, and the trials of a search."""

from __future__ import annotations

import json
import math
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from elastid.store.files import Stamp, text_file
from elastid.validation.comparison import ComparedModel, Comparison, Trial

SCHEMA = 1


def write_comparison(path: Path, comparison: Comparison, stamp: Stamp) -> None:
    """compare.json. stamp: of the frequency responses that the models were fitted to."""
    content = {
        "schema": SCHEMA,
        "responses": stamp.inputs,
        "code": stamp.code,
        "made by": stamp.software,
        "verdict": comparison.verdict,
        "configurations": list(comparison.configurations),
        "models": [asdict(row) | {"misfit": row.misfit.tolist()} for row in comparison.rows],
        "search": [asdict(trial) for trial in comparison.trials],
    }
    with text_file(path) as file:
        json.dump(_plain(content), file, indent=1, allow_nan=False)
        file.write("\n")


def read_comparison(path: Path, stamp: Stamp) -> Comparison | None:
    """The comparison in compare.json; None where there is none, or one of other frequency responses."""
    content = _read(path)
    if content is None or content.get("schema") != SCHEMA or content.get("responses") != stamp.inputs:
        return None
    rows = [_numbers(row, ("cost", "criterion", "rms_log_db", "phase_rms_deg")) for row in content["models"]]
    return Comparison(
        tuple(content["configurations"]),
        tuple(ComparedModel(**row | {"misfit": np.array([_number(m) for m in row["misfit"]])}) for row in rows),
        content["verdict"],
        tuple(_trial(trial) for trial in content.get("search", [])),
    )


def _trial(row: dict[str, Any]) -> Trial:
    names = {key: tuple(row[key]) for key in ("coordinates", "elastic")}
    return Trial(**_numbers(row, ("before", "after", "change", "standard_error", "criterion")) | names)


def _read(path: Path) -> dict[str, Any] | None:
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return None
    return content if isinstance(content, dict) else None


def _plain(value: Any) -> Any:
    """JSON has neither infinity nor NaN: they become 'inf' and null."""
    if isinstance(value, dict):
        return {key: _plain(each) for key, each in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(each) for each in value]
    if isinstance(value, float) and not math.isfinite(value):
        return None if math.isnan(value) else "inf"
    return value


def _numbers(row: dict[str, Any], keys: tuple[str, ...]) -> dict[str, Any]:
    return row | {key: _number(row[key]) for key in keys}


def _number(value: Any) -> float:
    return math.nan if value is None else float(value)
