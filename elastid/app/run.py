"""Run: a study, the folder of its results, which of them are current, and its stages carried out."""

from __future__ import annotations

import os
import shlex
import shutil
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from datetime import UTC, datetime
from functools import cached_property
from pathlib import Path
from pkgutil import resolve_name

from elastid.app.console import Console
from elastid.app.stage_table import Stage, stages_of, stages_of_study
from elastid.app.work import Work, software
from elastid.app.work import stamps as stamps_of
from elastid.base.errors import StudyError
from elastid.base.files import own_path
from elastid.base.workers import lasting_workers, load_for_workers
from elastid.store.artefacts import Stamp, read_stamp
from elastid.store.files import changed_texts, has_checksum, is_intact, keep_checksums, one_writer
from elastid.study import LoadedStudy, Study, load_with_logs


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
        return stamps_of(self.loaded)

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

    def work(self, stage: str) -> Work:
        """Files of a stage and ways of working on it; without the result of an earlier one that may be missing."""
        row, stamp = self.stages[stage], self.stamps[stage]
        there = {name: may_miss for name, may_miss in row.sources.items() if name in self.stages}
        sources = {name: self.path(name) for name, may_miss in there.items() if not may_miss or self.is_made(name)}
        shown = stamp if "text" in row.keys.split() else replace(stamp, study="")
        return Work(stage, self.partial(stage), shown, self.loaded.base, sources, self.jobs, self.console)

    def is_made(self, stage: str) -> bool:
        """True if the result of a stage is there, made from the same inputs by any version."""
        stamp = read_stamp(self.path(stage))
        return stamp is not None and stamp.inputs == self.stamps[stage].inputs

    def is_current(self, stage: str) -> bool:
        """True if the result of a stage is there as it was written, made from the same inputs by the same code."""
        wanted, path, row = self.stamps[stage], self.path(stage), self.stages[stage]
        if not all(any(self.folder.glob(n)) for n in row.leaves) or changed_texts(self.folder, row.texts):
            return False
        if any(each.exists() and name not in self.stages for name, each in self.overwritten(stage).items()):
            return False
        if path.suffix == ".h5":
            stamp = read_stamp(path)
            return stamp is not None and stamp.is_of(wanted) and has_checksum(path)
        text = path.read_text(encoding="utf-8", errors="replace")
        return wanted.inputs in text and wanted.code in text

    def overwritten(self, stage: str) -> dict[str, Path]:
        """Results of later stages that leave a text of this one again, with theirs in it: gone with it."""
        rows = stages_of(self.study.kind)
        later = list(rows)[list(rows).index(stage) + 1 :]
        return {
            name: self.folder / rows[name].leaves[0]
            for name in later
            if {*rows[name].leaves} & {*rows[stage].leaves}
        }  # fmt: skip

    def require_stage(self, name: str) -> None:
        """Refuse a stage that this study does not have; StudyError."""
        if name in self.stages:
            return
        needed = next((each.needs for each in stages_of(self.study.kind).values() if each.name == name), "")
        advice = f"; give it the section {needed}: {{}}, all of whose keys have defaults" if needed else ""
        raise StudyError(
            "study/stage",
            f"a study of kind {self.study.kind} has no stage `{name}`{advice}; its stages are {', '.join(self.stages)}",
            self.loaded.path,
        )

    def require(self, stage: str) -> None:
        """Refuse to go on without the stage, or the results that it reads; StudyError says which command makes them."""
        self.require_stage(stage)
        for source, may_miss in self.stages[stage].sources.items():
            if source in self.stages and not may_miss:
                self.require_result(source)

    def require_result(self, name: str) -> None:
        """Refuse to go on without the result of a stage; StudyError says which command makes it."""
        path, wanted = self.path(name), self.stamps[name]
        stamp = read_stamp(path)
        command = f"run `elastid run {self.loaded.path} {name}` first, with the same options"
        if stamp is None or stamp.inputs != wanted.inputs:
            raise StudyError(
                "run/earlier-stage",
                f"{path} is missing, damaged, or made from another study, other data or other options: {command}",
            )
        other = "" if stamp.code == wanted.code else f"was made by other code or versions ({stamp.software})"
        if doubt := other or ("" if has_checksum(path) else "carries no checksum, so that damage would go unnoticed"):
            again = f"`elastid run {self.loaded.path} {name}` makes it again"
            self.console.warn(f"{path} {doubt}, and is used as is; {again}")


