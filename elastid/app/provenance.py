"""Hashes of everything that a stage's result depends on: study sections, input files, earlier results, the code."""

from __future__ import annotations

import hashlib
import json
import platform
from collections.abc import Iterable
from dataclasses import asdict
from functools import cache
from importlib.metadata import version
from importlib.resources import files
from pathlib import Path
from typing import Any

from elastid import __version__
from elastid.app.stage_table import Stage, function_of, stages_of_study
from elastid.base import kernels
from elastid.store import Stamp
from elastid.study import LoadedStudy

# Libraries that results depend on to the last digits.
LIBRARIES = ("numpy", "scipy", "casadi")


def stamps(loaded: LoadedStudy) -> dict[str, Stamp]:
    """For each stage the stamp that its result must carry to be the result that the study asks for."""
    study, code = loaded.study, code_hash()
    sections, inputs = asdict(study), dict[str, str]()
    stages = stages_of_study(study)
    for name, stage in stages.items():
        document: list[Any] = [name, [_read(sections, key) for key in stage.sections]]
        document += [inputs[before] for before in upstream(stages, stage) if stage.of_reads]
        if stage.further:
            document.append(function_of(stage.further)(loaded, inputs))
        # The order of keys counts: it is the order in which configurations are measured and patterns win.
        inputs[name] = hashlib.sha256(json.dumps(document).encode()).hexdigest()
    return {
        name: Stamp(hash_, code, __version__, study.seed, loaded.text, software()) for name, hash_ in inputs.items()
    }


@cache
def software() -> str:
    """Versions of elastid, Python and the libraries that results depend on, and the platform."""
    found = [f"elastid {__version__}", f"Python {platform.python_version()}"]
    found += [f"{name} {version(name)}" for name in LIBRARIES]
    return ", ".join([*found, kernels.description(), f"{platform.system()} {platform.machine()}"])


def upstream(stages: dict[str, Stage], stage: Stage) -> tuple[str, ...]:
    """The stages of a study whose results a stage reads."""
    return tuple(name for name in stage.reads if name in stages)


def file_hashes(base: Path, paths: Iterable[str]) -> list[Any]:
    """Path and hash of each file, relative to a folder, each file once."""
    return [[path, file_hash(base / path)] for path in dict.fromkeys(paths)]


def file_hash(path: Path) -> str:
    """SHA-256 of a file's content; of a folder (a ROS bag) of the names and contents of its files."""
    if path.is_dir():
        inside = [[file.name, file_hash(file)] for file in sorted(path.iterdir()) if file.is_file()]
        return hashlib.sha256(json.dumps(inside).encode()).hexdigest()
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def code_hash() -> str:
    """SHA-256 of the package's own source and of the versions of what it computes with: others, another result."""
    digest = hashlib.sha256("".join([__version__, *(version(name) for name in LIBRARIES)]).encode())
    root = Path(str(files("elastid")))
    for path in sorted(root.rglob("*")):
        name = path.relative_to(root).as_posix()
        if path.suffix in (".py", ".j2", ".js", ".css") and not name.startswith("app/templates/"):
            digest.update(name.encode())
            digest.update(path.read_bytes())
    return digest.hexdigest()


def _read(sections: dict[str, Any], name: str) -> Any:
    """A section, or one key of it."""
    section, _, key = name.partition(".")
    return sections[section][key] if key else sections[section]
