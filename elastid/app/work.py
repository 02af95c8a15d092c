"""The contract of a stage: a function of declared values and ways of working, which returns files to write.

    stage(*, <declared values>, work: Work) -> Artefacts

Its row in `elastid.app.stage_table` declares the values; `elastid.app.provenance` gathers them, and the hash of the
same values is the stamp of the result. Results do not depend on `work`.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeAlias

from elastid.app.console import Console
from elastid.base.execution import Execution
from elastid.store.artefacts import Stamp
from elastid.store.files import content_hash, remove_leftovers, text_file

if TYPE_CHECKING:
    from elastid.store.checkpoint import Checkpoint

# Writes a file at a path, with its stamp where it carries one.
Write: TypeAlias = Callable[[Path, Stamp], Any]


@dataclass(frozen=True)
class Artefacts:
    """Files of a finished stage, and a report to its user.

    files: file or folder of the run folder -> write(path, stamp), in the order of writing.  report(console): called
    once all are written.  error: raised after that, of a stage that leaves files although it failed.
    """

    files: Mapping[str, Write]
    report: Callable[[Console], None] = field(default=lambda console: None)
    error: BaseException | None = None


@dataclass(frozen=True)
class Work:
    """Ways of working on a stage: processes, progress, and the parts that an interrupted run has finished.

    parts: folder of finished parts until the result is whole.  stamp: of the result, without the text of the study.
    sources: files of the earlier results that the stage reads.
    """

    stage: str
    parts: Path
    stamp: Stamp
    sources: tuple[Path, ...] = ()
    jobs: int = 1
    console: Console = field(default_factory=Console)

    @contextmanager
    def execution(self, checkpoint: Checkpoint | None = None) -> Iterator[Execution]:
        """Execution of the stage's work, its progress shown."""
        with self.console.progress(self.stage) as progress:
            yield Execution(self.jobs, progress) if checkpoint is None else Execution(self.jobs, progress, checkpoint)

    def checkpoint(self) -> Checkpoint:
        """Finished parts of the interrupted stage: of the same values, by the same code, from the very same files."""
        from elastid.store.checkpoint import Checkpoint  # brings the solvers, which most stages do not need

        document = [self.stamp.inputs, self.stamp.code, [file_hash(path) for path in self.sources]]
        remove_leftovers(self.parts)
        finished = Checkpoint(self.parts, hashlib.sha256(json.dumps(document).encode()).hexdigest())
        if finished:
            self.console.say(f"{self.stage}: resumed from {finished.words}")
        return finished


@dataclass(frozen=True)
class StudyFiles:
    """The folder of a study, in which a stage reaches only the files that its row declares.

    files / name: the path of a file as the study names it; LookupError for any other.
    """

    folder: Path
    names: tuple[str, ...]

    def __truediv__(self, name: str) -> Path:
        if name not in self.names:
            raise LookupError(f"the stage does not declare that it reads {name}; its row must name it under files")
        return self.folder / name


def text(content: str) -> Write:
    """Writes a text that carries no stamp."""

    def write(path: Path, stamp: Stamp) -> None:
        with text_file(path) as file:
            file.write(content)

    return write


def file_hash(path: Path) -> str:
    """SHA-256 of a file's content; of a folder (a ROS bag) of the names and contents of its files."""
    if path.is_dir():
        contents = [[file.name, file_hash(file)] for file in sorted(path.iterdir()) if file.is_file()]
        return hashlib.sha256(json.dumps(contents).encode()).hexdigest()
    return content_hash(path)