@contextmanager
def logged_in(folder: Path, jobs: int, console: Console) -> Iterator[None]:
    """run.log of a folder with date, command and versions, and how the work ended; ElastidError for a second writer."""
    with one_writer(folder), console.logging_to(folder):
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
    """All stages in order, but for those whose result is current, or those that are named, current or not.

    FitError where the fit cannot be trusted; StudyError where a result that a named stage reads is missing or outdated.
    """
    for name in names:
        run.require_stage(name)
    stages = {name: stage for name, stage in run.stages.items() if name in names or not names}
    for name in [*stages][: len(names) and 1]:
        run.require(name)
    modules = [stage.module for name, stage in stages.items() if names or not run.is_current(name)]
    if run.jobs > 1 and modules:
        load_for_workers(modules)
    with logged_in(run.folder, run.jobs, run.console), lasting_workers():
        run.console.shows_tables = bool(names) or run.console.verbosity > 0
        for name, stage in stages.items():
            if names:
                run.require(name)
                carry_out(run, name)
            elif run.is_current(name):
                run.console.say(f"{name}: nothing has changed, {run.path(name).name} is kept")
                # Of a stage that was killed after its result was written and before it had tidied up.
                shutil.rmtree(run.partial(name), ignore_errors=True)
                keep_checksums(run.folder, stage.texts)
            else:
                _report_damage(run, run.path(name), stage)
                carry_out(run, name)
        run.console.shows_tables = True
        for conclude in dict.fromkeys(stage.conclude for stage in stages.values() if stage.conclude):
            resolve_name(conclude)(run)


def carry_out(run: Run, name: str) -> None:
    """Hand a stage its values, write its files, and report; its error, if it failed, once all are written."""
    stage = run.stages[name]
    artefacts = resolve_name(stage.function)(stage.sees(run.study), run.work(name))
    own = run.path(name)
    replaced = list(run.overwritten(name).values())
    if artefacts.error is not None and own.name not in artefacts.files:
        # What an interrupted stage leaves does not stand beside an older result, which would be kept with it.
        if run.is_current(name):
            artefacts.report(run.console)
            raise artefacts.error
        replaced.append(own)
    for result in replaced:
        result.unlink(missing_ok=True)
    if name in ("fit", "gears") and not run.is_current("validate"):
        run.summary("validate").unlink(missing_ok=True)  # of another result, which no program is to read next to this
    for file, write in artefacts.files.items():
        # A link in place of a file is replaced, one in place of a folder refused.
        path = run.folder / file if Path(file).suffix else own_path(run.folder, file)
        write(path, run.stamps[name])
    if not isinstance(artefacts.error, KeyboardInterrupt):
        shutil.rmtree(run.partial(name), ignore_errors=True)
    artefacts.report(run.console)
    if artefacts.error is not None:
        raise artefacts.error
    keep_checksums(run.folder, stage.texts)
    if name == "measure" and run.study.experiment.recorded is not None:
        try:
            load_with_logs(run.loaded.path, run.loaded.overrides)
        except StudyError as error:  # what `check` refuses, and the import does not
            run.console.warn(str(error))


def _report_damage(run: Run, path: Path, stage: Stage) -> None:
    damaged = [run.folder / name for name in changed_texts(run.folder, stage.texts)]
    if path.suffix == ".h5" and path.is_file() and not is_intact(path):
        damaged.append(path)
    for each in damaged:
        run.console.warn(f"{each} has changed since it was written; it is made again")


def all_cores() -> int:
    """Number of processors that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
