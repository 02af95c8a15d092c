"""Output of a run on the terminal: messages, warnings, tables and progress; all except progress also in run.log."""

import logging
import sys
import time
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager, suppress
from io import TextIOWrapper
from pathlib import Path
from typing import TYPE_CHECKING

from elastid.base.display import Display, number
from elastid.base.errors import Note, group_notes
from elastid.base.escape import printable
from elastid.base.execution import Progress, no_progress
from elastid.base.files import open_regular_file

if TYPE_CHECKING:
    from elastid.friction_study.result import FrictionNumber
    from elastid.report.parameter_row import ParameterRow


class Console:
    """Terminal and log of a run.  verbosity: -2 log only, -1 warnings, 0 a few messages per stage, 1 all details."""

    def __init__(self, verbosity: int = 0) -> None:
        self.verbosity = verbosity
        self.shows_tables = True
        self._warned: set[str] = set()
        self._log = logging.getLogger("elastid.app.run")
        self._log.propagate = False
        self._log.setLevel(logging.DEBUG)
        if not self._log.handlers:  # without a handler Python prints warnings
            self._log.addHandler(logging.NullHandler())

    @contextmanager
    def logging_to(self, folder: Path) -> Iterator[None]:
        """Append messages and warnings of Python to run.log in the folder."""
        folder.mkdir(parents=True, exist_ok=True)
        handler = _LogFile(folder / "run.log", encoding="utf-8", errors="backslashreplace")
        handler.setFormatter(logging.Formatter("%(asctime)s %(levelname)-7s %(message)s"))
        python_warnings = logging.getLogger("py.warnings")
        python_warnings.propagate = False
        loggers = (self._log, python_warnings)
        for logger in loggers:
            logger.addHandler(handler)
        logging.captureWarnings(True)
        try:
            yield
        finally:
            logging.captureWarnings(False)
            for logger in loggers:
                logger.removeHandler(handler)
            handler.close()

    def say(self, text: str) -> None:
        """Report work that was done."""
        self._log.info(text)
        if self.verbosity >= 0:
            print(printable(text), flush=True)

    def detail(self, text: str) -> None:
        """Report a detail, shown at -v."""
        self._log.debug(text)
        if self.verbosity >= 1:
            print(f"  {printable(text)}", flush=True)

    def warn(self, text: str) -> None:
        """Print a warning; the same text only once."""
        if text in self._warned:
            return
        self._warned.add(text)
        self._log.warning(text)
        if self.verbosity >= -1:
            print(f"warning: {printable(text)}", file=sys.stderr, flush=True)

    def notes(self, notes: Iterable[Note], on_page: bool = False) -> None:
        """Print notes, equal notes as one; on_page: True if the report page contains them, too."""
        for group in group_notes(notes):
            (self.warn if group.first.severity == "warning" else self.detail if on_page else self.say)(str(group))

    def log(self, text: str) -> None:
        """Log the end of the work, which the command itself prints on the terminal."""
        self._log.error(text)

    def table(self, rows: Sequence[Sequence[str]]) -> None:
        """Print headings and rows in columns, numbers right-aligned; during a run of all stages only to the log."""
        widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
        for row in rows:
            cells = [c.ljust(w) if i < 2 else c.rjust(w) for i, (c, w) in enumerate(zip(row, widths, strict=True))]
            line = "  ".join(cells).rstrip()
            self._log.info(line)
            if self.verbosity >= 0 and self.shows_tables:
                print(printable(line), flush=True)

    @contextmanager
    def progress(self, title: str) -> Iterator[Progress]:
        """Show a bar with the remaining time on a terminal, otherwise a message from time to time."""
        if self.verbosity < 0:
            yield no_progress
        elif sys.stderr.isatty():
            with _progress_bar(title) as progress:
                yield progress
        else:
            yield _progress_messages(title)


class _LogFile(logging.FileHandler):
    """run.log, with control characters escaped.

    On a full disk its messages are lost; the error names the result that cannot be written.
    """

    def format(self, record: logging.LogRecord) -> str:
        """Format a message and escape its control characters."""
        return printable(super().format(record))

    def _open(self) -> TextIOWrapper:
        """Open the log; ElastidError if it is a link."""
        return open(self.baseFilename, "a", encoding="utf-8", errors=self.errors, opener=open_regular_file)

    def handleError(self, record: logging.LogRecord) -> None:
        """Ignore an error of the log, so that the work continues."""

    def close(self) -> None:
        """Close the log; ignore an error such as a full disk, which would hide the error that ended the work."""
        with suppress(OSError):
            super().close()


MIN_DONE = 3  # finished items before the remaining time is estimated


@contextmanager
def _progress_bar(title: str) -> Iterator[Progress]:
    from rich.console import Console as Terminal
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, Task, TextColumn, TimeRemainingColumn
    from rich.text import Text

    class Remaining(TimeRemainingColumn):
        """Remaining time, empty before `MIN_DONE` items."""

        def render(self, task: Task) -> Text:
            return super().render(task) if task.completed >= MIN_DONE else Text("")

    columns = (TextColumn("{task.description}", markup=False), BarColumn(), MofNCompleteColumn(), Remaining())
    with Progress(*columns, console=Terminal(stderr=True), transient=True) as progress_bar:
        task = progress_bar.add_task(printable(title), total=None)
        yield lambda done, total: progress_bar.update(task, completed=done, total=total)


INTERVAL_S = 10.0  # between two lines of progress


def _progress_messages(title: str) -> Progress:
    start = last = time.monotonic()

    def progress(done: int, total: int) -> None:
        nonlocal last, start
        now = time.monotonic()
        if done == 0:  # preparations before the first item do not count
            start = now
        if now - last >= INTERVAL_S and 0 < done < total:
            last = now
            remaining = f", about {(now - start) / done * (total - done):.0f} s to go" if done >= MIN_DONE else ""
            print(f"{printable(title)}: {done} of {total} done{remaining}", file=sys.stderr, flush=True)

    return progress


def result_table(display: Display, rows: "Sequence[ParameterRow | FrictionNumber]") -> list[list[str]]:
    """Return headings and rows of a result, with true values if the rig is simulated."""
    simulated = any(row.truth is not None for row in rows)
    return [
        [*display.headings, *["true"] * simulated],
        *([*cells, *[number(row.truth)] * simulated] for cells, row in zip(display.rows, rows, strict=True)),
    ]
