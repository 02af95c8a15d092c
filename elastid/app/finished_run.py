"""Functions run, export and compare of Python, and the finished run: `elastid.run("study.yml").result["k_1"]`."""

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
from elastid.validation.comparison import Comparison
from elastid.validation.frf_error import Validation


def run(
    study: Path | str, folder: Path | str = "", *stages: str, set: Sequence[str] = (), jobs: int = 1,
    verbosity: int = -1
) -> "FinishedRun":  # fmt: skip
    """Run the stages of a study as `elastid run` does; stages with unchanged inputs keep their results.

    Parameters
    ----------
    study : Path or str
        Study file.
    folder : Path or str
        Folder of the run. Default: runs/<name of the study>.
    *stages : str
        Stages to run, whether current or not. Default: all stages that are not current.
    set : sequence of str
        Keys that override the study's, such as "fit.starts=4".
    jobs : int
        Number of processes; a script with several needs `if __name__ == "__main__":`.
    verbosity : int
        -2 nothing, -1 warnings, 0 one row per stage, 1 all details.

    Returns
    -------
    FinishedRun
        Access to records, responses, result, validation and report. A misfit raises no error, see `result.status`.

    Raises
    ------
    StudyError
        With the location of every error in the study.
    DataError
        For logs that cannot be used.
    FitError
        If the fit finds no optimum.

    Examples
    --------
    >>> from tempfile import TemporaryDirectory
    >>> from elastid.app.scaffold import new
    >>> with TemporaryDirectory() as folder:
    ...     study = new(Path(folder) / "bench", "recorded")  # as `elastid new bench --template recorded`
    ...     done = run(study, Path(folder) / "run", "measure", "estimate")
    ...     done.responses.names
    ['bench']
    """
    run = _as_run(study, folder, set, jobs, verbosity)
    try:
        run_all(run, stages)
    except FitError:
        if not all(run.is_current(stage) for stage in stages or run.stages):
            raise
    return FinishedRun(run)


def export(
    study: "FinishedRun | Path | str", target: str, folder: Path | str = "", *, count: int = 1000
) -> tuple[Path, ...]:
    """Export a run to another tool as `elastid export` does.

    Parameters
    ----------
    study : FinishedRun, Path or str
        Finished run, or its study file.
    target : str
        Target of `elastid export --to`: csv, matlab, control, mujoco, fmu, urdf, robot, samples ...
    folder : Path or str
        Folder of the run. Default: runs/<name of the study>.
    count : int
        Number of posterior samples of the target samples.

    Returns
    -------
    tuple of Path
        The written files.

    Raises
    ------
    StudyError
        For an unknown target, or if a required stage has not run.

    Examples
    --------
    >>> from tempfile import TemporaryDirectory
    >>> from elastid.app.scaffold import new
    >>> with TemporaryDirectory() as folder:
    ...     study = new(Path(folder) / "bench", "frf")  # as `elastid new bench --template frf`
    ...     done = run(study, Path(folder) / "run", "measure", "estimate")
    ...     [path.name for path in export(done, "csv")]
    ['bench-measured.csv', 'modes.csv']
    """
    return exporting.export(_as_run(study, folder), target, count)


def compare(study: "FinishedRun | Path | str", *further: Path | str, folder: Path | str = "") -> Comparison:
    """Rank models by cross-validation over the configurations, as `elastid compare` does.

    Parameters
    ----------
    study : FinishedRun, Path or str
        Finished run, or its study file, whose section `compare` lists the models.
    *further : Path or str
        Studies of further models.
    folder : Path or str
        Folder of the run. Default: runs/<name of the study>.

    Returns
    -------
    Comparison
        Prediction error of each model on the left-out configurations, the best first.

    Raises
    ------
    StudyError
        For a study without such models, or if its responses have not been estimated.

    Examples
    --------
    >>> from tempfile import TemporaryDirectory
    >>> text = '''
    ... name: bench
    ... robot:
    ...   name: bench
    ...   bodies: [{name: load, inertia: 0.02, joints: [{name: 1, spring: {stiffness: 100}, motor: {inertia: 0.01}}]}]
    ... excitation: {rate_hz: 500, period: 1, band_hz: [5, 50], torque_rms: 1}
    ... experiment: {configurations: {a: [0], b: [1]}, simulated: {noise: {torque_std: 0.01}}}
    ... fit: {starts: 1}
    ... compare: {variants: [{name: lowband, set: ["fit.band_hz=[5, 30]"]}]}
    ... '''
    >>> with TemporaryDirectory() as folder:
    ...     study = Path(folder) / "study.yml"
    ...     _ = study.write_text(text)
    ...     sorted(row.name for row in compare(run(study, Path(folder) / "run", "design", "measure", "estimate")).rows)
    ['bench', 'lowband']
    """
    return comparing.compare(_as_run(study, folder), [load(path) for path in further])


def _as_run(
    study: "FinishedRun | Path | str", folder: Path | str, set: Sequence[str] = (), jobs: int = 1, verbosity: int = -1
) -> Run:
    if isinstance(study, FinishedRun):
        return study.run
    loaded = load(study, set)
    return Run(loaded, Path(folder or Path("runs") / loaded.study.name), jobs, Console(verbosity))


@dataclass(frozen=True, repr=False)
class FinishedRun:
    """Study with finished stages; values are read from the folder of the run on demand.

    StudyError for a value that this kind of study does not have.
    """

    run: Run

    __repr__, _repr_html_ = as_text, as_html

    @property
    def display(self) -> Display:
        """Study, and the file of each stage."""
        rows = [(stage, str(self.run.path(stage))) for stage in self.run.stages]
        return Display(f"Study {self.run.study.name}", ("stage", "result"), rows)

    @property
    def records(self) -> tuple[Record, ...]:
        """Records, with corrected logs."""
        return tuple(read_records(self._path("measure")))

    @property
    def responses(self) -> Responses:
        """Frequency response of each configuration: responses["folded"]["motor 1", "motor 2"]."""
        return read_responses(self._path("estimate"))

    @property
    def result(self) -> Result | FrictionResult:
        """Elastic or friction parameters with intervals and status."""
        if self.run.study.friction is not None:
            return read_friction_result(self._path("friction"))
        return read_fit(self._path("fit"))

    @property
    def validation(self) -> Validation:
        """Prediction errors in all configurations, including the validation configurations."""
        return read_validation(self._path("validate"))

    @property
    def report(self) -> Path:
        """Report page of the run."""
        return self._path("report")

    def _path(self, stage: str) -> Path:
        self.run.require_stage(stage)
        return self.run.path(stage)
