"""The runner of commands that use a fit: read it, compute, write h5, csv, page and figure, and say the answer."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from matplotlib.figure import Figure

from elastid.app.run import Run, logged_in
from elastid.app.stages.fit import current_fit, warn_of_distrust
from elastid.fit.result import Result
from elastid.report.answer import Answer
from elastid.report.page.page_of_use import write_page_of_answer
from elastid.store.files import keep_checksums


@dataclass(frozen=True)
class Used:
    """files: name in the run folder -> write(path).  figure(): of the page, which is written where page is not given.

    page(folder, provenance): a page of its own.
    """

    answer: Answer
    files: Mapping[str, Callable[[Path], Any]]
    figure: Callable[[], Figure]
    page: Callable[[Path, Mapping[str, str]], Path] | None = None
    warnings: tuple[str, ...] = ()


def use_fit(run: Run, name: str, work: Callable[[Result], Used]) -> None:
    """All results of a command `name` on the study's fit; StudyError without a current one."""
    result = current_fit(run)
    with logged_in(run.folder, run.jobs, run.console):
        used, made_by = work(result), run.stamps["fit"].shown
        for file, write in used.files.items():
            write(run.folder / file)
        if used.page is not None:
            used.page(run.folder, made_by)
        else:
            write_page_of_answer(used.answer, used.figure, run.folder / f"{name}.html", made_by)
        names = (*used.files, f"{name}.html", f"{name}.png")
        keep_checksums(run.folder, names)
        for table in used.answer.tables:
            run.console.detail(table.text)
        for sentence in (*used.answer.sentences, ", ".join(str(run.folder / each) for each in names)):
            run.console.say(f"{name}: {sentence}")
        for words in used.warnings:
            run.console.warn(f"{name}: {words}")
        warn_of_distrust(run, name, result)
