"""Options, arguments and context of commands: the run that they ask for, Ctrl-C that libraries cannot swallow."""

import math
import os
import sys
from _thread import interrupt_main
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import reduce
from pathlib import Path
from signal import SIGINT, SIGTERM, signal
from threading import Event, Thread, current_thread, main_thread
from types import FrameType
from typing import TYPE_CHECKING, Any, TypeAlias

import click

if TYPE_CHECKING:
    from elastid.app.run import Run


Decorator: TypeAlias = Callable[[Callable[..., Any]], Callable[..., Any]]


class Finite(click.FloatRange):
    """A finite number in a range, which nan is in of itself."""

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """Return the number; raise the usage error of click for nan and inf."""
        number = super().convert(value, param, ctx)
        if not math.isfinite(number):
            self.fail(f"{value} is not a finite number.", param, ctx)
        return number


FILE = click.Path(path_type=Path)
POSITIVE = Finite(min=0, min_open=True)
RATE = Finite(min=0, max=1e5, min_open=True)


def numbers_of(ctx: click.Context, param: click.Parameter, text: str | None) -> tuple[float, ...]:
    """Parse finite numbers of at least 0, separated by commas; none without the option."""
    return tuple(Finite(min=0).convert(word, param, ctx) for word in (text or "").split(",") if word.strip())


class Folder(click.Path):
    """A path that is not empty, which would be the working folder."""

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """Return the path; raise the usage error of click for an empty text."""
        if not str(value).strip():
            self.fail("an empty name", param, ctx)
        return super().convert(value, param, ctx)


_OPTIONS: dict[str, Decorator] = {
    "run": click.option(
        *("--run", "folder"), type=Folder(path_type=Path), metavar="DIR",
        help="Folder of the results (default: runs/<name of the study>)."
    ),
    "set": click.option(
        *("--set", "overrides"), multiple=True, metavar="KEY.PATH=VALUE",
        help="Override a key of the study, for example fit.starts=5."
    ),
    "jobs": click.option("--jobs", type=click.IntRange(min=1), metavar="N", help="Processes (default: all cores)."),
    "with": click.option(
        *("--with", "source"), type=FILE, metavar="RUN",
        help="Run folder with identified friction or elasticity, or its friction.h5 or fit.h5. The first argument is "
        "then the study whose torques are predicted."
    ),
    "log": click.option(
        *("--log", "logs"), type=FILE, multiple=True, metavar="FILE",
        help="Log file; replaces the logs of a study. Repeat the option for several logs."
    ),
    "dask": click.option("--dask", metavar="ADDRESS", default="", help="Run on the workers of this Dask scheduler."),
    "png": click.option("--png", is_flag=True, help="Write the figures as PNG into figures/, too."),
    "verbose": click.option("-v", "--verbose", is_flag=True, help="Print details."),
    "quiet": click.option("-q", "--quiet", is_flag=True, help="Print warnings and errors only.")
}  # fmt: skip


def options_of(*names: str) -> Decorator:
    """Add the options of the given names, each the same in every command that has it."""

    return lambda command: reduce(lambda decorated, name: _OPTIONS[name](decorated), reversed(names), command)


study_argument = click.argument("study", type=FILE)
stage_options = options_of("run", "set", "jobs", "dask", "verbose", "quiet")


def run_of(study: Path, options: dict[str, Any]) -> "Run":
    """Return the run of a study, and remove its options from the options of a command."""
    from elastid.app.console import Console
    from elastid.app.run import Run, all_cores
    from elastid.base.dask_cluster import on_dask
    from elastid.study import load

    click.get_current_context().with_resource(on_dask(options.pop("dask", "")))
    loaded, folder = load(study, options.pop("overrides", ())), options.pop("folder")
    console = Console(options.pop("verbose") - options.pop("quiet"))
    return Run(loaded, folder or Path("runs") / loaded.study.name, options.pop("jobs") or all_cores(), console)


@contextmanager
def insisting() -> Iterator[Event]:
    """Raise KeyboardInterrupt on Ctrl-C or SIGTERM, and every half second until the work inside has ended.

    CasADi's wrappers swallow a KeyboardInterrupt that falls into them, or make an error of another kind of it. The
    event that is yielded is set once that happened: whatever error ends the work then, the user has ended it.
    """
    pressed, ended = Event(), Event()

    def insist() -> None:
        while not ended.wait(0.5):
            interrupt_main()

    def interrupt(number: int, frame: FrameType | None) -> None:
        if os.isatty(2):
            os.write(2, b"\x1b[?25h")  # the cursor, which a progress bar that ends here may leave hidden
        if not pressed.is_set():
            pressed.set()
            Thread(target=insist, daemon=True).start()
        raise KeyboardInterrupt

    def show(unraisable: "sys.UnraisableHookArgs") -> None:
        if not pressed.is_set():
            hook(unraisable)

    if current_thread() is not main_thread():  # signals belong to the main thread
        yield pressed
        return
    # Python prints the traceback of a KeyboardInterrupt that falls into a destructor, and goes on; it comes again.
    hook, sys.unraisablehook = sys.unraisablehook, show
    before = {number: signal(number, interrupt) for number in (SIGINT, SIGTERM)}
    try:
        yield pressed
    finally:
        ended.set()
        sys.unraisablehook = hook
        for number, handler in before.items():
            signal(number, handler)


@contextmanager
def libraries_off_terminal() -> Iterator[None]:
    """Send warnings of Python and log records of libraries to run.log only, or nowhere without one."""
    import logging

    nowhere = logging.NullHandler()  # without any handler Python prints the records
    logging.captureWarnings(True)
    logging.getLogger().addHandler(nowhere)
    try:
        yield
    finally:
        logging.getLogger().removeHandler(nowhere)
        logging.captureWarnings(False)
