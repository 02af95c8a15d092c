"""The contract of a stage: a function of declared values and ways of working, which returns files to write.

    stage(*, <declared values>, work: Work) -> Artefacts
    inputs = SHA-256(name, values of the study, contents of files, inputs of the earlier results that it reads)

Its row in `elastid.app.stage_table` declares the values, and `inputs` is the stamp of its result. A stage has no other
way to the study, so that a value that changes its result changes its stamp. Results do not depend on `work`.
"""

from __future__ import annotations

import hashlib
import json
import platform
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import asdict, dataclass, field
from functools import cache
from importlib.metadata import version
from importlib.resources import files
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeAlias

from elastid import __version__
from elastid.app.console import Console
from elastid.app.stage_table import Stage, stages_of_study
from elastid.base import kernels
from elastid.base.execution import Execution
from elastid.store.artefacts import Stamp
from elastid.store.files import content_hash, remove_leftovers, write_text
from elastid.study import LoadedStudy

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
            yield Execution(self.jobs, progress, {} if checkpoint is None else checkpoint)

    def checkpoint(self) -> Checkpoint:
        """Finished parts of the interrupted stage: of the same values, by the same code, from the very same files."""
        from elastid.store.checkpoint import Checkpoint  # brings the solvers, which most stages do not need

        key = hash_of([self.stamp.inputs, self.stamp.code, [file_hash(path) for path in self.sources]])
        remove_leftovers(self.parts)
        finished = Checkpoint(self.parts, key)
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
    return lambda path, stamp: write_text(path, content)


def file_hash(path: Path) -> str:
    """SHA-256 of a file's content; of a folder (a ROS bag) of the names and contents of its files."""
    if path.is_dir():
        return hash_of([[file.name, file_hash(file)] for file in sorted(path.iterdir()) if file.is_file()])
    return content_hash(path)


# Libraries that results depend on to the last digits.
LIBRARIES = ("numpy", "scipy", "casadi")


def handed_values(loaded: LoadedStudy, stage: Stage) -> dict[str, Any]:
    """Everything of a study that a stage is handed, by argument: values, and files where it declares some."""
    handed = {value.argument: value.of(loaded) for value in stage.values}
    if stage.files is not None:
        handed["files"] = StudyFiles(loaded.base, tuple(stage.files(handed, loaded.base)))
    return handed


def stamps(loaded: LoadedStudy) -> dict[str, Stamp]:
    """Stamp by stage that a result must carry to be the one that the study asks for."""
    code, results = code_hash(), dict[str, Stamp]()
    for name, stage in stages_of_study(loaded.study).items():
        handed = {value.argument: value.of(loaded) for value in stage.values}
        named = stage.files(handed, loaded.base) if stage.files is not None else {}
        contents = [[path, [[file.name, file_hash(file)] for file in behind]] for path, behind in named.items()]
        read = [[source.stage, results[source.stage].inputs] for source in stage.sources if source.stage in results]
        inputs = hash_of([name, list(handed.items()), contents, read])
        results[name] = Stamp(inputs, code, __version__, loaded.study.seed, loaded.text, software())
    return results


@cache
def software() -> str:
    """Versions of elastid, Python and the libraries that results depend on, and the platform."""
    names = [f"elastid {__version__}", f"Python {platform.python_version()}"]
    names += [f"{name} {version(name)}" for name in LIBRARIES]
    return ", ".join([*names, kernels.description(), f"{platform.system()} {platform.machine()}"])


def code_hash(root: Path | None = None) -> str:
    """SHA-256 of every file of the package and of the versions of the libraries that it computes with.

    root: folder of the package.  Only files that Python and editors leave in it do not count.
    """
    root = Path(str(files("elastid"))) if root is None else root
    digest = hashlib.sha256("".join([__version__, *(version(name) for name in LIBRARIES)]).encode())
    for path in sorted(root.rglob("*")):
        name = path.relative_to(root)
        if path.is_file() and not any(part == "__pycache__" or part.startswith(".") for part in name.parts):
            digest.update(f"{name.as_posix()}\0".encode())
            digest.update(hashlib.sha256(path.read_bytes()).digest())
    return digest.hexdigest()


def hash_of(document: Any) -> str:
    """SHA-256 of values as JSON. The order of keys counts: configurations are measured, and patterns win, in it."""
    return hashlib.sha256(json.dumps(document, default=asdict).encode()).hexdigest()
