"""run, export, compare: a study -> its stages done, their results as values: elastid.run("study.yml").result["k_1"]."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from elastid.app import compare as comparing
from elastid.app import export as exporting
from elastid.app.console import Console
from elastid.app.run import Run, run_all
from elastid.base.display import Display, as_html, as_text
from elastid.base.errors import FitError
from elastid.fit.result import Result
from elastid.friction_study.result import FrictionResult
from elastid.record import Record
from elastid.response import Responses
from elastid.store.friction_study import read_friction_result
from elastid.store.measured import read_records, read_responses
from elastid.store.results import read_fit, read_validation
from elastid.study import load
from elastid.validation.agreement import Validation
from elastid.validation.comparison import Comparison


def run(
    study: Path | str,
    folder: Path | str = "",
    *stages: str,
    set: Sequence[str] = (),
    jobs: int = 1,
    verbosity: int = -1,
) -> FinishedRun:
    """All stages of a study, as `elastid run` does it: those whose inputs have not changed keep their results.

    folder: of the run, default runs/<name>.  stages: done in place of all, current or not.  set: keys that take the
    place of the study's, such as "fit.starts=4".  jobs: processes; more than one in a script need its
    `if __name__ == "__main__":`.  verbosity: -2 nothing, -1 warnings, 0 a line a stage, 1 every detail.  A misfit is no
    error here: `result.status` says it.
    Raises StudyError with the place of every error in the study, DataError for logs, FitError where nothing was found.
    """
    run = _run_of(study, folder, set, jobs, verbosity)
    try:
        run_all(run, stages)
    except FitError:
        if not all(run.is_current(stage) for stage in stages or run.stages):
            raise
    return FinishedRun(run)


def export(
    study: FinishedRun | Path | str, target: str, folder: Path | str = "", *, count: int = 1000
) -> tuple[Path, ...]:
    """The files of `elastid export --to target` of a run, or of the study and folder of one; count: of draws.

    StudyError where a stage that it reads has not run, or for no such target.
    """
    return exporting.export(_run_of(study, folder), target, count)


def compare(study: FinishedRun | Path | str, *further: Path | str, folder: Path | str = "") -> Comparison:
    """The ranking of `elastid compare` over left-out configurations; further: studies of other models."""
    return comparing.compare(_run_of(study, folder), [load(path) for path in further])


def _run_of(
    study: FinishedRun | Path | str, folder: Path | str, set: Sequence[str] = (), jobs: int = 1, verbosity: int = -1
) -> Run:
    if isinstance(study, FinishedRun):
        return study.run
    loaded = load(study, set)
    return Run(loaded, Path(folder or Path("runs") / loaded.study.name), jobs, Console(verbosity))


@dataclass(frozen=True, repr=False)
class FinishedRun:
    """A study whose stages are done; its values are read from the folder of the run when they are asked for.

    StudyError for a value that this kind of study does not have.
    """

    run: Run

    __repr__, _repr_html_ = as_text, as_html

    @property
    def display(self) -> Display:
        """The study, its folder and the files there."""
        rows = [(stage, self.run.folder / row.leaves[0]) for stage, row in self.run.stages.items()]
        return Display(f"Study {self.run.study.name}", ("stage", "result"), [(s, str(path)) for s, path in rows])

    @property
    def records(self) -> tuple[Record, ...]:
        """The records, logs mended."""
        return tuple(read_records(self._path("measure")))

    @property
    def responses(self) -> Responses:
        """The responses, one a configuration: responses["folded"]["motor 1", "motor 2"]."""
        return read_responses(self._path("estimate"))

    @property
    def result(self) -> Result | FrictionResult:
        """The elastic parameters, or those of friction, with intervals and status."""
        if self.run.study.friction is not None:
            return read_friction_result(self._path("friction"))
        return read_fit(self._path("fit"))

    @property
    def validation(self) -> Validation:
        """The agreement on all configurations, those left out among them."""
        return read_validation(self._path("validate"))

    @property
    def report(self) -> Path:
        """The page of the run."""
        return self._path("report")

    def _path(self, stage: str) -> Path:
        self.run.require_stage(stage)
        return self.run.path(stage)
