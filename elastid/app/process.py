"""The process: Ctrl-C or a request to end that interrupts any code, one BLAS thread, exit codes with their messages.

Exit codes: 0 done; 1 the data or the fit are at fault; 2 usage or study; 3 done and written, but a misfit, not to be
believed as it stands; 130 interrupted.
"""

from __future__ import annotations

import os
import shlex
import sys
from _thread import interrupt_main
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from errno import EDQUOT, EFBIG, ENOSPC
from io import StringIO
from signal import SIGINT, SIGTERM, signal
from threading import Event, Thread, current_thread, main_thread
from types import FrameType

import click

from elastid.base.errors import ElastidError
from elastid.base.escape import printable


@contextmanager
def insisting() -> Iterator[Event]:
    """KeyboardInterrupt on Ctrl-C or SIGTERM, and again every half second until the work inside has ended.

    CasADi's wrappers swallow a KeyboardInterrupt that falls into them, or make an error of another kind of it. The
    event that is yielded is set once that happened: whatever error ends the work then, the user has ended it.
    """
    pressed, ended = Event(), Event()

    def insist() -> None:
        while not ended.wait(0.5):
            interrupt_main()

    def interrupt(number: int, frame: FrameType | None) -> None:
        if not pressed.is_set():
            pressed.set()
            Thread(target=insist, daemon=True).start()
        raise KeyboardInterrupt

    def show(unraisable: sys.UnraisableHookArgs) -> None:
        if not pressed.is_set():
            shown(unraisable)

    if current_thread() is not main_thread():  # signals belong to the main thread
        yield pressed
        return
    # Python prints the traceback of a KeyboardInterrupt that falls into a destructor, and goes on; it comes again.
    shown, sys.unraisablehook = sys.unraisablehook, show
    before = {number: signal(number, interrupt) for number in (SIGINT, SIGTERM)}
    try:
        yield pressed
    finally:
        ended.set()
        sys.unraisablehook = shown
        for number, handler in before.items():
            signal(number, handler)


@contextmanager
def libraries_off_terminal() -> Iterator[None]:
    """Warnings of Python and log records of libraries go to run.log where one is written, and else nowhere."""
    import logging

    nowhere = logging.NullHandler()  # without any handler Python prints the records
    logging.captureWarnings(True)
    logging.getLogger().addHandler(nowhere)
    try:
        yield
    finally:
        logging.getLogger().removeHandler(nowhere)
        logging.captureWarnings(False)


def one_blas_thread() -> None:
    """Ask every BLAS that is loaded from here on, in this process and its workers, for one thread."""
    for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "VECLIB_MAXIMUM_THREADS"):
        os.environ.setdefault(name, "1")


def explained(error: Exception) -> int:
    """The exit code of an error that has a message for the user; any other is a bug and raised again."""
    match error:
        case ElastidError():
            return _ended(str(error), error.exit_code)
        case click.exceptions.Exit():
            return error.exit_code
        case click.ClickException():
            message_text = StringIO()
            error.show(file=message_text)
            click.echo(printable(message_text.getvalue()), err=True, nl=False)
            return error.exit_code
        case MemoryError():
            return _ended(f"the study asks for more memory than there is ({error}); shorten its records", 2)
        case OSError():
            where = f"{error.filename}: " if error.filename else ""
            full = error.errno in (ENOSPC, EDQUOT, EFBIG)
            advice = "; make room, and the same command goes on where it was" if full else ""
            return _ended(f"{where}{error.strerror or error}{advice}", 1)
    raise error


def interrupted(arguments: Sequence[str]) -> int:
    """The exit code of a command that was interrupted, which says how to go on."""
    again = shlex.join(["elastid", *arguments])
    return _ended(f"interrupted: finished parts are kept, and `{again}` resumes from there", 130)


def _ended(message: str, code: int) -> int:
    click.echo(printable(message), err=True)
    return code
