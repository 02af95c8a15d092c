"""Studies to start from: the templates that `elastid new` and `elastid demo` write."""

from __future__ import annotations

import json
from importlib.resources import files
from pathlib import Path

from elastid.app.example_logs import EXAMPLE_LOGS
from elastid.base.errors import StudyError
from elastid.base.files import unlinked
from elastid.study import SCHEMA_NAME, make_schema

DEMO = "serial"
STUDY = "study.yml"


def new(folder: Path, template: str) -> Path:
    """A new folder with a study, its robot, a small log where it is of logs, and the schema; returns the study's path.

    Raises StudyError where the folder holds anything already.
    """
    if folder.exists() and (not folder.is_dir() or any(folder.iterdir())):
        raise StudyError(f"{folder} exists and is not empty; nothing was written. Give the name of a new folder")
    _write_template(folder, template)
    if template in EXAMPLE_LOGS:
        EXAMPLE_LOGS[template](folder)
    return folder / STUDY


def demo(folder: Path) -> Path:
    """The demo's study in its run folder, to copy and edit; existing files are kept."""
    _write_template(folder, DEMO)
    return folder / STUDY


def _write_template(folder: Path, template: str) -> None:
    folder.mkdir(parents=True, exist_ok=True)
    for source in (files("elastid.app") / "templates" / template).iterdir():
        _write(folder / source.name, source.read_text(encoding="utf-8"))
    _write(folder / SCHEMA_NAME, json.dumps(make_schema(), indent=1) + "\n")


def _write(path: Path, text: str) -> None:
    if not path.exists():
        # Not through a link to a file that is yet to be made.
        with open(path, "x", encoding="utf-8", newline="\n", opener=unlinked) as file:
            file.write(text)
