"""The contract of a stage: a function of the keys of a study that it reads, which returns files to write.

    stage(study: Study, work: Work) -> Artefacts
    inputs = SHA-256(name, that study, contents of its files, inputs of the earlier results that it reads)

Its row in `elastid.app.stage_table` declares the keys, and `inputs` is the stamp of its result. All other keys are at
their defaults, so that a key that changes a result changes its stamp. Results do not depend on ways of working.
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
from elastid.app.stage_table import files_of, stages_of_study
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
    """Files of a stage and ways of working on it: processes, progress, parts that an interrupted run has finished.

    parts: folder of finished parts until the result is whole.  stamp: of the result, with the text of the study for a
    stage that shows it.  base: the folder of files that the study names.  sources: earlier results, by their stages.
    """

    stage: str
    parts: Path
    stamp: Stamp
    base: Path
    sources: Mapping[str, Path]
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

        key = hash_of([self.stamp.inputs, self.stamp.code, [file_hash(path) for path in self.sources.values()]])
        remove_leftovers(self.parts)
        finished = Checkpoint(self.parts, key)
        if finished:
            self.console.say(f"{self.stage}: resumed from {finished.words}")
        return finished


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


def stamps(loaded: LoadedStudy) -> dict[str, Stamp]:
    """Stamp by stage that a result must carry to be the one that the study asks for."""
    code, results, hash_of_file = code_hash(), dict[str, Stamp](), cache(file_hash)
    for name, stage in stages_of_study(loaded.study).items():
        study, text = stage.sees(loaded.study), loaded.text if "text" in stage.keys.split() else ""
        named = files_of(study, loaded.base).items()
        contents = [[path, [[file.name, hash_of_file(file)] for file in behind]] for path, behind in named]
        read = [[source, results[source].inputs] for source in stage.sources if source in results]
        inputs = hash_of([name, study, text, contents, read])
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
