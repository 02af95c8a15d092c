"""Values that stages are handed, and the stamps of their results: hashes of these values and of the packaged code.

    inputs = SHA-256(name, values of the study, contents of files, inputs of the earlier results that it reads)

A stage has no other way to the study, so that a value that changes its result changes its stamp.
"""

from __future__ import annotations

import hashlib
import json
import platform
from collections.abc import Iterable
from dataclasses import asdict, replace
from functools import cache
from importlib.metadata import version
from importlib.resources import files
from pathlib import Path
from typing import Any

from elastid import __version__
from elastid.app.stage_table import Stage, Value, stages_of_study
from elastid.app.work import StudyFiles, file_hash
from elastid.base import kernels
from elastid.store.artefacts import Stamp
from elastid.store.files import changed_texts
from elastid.study import LoadedStudy

# Libraries that results depend on to the last digits.
LIBRARIES = ("numpy", "scipy", "casadi")


def values_of(loaded: LoadedStudy, declared: Iterable[Value]) -> dict[str, Any]:
    """Values of a study by argument."""
    return {value.argument: value.of(loaded) for value in declared}


def handed_values(loaded: LoadedStudy, stage: Stage) -> dict[str, Any]:
    """Everything of a study that a stage is handed, by argument: values, and files where it declares some."""
    handed = values_of(loaded, stage.values)
    if stage.files is not None:
        handed["files"] = StudyFiles(loaded.base, tuple(stage.files(handed, loaded.base)))
    return handed


def stamps(loaded: LoadedStudy) -> dict[str, Stamp]:
    """For each stage the stamp that its result must carry to be the result that the study asks for."""
    code, stages, results = code_hash(), stages_of_study(loaded.study), dict[str, Stamp]()
    for name, stage in stages.items():
        handed = values_of(loaded, stage.values)
        named = stage.files(handed, loaded.base) if stage.files is not None else {}
        document = [
            name,
            list(handed.items()),
            [[path, [[file.name, file_hash(file)] for file in behind]] for path, behind in named.items()],
            [
                [source.stage, results[source.stage].part if source.part else results[source.stage].inputs]
                for source in stage.sources
                if source.stage in stages
            ],
        ]
        inputs = _digest(document)
        part = stage.part(loaded.study) if stage.part is not None else None
        results[name] = Stamp(
            inputs,
            code,
            __version__,
            loaded.study.seed,
            loaded.text,
            software(),
            inputs if part is None else _digest([name, list(values_of(loaded, part).items())]),
        )
    return results


def with_extras(stamp: Stamp, stage: Stage, folder: Path) -> Stamp:
    """The stamp of a result to which files that other commands have left in the run folder contribute."""
    hashes = [[name, file_hash(path)] for name in stage.extras if (path := extra_file(folder, name)) is not None]
    return replace(stamp, inputs=_digest([stamp.inputs, hashes])) if hashes else stamp


def extra_file(folder: Path, name: str) -> Path | None:
    """A file of the run folder that another command has left; None where it is missing or has changed since."""
    return folder / name if (folder / name).is_file() and not changed_texts(folder, [name]) else None


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


def _digest(document: Any) -> str:
    """SHA-256 of values as JSON. The order of keys counts: configurations are measured, and patterns win, in it."""
    return hashlib.sha256(json.dumps(document, default=asdict).encode()).hexdigest()
