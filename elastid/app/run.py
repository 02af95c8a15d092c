"""Run: a study, the folder of its results, which of them are current, and its stages carried out."""

from __future__ import annotations

import hashlib
import json
import os
import shlex
import shutil
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from datetime import UTC, datetime
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING

from elastid.app.console import Console
from elastid.app.provenance import file_hash, software, stamps, upstream
from elastid.app.stage_table import FRICTION, SIMULATED, Stage, function_of, module_of, stages_of, stages_of_study
from elastid.base.errors import StudyError
from elastid.base.execution import Execution
from elastid.base.files import own_path
from elastid.base.workers import lasting_workers, load_for_workers
from elastid.store import (
    Stamp,
    changed_texts,
    has_checksum,
    is_intact,
    keep_checksums,
    one_writer,
    read_stamp,
    remove_leftovers,
)
from elastid.study import LoadedStudy, Study

if TYPE_CHECKING:
    from elastid.store import Checkpoint


@dataclass(frozen=True)
class Run:
    """jobs: processes; the results do not depend on it."""

    loaded: LoadedStudy
    folder: Path
    jobs: int = 1
    console: Console = field(default_factory=Console)

    @property
    def study(self) -> Study:
        """The study."""
        return self.loaded.study

    @cached_property
    def stamps(self) -> dict[str, Stamp]:
        """The stamp that the result of each stage must carry."""
        return stamps(self.loaded)

    @cached_property
    def stages(self) -> dict[str, Stage]:
        """The stages that this study has, in order."""
        return stages_of_study(self.study)

    def path(self, stage: str) -> Path:
        """The file in which a stage leaves its result."""
        return self.folder / self.stages[stage].leaves[0]

    def summary(self, stage: str) -> Path:
        """The file in which programs read how a stage ended."""
        return self.folder / self.stages[stage].leaves[1]

    def partial(self, stage: str) -> Path:
        """The folder in which a stage keeps its finished parts until its result is whole: it is resumed from there."""
        return own_path(self.folder, self.path(stage).with_suffix(".partial").name)

    def resumed(self, stage: str) -> Checkpoint:
        """The finished parts of an interrupted stage: of this study, by this code, from the very files it reads."""
        from elastid.store import Checkpoint  # brings the solvers, which most stages do not need

        stamp = self.stamps[stage]
        hashes = [file_hash(self.path(name)) for name in upstream(self.stages, self.stages[stage])]
        key = hashlib.sha256(json.dumps([stamp.inputs, stamp.code, hashes]).encode()).hexdigest()
        remove_leftovers(self.partial(stage))
        finished = Checkpoint(self.partial(stage), key)
        if finished:
            self.console.say(f"{stage}: resumed from {finished.words}")
        return finished

    @contextmanager
    def execution(self, stage: str, checkpoint: Checkpoint | None = None) -> Iterator[Execution]:
        """How a stage is to be worked on, its progress shown."""
        with self.console.progress(stage) as progress:
            yield Execution(self.jobs, progress) if checkpoint is None else Execution(self.jobs, progress, checkpoint)

    def is_current(self, stage: str) -> bool:
        """Whether the result of a stage is there, as it was written, and made from the same inputs by the same code."""
        wanted, path, row = self.stamps[stage], self.path(stage), self.stages[stage]
        if not all((self.folder / name).exists() for name in row.leaves) or changed_texts(self.folder, row.texts):
            return False
        if path.suffix == ".h5":
            found = read_stamp(path)
            return found is not None and found.is_of(wanted) and has_checksum(path)
        text = path.read_text(encoding="utf-8", errors="replace")
        return wanted.inputs in text and wanted.code in text

    def require_stage(self, name: str) -> None:
        """Refuse a stage of the other kind of study: of friction, or of elasticity; StudyError."""
        kind = "friction" if self.study.friction is not None else "elasticity"
        of_kind = FRICTION if self.study.friction is not None else SIMULATED
        if name not in stages_of(of_kind):
            raise StudyError(
                f"{self.loaded.path}: the study identifies {kind}, which has no stage `{name}`; its stages are "
                f"{', '.join(self.stages)}"
            )
        if needed := stages_of(of_kind)[name].needs:
            raise StudyError(
                f"{self.loaded.path}: `{name}` needs the section `{needed}` of the study; give {needed}: {{}}, all of "
                "its keys have defaults"
            )

    def require(self, stage: str) -> None:
        """Refuse to go on without the results that a stage reads; StudyError says which command makes them.

        Or that the study has no robot, where it lacks the stage for that.
        """
        if stage not in self.stages:
            self.study.as_robot()
            self.require_stage(stage)
        for name in upstream(self.stages, self.stages[stage]):
            self.require_result(name)

    def require_result(self, name: str) -> None:
        """Refuse to go on without the result of a stage; StudyError says which command makes it."""
        path, found = self.path(name), read_stamp(self.path(name))
        command = f"run `elastid {name} {self.loaded.path}` first, with the same options"
        if not path.is_file():
            raise StudyError(f"{path} is missing: {command}")
        if found is None:
            raise StudyError(f"{path} cannot be read or is no result of elastid: {command}")
        if found.inputs != self.stamps[name].inputs:
            raise StudyError(f"{path} was made from another study, other data or other options: {command}")
        if not has_checksum(path):
            self.console.warn(
                f"{path} carries no checksum, so that damage to it would go unnoticed: it was written by an older "
                f"elastid, or its first bytes are damaged; it is used as is, and `elastid {name}` makes it anew"
            )
        if found.code != self.stamps[name].code:
            made_by = found.software or f"elastid {found.version}"
            self.console.warn(f"{path} was made by other versions ({made_by}) and is used as is")

    @contextmanager
    def logged(self) -> Iterator[None]:
        """What is said goes to run.log in the folder too, and how the work ended; nobody else writes there meanwhile.

        ElastidError where another program does.
        """
        with logged_in(self.folder, self.jobs, self.console):
            yield


