"""Run of a study: the folder of its results, the stages whose results are current, and the execution of stages.

    stage(study: Study, work: Work) -> Artefacts
    inputs = SHA-256(name, that study, contents of its files, inputs of the earlier results that it reads)

The row of a stage in `elastid.app.stage_table` declares the keys of the study that it reads. All other keys have their
defaults in the study that the stage receives, so that every key that can change a result changes its stamp `inputs`.
Results do not depend on options such as the number of processes.
"""

import hashlib
import json
import os
import platform
import shlex
import shutil
import sys
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, contextmanager
from dataclasses import asdict, dataclass, field, replace
from datetime import UTC, datetime
from functools import cache, cached_property
from importlib.metadata import version
from importlib.resources import files
from pathlib import Path
from pkgutil import resolve_name
from typing import Any, TypeAlias

from elastid import __version__
from elastid.app.console import Console
from elastid.app.stage_table import Stage, files_of, stages_of, stages_of_study
from elastid.base import kernels
from elastid.base.errors import Note, StudyError
from elastid.base.execution import Execution, persistent_workers
from elastid.base.files import path_below
from elastid.base.workers import load_for_workers
from elastid.fit.status_terms import CODES_WITH_CAUSE
from elastid.store.artefacts import Stamp, read_stamp
from elastid.store.checkpoint import Checkpoint
from elastid.store.files import (
    changed_texts,
    content_hash,
    has_checksum,
    is_intact,
    remove_leftovers,
    remove_texts,
    save_checksums,
    write_text,
)
from elastid.store.lock import lock_folder
from elastid.study import LoadedStudy, Study, load_with_logs

Write: TypeAlias = Callable[[Path, Stamp], Any]  # writes a file, with its stamp if the format has one


@dataclass(frozen=True)
class Artefacts:
    """Files of a finished stage, and a report to its user.

    files: file or folder in the run folder -> write(path, stamp), in the order of writing.  report(console): called
    after writing.  error: raised after the report, if the stage failed.
    """

    files: Mapping[str, Write]
    report: Callable[[Console], None] = field(default=lambda console: None)
    error: BaseException | None = None


@dataclass(frozen=True)
class Work:
    """Files of a stage, and options of its execution.

    parts: folder of finished parts of an interrupted run.  stamp: of the result, with the text of the study if the
    stage reads it.  base: folder to which file names in the study are relative.  sources: earlier results by stage.
    has_gears: True if the study has the stage gears, to which notes of the linear fit and its responses refer.
    """

    stage: str
    parts: Path
    stamp: Stamp
    base: Path
    sources: Mapping[str, Path]
    jobs: int = 1
    console: Console = field(default_factory=Console)
    has_gears: bool = False

    def unanswered(self, notes: Iterable[Note]) -> tuple[Note, ...]:
        """Return the notes on a fit and its responses, except notes that the stage gears resolves or repeats."""
        return tuple(note for note in notes if not (self.has_gears and note.code in CODES_WITH_CAUSE))

    @contextmanager
    def execution(self, checkpoint: Checkpoint | None = None) -> Iterator[Execution]:
        """Yield the execution settings of the stage, with progress on the console."""
        with self.console.progress(self.stage) as progress:
            yield Execution(self.jobs, progress, {} if checkpoint is None else checkpoint)

    def checkpoint(self) -> Checkpoint:
        """Return finished parts of the interrupted stage, if values, code and input files are unchanged."""
        key = hash_of([self.stamp.inputs, self.stamp.code, [file_hash(path) for path in self.sources.values()]])
        remove_leftovers(self.parts)
        finished_parts = Checkpoint(self.parts, key)
        if n := len(finished_parts):
            self.console.say(f"{self.stage}: resumed from {n} parts")
        return finished_parts


def text(content: str) -> Write:
    """Return the writer of a text without a stamp."""
    return lambda path, stamp: write_text(path, content)


def file_hash(path: Path) -> str:
    """Return the SHA-256 of a file, or of the names and contents of a folder (a ROS bag)."""
    if path.is_dir():
        return hash_of([[file.name, file_hash(file)] for file in sorted(path.iterdir()) if file.is_file()])
    return content_hash(path)


LIBRARIES = ("numpy", "scipy", "casadi")  # results depend on their versions, to the last digit


def stamps(loaded: LoadedStudy) -> dict[str, Stamp]:
    """Return, by stage, the stamp of a current result of this study."""
    code, results, hash_of_file = code_hash(), dict[str, Stamp](), cache(file_hash)
    for name, stage in stages_of_study(loaded.study).items():
        study, text = stage.select_keys(loaded.study), loaded.text if "text" in stage.keys.split() else ""
        contents = [[path, hash_of_file(loaded.path.parent / path)] for path in files_of(study)]
        earlier = [[source, results[source].inputs] for source in stage.sources if source in results]
        inputs = hash_of([name, study, text, contents, earlier])
        results[name] = Stamp(inputs, code, __version__, loaded.study.seed, loaded.text, software())
    return results


