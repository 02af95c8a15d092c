"""Options and arguments of commands, the run that they request, and the handling of Ctrl-C and library messages."""

import math
import os
import sys
from _thread import interrupt_main
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import reduce
from pathlib import Path
from pkgutil import resolve_name
from signal import SIGINT, SIGTERM, signal
from threading import Event, Thread, current_thread, main_thread
from types import FrameType
from typing import TYPE_CHECKING, Any, TypeAlias

import click

if TYPE_CHECKING:
    from elastid.app.run import Run


Decorator: TypeAlias = Callable[[Callable[..., Any]], Callable[..., Any]]


class Finite(click.FloatRange):
    """Range of finite numbers; click accepts nan in any range."""

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
    """Path that is not empty; an empty path would be the working folder."""

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
    """Return the decorator that adds these options to a command."""

    return lambda command: reduce(lambda decorated, name: _OPTIONS[name](decorated), reversed(names), command)


study_argument = click.argument("study", type=FILE)
stage_options = options_of("run", "set", "jobs", "dask", "verbose", "quiet")


def run_of(study: Path, options: dict[str, Any]) -> "Run":
    """Return the run of a study, and remove the options of the run from the options of a command."""
    from elastid.app.console import Console
    from elastid.app.run import Run, all_cores
    from elastid.base.dask_cluster import on_dask
    from elastid.study import load

    click.get_current_context().with_resource(on_dask(options.pop("dask", "")))
    loaded, folder = load(study, options.pop("overrides", ())), options.pop("folder")
    console = Console(options.pop("verbose") - options.pop("quiet"))
    return Run(loaded, folder or Path("runs") / loaded.study.name, options.pop("jobs") or all_cores(), console)


def call_with_run(function: str, study: Path, options: dict[str, Any], *arguments: Any) -> None:
    """Call a function `module:name` of `elastid.app` with the run of a study, arguments and the other options."""
    resolve_name(f"elastid.app.{function}")(run_of(study, options), *arguments, **options)


@contextmanager
def repeated_interrupts() -> Iterator[Event]:
    """Raise KeyboardInterrupt on Ctrl-C or SIGTERM, and again every half second until the work inside has ended.

    CasADi's wrappers suppress a KeyboardInterrupt or convert it to another error. The yielded event is set after the
    first interrupt: any later error then means that the user has ended the work.
    """
    pressed, ended = Event(), Event()

    def repeat() -> None:
        while not ended.wait(0.5):
            interrupt_main()

    def interrupt(number: int, frame: FrameType | None) -> None:
        if os.isatty(2):
            os.write(2, b"\x1b[?25h")  # show the cursor, which an interrupted progress bar hides
        if not pressed.is_set():
            pressed.set()
            Thread(target=repeat, daemon=True).start()
        raise KeyboardInterrupt

    def report(unraisable: "sys.UnraisableHookArgs") -> None:
        if not pressed.is_set():
            hook(unraisable)

    if current_thread() is not main_thread():  # signals belong to the main thread
        yield pressed
        return
    # Python prints and ignores a KeyboardInterrupt in a destructor; the interrupt is repeated anyway.
    hook, sys.unraisablehook = sys.unraisablehook, report
    old_handlers = {number: signal(number, interrupt) for number in (SIGINT, SIGTERM)}
    try:
        yield pressed
    finally:
        ended.set()
        sys.unraisablehook = hook
        for number, handler in old_handlers.items():
            signal(number, handler)


@contextmanager
def libraries_off_terminal() -> Iterator[None]:
    """Send warnings of Python and log messages of libraries to run.log only; without run.log they are dropped."""
    import logging

    nowhere = logging.NullHandler()  # without a handler Python prints the messages
    logging.captureWarnings(True)
    logging.getLogger().addHandler(nowhere)
    try:
        yield
    finally:
        logging.getLogger().removeHandler(nowhere)
        logging.captureWarnings(False)