@contextmanager
def logged_in(folder: Path, jobs: int, console: Console) -> Iterator[None]:
    """run.log of a folder with date, command and versions, and how the work ended; ElastidError for a second writer."""
    with one_writer(folder), console.logging_to(folder):
        remove_leftovers(folder)
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


def run_all(run: Run) -> None:
    """All stages in order, but for those whose result is current; FitError where the fit cannot be trusted."""
    _load_for_workers(run, [stage for name, stage in run.stages.items() if not run.is_current(name)])
    with run.logged(), lasting_workers():
        for name, stage in run.stages.items():
            if run.is_current(name):
                run.console.say(f"{name}: nothing has changed, {run.path(name).name} is kept")
                # Of a stage that was killed after its result was written and before it had tidied up.
                shutil.rmtree(run.partial(name), ignore_errors=True)
            else:
                _tell_of_damage(run, run.path(name), stage)
                function_of(stage.function)(run)
            keep_checksums(run.folder, stage.texts)
        for stage in run.stages.values():
            if stage.conclude:
                function_of(stage.conclude)(run)


def _tell_of_damage(run: Run, path: Path, stage: Stage) -> None:
    """Say that a result is made again because its files have changed."""
    damaged = [run.folder / name for name in changed_texts(run.folder, stage.texts)]
    if path.suffix == ".h5" and path.is_file() and not is_intact(path):
        damaged.append(path)
    for each in damaged:
        run.console.warn(f"{each} has changed since it was written; it is made again")


def run_stage(run: Run, name: str) -> None:
    """One stage, whether or not it is current; StudyError where a result that it reads is missing or out of date."""
    if name not in run.stages:
        run.study.as_robot()
        run.require_stage(name)
        kind = {"responses": "frequency responses from elsewhere"}.get(run.study.experiment.kind, "recorded")
        raise StudyError(
            f"{run.loaded.path}: the experiment is {kind}, there is nothing to {name}; the first stage is "
            f"`{next(iter(run.stages))}`"
        )
    stage = run.stages[name]
    run.require(name)
    _load_for_workers(run, [stage])
    with run.logged(), lasting_workers():
        function_of(stage.function)(run)
        keep_checksums(run.folder, stage.texts)
        if stage.conclude:
            function_of(stage.conclude)(run)


def _load_for_workers(run: Run, stages: Sequence[Stage]) -> None:
    """What the stages work with, where several processes will."""
    if run.jobs > 1 and stages:
        load_for_workers([module_of(stage.function) for stage in stages])


def all_cores() -> int:
    """How many processors this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