@cache
def software() -> str:
    """Return the versions of elastid, Python and `LIBRARIES`, the kernels and the platform as text."""
    names = [f"elastid {__version__}", f"Python {platform.python_version()}"]
    names += [f"{name} {version(name)}" for name in LIBRARIES]
    return ", ".join([*names, kernels.description(), f"{platform.system()} {platform.machine()}"])


def code_hash(root: Path | None = None) -> str:
    """Return the SHA-256 of the files of the package (root) and of the versions of `LIBRARIES`."""
    root = Path(str(files("elastid"))) if root is None else root
    digest = hashlib.sha256("".join([__version__, *(version(name) for name in LIBRARIES)]).encode())
    for path in sorted(root.rglob("*")):
        name = path.relative_to(root)
        if path.is_file() and not any(part == "__pycache__" or part.startswith(".") for part in name.parts):
            digest.update(f"{name.as_posix()}\0".encode())
            digest.update(hashlib.sha256(path.read_bytes()).digest())
    return digest.hexdigest()


def hash_of(document: Any) -> str:
    """Return the SHA-256 of values as JSON, including the order of keys, on which configurations depend."""
    return hashlib.sha256(json.dumps(document, default=asdict).encode()).hexdigest()


@dataclass(frozen=True)
class Run:
    """Run of a study: result folder and options.  jobs: number of processes, without effect on results."""

    loaded: LoadedStudy
    folder: Path
    jobs: int = 1
    console: Console = field(default_factory=Console)

    @property
    def study(self) -> Study:
        """Study of the run."""
        return self.loaded.study

    @cached_property
    def stamps(self) -> dict[str, Stamp]:
        """Stamp of a current result, by stage."""
        return stamps(self.loaded)

    @cached_property
    def stages(self) -> dict[str, Stage]:
        """Stages of this study, in order."""
        return stages_of_study(self.study)

    def path(self, stage: str) -> Path:
        """Return the file of a stage's result."""
        return self.folder / self.stages[stage].leaves[0]

    def open_folder(self) -> AbstractContextManager[None]:
        """Lock the result folder, and write run.log."""
        return open_run_folder(self.folder, self.jobs, self.console)

    def say_files(self, names: Iterable[str]) -> None:
        """Print the files and folders that exist."""
        files = [self.folder / name for name in names]
        self.console.say(", ".join(str(path) for path in files if path.is_file() or any(path.glob("*"))))

    def partial(self, stage: str) -> Path:
        """Return the folder of a stage's finished parts, from which a killed run resumes."""
        return path_below(self.folder, self.path(stage).with_suffix(".partial").name)

    def work(self, stage: str) -> Work:
        """Return the files and options of a stage; optional results that are missing are omitted."""
        row, stamp = self.stages[stage], self.stamps[stage]
        available = {name: is_optional for name, is_optional in row.sources.items() if name in self.stages}
        return Work(
            stage,
            self.partial(stage),
            stamp if "text" in row.keys.split() else replace(stamp, study=""),
            self.loaded.path.parent,
            {
                name: self.path(name)
                for name, is_optional in available.items()
                if not is_optional or self.has_result(name)
            },
            self.jobs,
            self.console,
            "gears" in self.stages,
        )

    def has_result(self, stage: str) -> bool:
        """Return True if a result of the stage from the same inputs exists, written by any version of elastid."""
        stamp = read_stamp(self.path(stage))
        return stamp is not None and stamp.inputs == self.stamps[stage].inputs

    def is_current(self, stage: str) -> bool:
        """Return True if an unchanged result of the stage from the same inputs and the same code exists."""
        stamp_now, path, row = self.stamps[stage], self.path(stage), self.stages[stage]
        if not all(any(self.folder.glob(n)) for n in row.leaves) or changed_texts(self.folder, row.texts):
            return False
        if any(path.exists() and name not in self.stages for name, path in self.overwritten(stage).items()):
            return False
        if path.suffix == ".h5":
            stamp = read_stamp(path)
            return stamp is not None and stamp.matches(stamp_now) and has_checksum(path)
        text = path.read_text(encoding="utf-8", errors="replace")
        return stamp_now.inputs in text and stamp_now.code in text

    def overwritten(self, stage: str) -> dict[str, Path]:
        """Return results of later stages that rewrite a text of this stage; they are removed together with the text."""
        rows = stages_of(self.study.kind)
        return {
            name: self.folder / rows[name].leaves[0]
            for name in list(rows)[list(rows).index(stage) + 1 :]
            if {*rows[name].leaves} & {*rows[stage].leaves}
        }  # fmt: skip

    def require_stage(self, name: str) -> None:
        """Refuse a stage that this study does not have; StudyError."""
        if name in self.stages:
            return
        key = next((spec.needs for spec in stages_of(self.study.kind).values() if spec.name == name), "")
        advice = f"; give it the section {key}: {{}}, all of whose keys have defaults" if key else ""
        text = f"a study of kind {self.study.kind} has no stage `{name}`{advice}; its stages are"
        raise StudyError("study/stage", f"{text} {', '.join(self.stages)}", self.loaded.path)

    def require(self, stage: str) -> None:
        """Raise StudyError with the command to run if the stage or its inputs are missing."""
        self.require_stage(stage)
        for source, is_optional in self.stages[stage].sources.items():
            if source in self.stages and not is_optional:
                self.require_result(source)

    def require_result(self, name: str) -> None:
        """Raise StudyError with the command to run if the result of a stage is missing."""
        path, required = self.path(name), self.stamps[name]
        stamp = read_stamp(path)
        command = f"Run `elastid run {self.loaded.path} {name}` first, with the same options"
        if stamp is None or stamp.inputs != required.inputs:
            text = f"{path} is missing, damaged, or made from another study, other data or other options"
            raise StudyError("run/earlier-stage", f"{text}. {command}")
        code_reason = "" if stamp.code == required.code else f"was made by other code or versions ({stamp.software})"
        if reason := code_reason or ("" if has_checksum(path) else "has no checksum, so that damage is not detectable"):
            advice = f"To make it again: `elastid run {self.loaded.path} {name}`"
            self.console.warn(f"{path} {reason} and is used unchanged. {advice}")


