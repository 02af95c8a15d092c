"""Runs of studies, and the summaries that they leave."""

import json
from pathlib import Path
from typing import Any

from elastid.app.console import Console
from elastid.app.run import Run
from elastid.study import load


def run_of(study: Path, folder: Path, *overrides: str, jobs: int = 1) -> Run:
    """A silent run."""
    return Run(load(study, overrides), folder, jobs, Console(-1))


def summary_of(run: Path, name: str = "summary.json") -> Any:
    """The content of a JSON file in a run folder."""
    return json.loads((run / name).read_text(encoding="utf-8"))
