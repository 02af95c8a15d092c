"""A worker that is killed in any stage changes no byte: the files are those of a run in one process."""

import os
import signal
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

import pytest
from plants.runs import run_of

from elastid.app.compare import compare
from elastid.app.console import Console
from elastid.app.run import Run, run_all
from elastid.app.stage_table import STAGES
from elastid.base import execution
from elastid.base.workers import load_for_workers

# Friction is sought, starts and repetitions are several: all that works in parallel.
ELASTIC = (
    "experiment.realisations=2",
    "estimator.friction=coulomb",
    "fit.bootstrap=40",
    "fit.profile=[k_1]",
    "compare.variants=[{name: other weights, set: [fit.start_factor=2]}]",
    "report.formats=[png]",
)
# Stages that have work for several processes.
PARALLEL = {"design", "measure", "estimate", "fit", "validate", "report", "compare"}


class DyingOnce:
    """The work of a stage; the process that has the first value of it is killed, as by a system without memory."""

    def __init__(self, function: Callable[[Any], Any], died: Path) -> None:
        self.function = function
        self.died = died

    def __call__(self, item: Any) -> Any:
        value = self.function(item)
        with suppress(FileExistsError):
            self.died.touch(exist_ok=False)
            os.kill(os.getpid(), signal.SIGKILL)
        return value


def worked(run: Run, names: Sequence[str]) -> Iterator[str]:
    """The name of each stage, after it was carried out."""
    load_for_workers(sorted({stage.module for stage in STAGES}))
    for name in names:
        compare(run) if name == "compare" else run_all(run, [name])
        yield name


def files(folder: Path) -> dict[str, bytes]:
    """All but the log, which has the time in it."""
    found = (path for path in folder.rglob("*") if path.is_file() and path.name != "run.log")
    return {path.relative_to(folder).as_posix(): path.read_bytes() for path in found}


def stages_with_deaths(
    run: Run, names: Sequence[str], folder: Path, monkeypatch: pytest.MonkeyPatch, work_in: str
) -> set[str]:
    """Stages carried out, and in which of them a worker died; work_in: the function that hands their work out."""
    found, flag = set(), folder / "died"
    parallel = getattr(execution, work_in)

    def dying(*given: Any) -> Iterator[Any]:
        return parallel(*(DyingOnce(one, flag) if callable(one) else one for one in given))

    monkeypatch.setattr(execution, work_in, dying)
    for name in worked(run, names):
        if flag.exists():
            found.add(name)
            flag.unlink()
    return found


@pytest.mark.slow
def test_run_killed_in_each_stage_gives_same_bytes(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, tiny: Path) -> None:
    """Of two, one that has done its first part."""
    alone = run_of(tiny, tmp_path / "alone", *ELASTIC)
    names = (*alone.stages, "compare")
    assert tuple(worked(alone, names)) == names
    run = Run(alone.loaded, tmp_path / "run", 2, Console(-1))
    assert stages_with_deaths(run, names, tmp_path, monkeypatch, "_by_workers") == PARALLEL
    assert files(run.folder) == files(alone.folder)
