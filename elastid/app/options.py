"""Options and arguments that several commands take, and the run that they ask for."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import reduce
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeAlias

import click

if TYPE_CHECKING:
    from elastid.app.run import Run

Decorator: TypeAlias = Callable[[Callable[..., Any]], Callable[..., Any]]


class Finite(click.FloatRange):
    """A finite number in a range, which nan is in of itself."""

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """The number; click's error for nan and inf."""
        number = super().convert(value, param, ctx)
        if not math.isfinite(number):
            self.fail(f"{value} is not a finite number.", param, ctx)
        return number


POSITIVE = Finite(min=0, min_open=True)

_OPTIONS: dict[str, Decorator] = {
    "run": click.option(
        *("--run", "folder"), type=click.Path(path_type=Path), metavar="DIR",
        help="Where the results go (default: runs/<name of the study>).",
    ),
    "set": click.option(
        *("--set", "overrides"), multiple=True, metavar="KEY.PATH=VALUE",
        help="Overrides a key of the study, for example fit.starts=5.",
    ),
    "jobs": click.option("--jobs", type=click.IntRange(min=1), metavar="N", help="Processes (default: all cores)."),
    "with": click.option(
        *("--with", "source"), type=click.Path(path_type=Path), required=True, metavar="RUN",
        help="Run folder of a study that has identified friction or elasticity, or its friction.h5 or fit.h5.",
    ),
    "log": click.option(
        *("--log", "logs"), type=click.Path(path_type=Path), multiple=True, metavar="FILE",
        help="A log that takes the place of those of the study, with the same channels; give it again for more.",
    ),
    "dask": click.option("--dask", metavar="ADDRESS", default="", help="Work on this Dask scheduler's machines."),
    "png": click.option("--png", is_flag=True, help="All figures as PNG too, in figures/."),
    "pdf": click.option("--pdf", is_flag=True, help="All figures as PDF too, and on paper: report.pdf."),
    "verbose": click.option("-v", "--verbose", is_flag=True, help="Say more."),
    "quiet": click.option("-q", "--quiet", is_flag=True, help="Only warnings and errors."),
}  # fmt: skip


def options_of(*names: str) -> Decorator:
    """The options of the given names, each the same in every command that takes it."""

    return lambda command: reduce(lambda decorated, name: _OPTIONS[name](decorated), reversed(names), command)


study_argument = click.argument("study", type=click.Path(path_type=Path))
stage_options = options_of("run", "set", "jobs", "dask", "verbose", "quiet")


def run_of(study: Path, options: dict[str, Any]) -> Run:
    """The run of a study under the options of a command."""
    from elastid.app.console import Console
    from elastid.app.run import Run, all_cores
    from elastid.base.execution import on_dask
    from elastid.study import load

    click.get_current_context().with_resource(on_dask(options.get("dask", "")))
    loaded = load(study, options.get("overrides", ()))
    folder = options["folder"] or Path("runs") / loaded.study.name
    console = Console(options["verbose"] - options["quiet"])
    return Run(loaded, folder, options["jobs"] or all_cores(), console)
