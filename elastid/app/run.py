"""Run: a study, the folder of its results, and which of them still are what the study asks for."""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path

from elastid import __version__
from elastid.app.console import Console
from elastid.app.provenance import file_hash, stages_of, stamps, upstream
from elastid.base.errors import StudyError
from elastid.store import Checkpoint, Stamp, read_stamp, remove_leftovers
from elastid.study import LoadedStudy, Study

ARTEFACTS = {
    "design": "plan.h5",
    "measure": "records.h5",
    "estimate": "frf.h5",
    "fit": "fit.h5",
    "validate": "validation.h5",
    "report": "report.html",
}
# The machine-readable end of a stage, beside its file.
SUMMARIES = {"fit": "summary.json", "validate": "validation.json"}


@dataclass(frozen=True)
class Run:
    """jobs: processes; the results do not hang on it."""

    loaded: LoadedStudy
    folder: Path
    jobs: int = 1
    console: Console = field(default_factory=Console)

    @property
    def study(self) -> Study:
        """What is asked for."""
        return self.loaded.study

    @cached_property
    def stamps(self) -> dict[str, Stamp]:
        """What the result of each stage must be stamped with."""
        return stamps(self.loaded)

    @property
    def stages(self) -> tuple[str, ...]:
        """The stages that this study has, in order."""
        return stages_of(self.study)

    def path(self, stage: str) -> Path:
        """The file in which a stage leaves its result."""
        return self.folder / ARTEFACTS[stage]

    def summary(self, stage: str) -> Path:
        """The file in which programs read how a fit or its validation ended."""
        return self.folder / SUMMARIES[stage]

    def partial(self, stage: str) -> Path:
        """The folder in which a stage keeps what it has finished, until its result is whole: the next goes on there."""
        return self.path(stage).with_suffix(".partial")

    def finished(self, stage: str) -> Checkpoint:
        """What a stage had finished when it was stopped: of this study, by this code, from the very files it reads."""
        stamp, files = self.stamps[stage], [file_hash(self.path(name)) for name in upstream(self.study, stage)]
        key = hashlib.sha256(json.dumps([stamp.inputs, stamp.code, files]).encode()).hexdigest()
        remove_leftovers(self.partial(stage))
        return Checkpoint(self.partial(stage), key)

    def is_current(self, stage: str) -> bool:
        """Whether the result of a stage is there, readable, and made from the same inputs by the same code."""
        wanted = self.stamps[stage]
        if stage == "report":
            return self._page_holds(wanted)
        found = read_stamp(self.path(stage))
        if found is None or (found.inputs, found.code) != (wanted.inputs, wanted.code):
            return False
        return stage not in SUMMARIES or self.summary(stage).is_file()

    def require(self, stage: str) -> None:
        """Refuse to go on without the results that a stage reads; StudyError says which command makes them."""
        for name in upstream(self.study, stage):
            path, found = self.path(name), read_stamp(self.path(name))
            command = f"run `elastid {name} {self.loaded.path}` first, with the same options"
            if not path.is_file():
                raise StudyError(f"{path} is missing: {command}")
            if found is None:
                raise StudyError(f"{path} cannot be read or is no result of elastid: {command}")
            if found.inputs != self.stamps[name].inputs:
                raise StudyError(f"{path} was made from another study, other data or other options: {command}")
            if found.code != self.stamps[name].code:
                self.console.warn(f"{path} was made by another version of elastid ({found.version}) and is used as is")

    @contextmanager
    def logged(self) -> Iterator[None]:
        """Everything said goes to run.log in the folder too, and how the work ended."""
        with self.console.logging_to(self.folder):
            remove_leftovers(self.folder)
            self.console.detail(f"elastid {__version__}, {self.loaded.path}, {self.jobs} processes")
            try:
                yield
            except KeyboardInterrupt:
                self.console.log("interrupted")
                raise
            except Exception as error:
                self.console.log(str(error) or repr(error))
                raise

    def _page_holds(self, wanted: Stamp) -> bool:
        path = self.path("report")
        if not path.is_file() or not (self.folder / "figures").is_dir():
            return False
        page = path.read_text(encoding="utf-8", errors="replace")
        return wanted.inputs in page and wanted.code in page


def all_cores() -> int:
    """How many processors this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