@contextmanager
def open_run_folder(folder: Path, jobs: int, console: Console) -> Iterator[None]:
    """Lock the folder, and write run.log with command, versions and errors; ElastidError for a second writer."""
    with lock_folder(folder), console.logging_to(folder):
        command = shlex.join(["elastid", *sys.argv[1:]])
        console.detail(f"{datetime.now(UTC):%Y-%m-%d %H:%M:%S} UTC: {command}, {jobs} processes")
        console.detail(software())
        try:
            yield
        except KeyboardInterrupt:
            console.log("interrupted")
            raise
        except Exception as error:
            console.log(str(error) or repr(error))
            raise


def run_all(run: Run, names: Sequence[str] = ()) -> None:
    """Run all stages whose results are not current, or the named stages in any case.

    FitError if the fit cannot be trusted; StudyError if a named stage reads a result that is missing or outdated.
    """
    for name in names:
        run.require_stage(name)
    stages = {name: stage for name, stage in run.stages.items() if name in names or not names}
    if names:
        run.require(next(iter(stages)))
    modules = [stage.module for name, stage in stages.items() if names or not run.is_current(name)]
    if run.jobs > 1 and modules:
        load_for_workers(modules)
    with run.open_folder(), persistent_workers():
        run.console.shows_tables = bool(names) or run.console.verbosity > 0
        for name, stage in stages.items():
            if names:
                run.require(name)
                run_stage(run, name)
            elif run.is_current(name):
                run.console.say(f"{name}: up to date, {run.path(name).name} kept")
                # Left by a run that was killed between writing the result and removing its parts.
                shutil.rmtree(run.partial(name), ignore_errors=True)
                save_checksums(run.folder, stage.texts)
            else:
                path, modified = run.path(name), [run.folder / file for file in changed_texts(run.folder, stage.texts)]
                if path.suffix == ".h5" and path.is_file() and not is_intact(path):
                    modified.append(path)
                for file in modified:
                    run.console.warn(f"{file} was modified after it was written and is made again")
                run_stage(run, name)
        run.console.shows_tables = True
        for conclude in dict.fromkeys(stage.conclude for stage in stages.values() if stage.conclude):
            resolve_name(conclude)(run)


def run_stage(run: Run, name: str) -> None:
    """Run a stage, write its files, report, and then raise its error if it failed."""
    stage, names = run.stages[name], [*run.stages]
    first = names.index(name)
    later_stages = [later for later in names[first:] if later == name or not run.is_current(later)]
    texts = {text for later in later_stages for text in run.stages[later].texts}
    # If this stage fails, outdated texts must not remain as results.
    remove_texts(run.folder, texts - {text for earlier in names[:first] for text in run.stages[earlier].texts})
    artefacts = resolve_name(stage.function)(stage.select_keys(run.study), run.work(name))
    artefact = run.path(name)
    old_paths = list(run.overwritten(name).values())
    if artefacts.error is not None and artefact.name not in artefacts.files:
        old_paths.append(artefact)  # an older result does not belong to the summary of the failure
    for result in old_paths:
        result.unlink(missing_ok=True)
    for file, write in artefacts.files.items():
        # A link in place of a file is replaced, one in place of a folder refused.
        write(run.folder / file if Path(file).suffix else path_below(run.folder, file), run.stamps[name])
    shutil.rmtree(run.partial(name), ignore_errors=True)
    artefacts.report(run.console)
    if artefacts.error is not None:
        raise artefacts.error
    save_checksums(run.folder, stage.texts)
    if name == "measure" and run.study.experiment.recorded is not None:
        try:
            load_with_logs(run.loaded.path, run.loaded.overrides)
        except StudyError as error:  # `check` finds errors that the import does not
            run.console.warn(str(error))


def all_cores() -> int:
    """Return the number of processors that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
