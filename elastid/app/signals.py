"""Context of a command: Ctrl-C that libraries cannot swallow, and their words off the terminal."""

from __future__ import annotations

import sys
from _thread import interrupt_main
from collections.abc import Iterator
from contextlib import contextmanager
from signal import SIGINT, SIGTERM, signal
from threading import Event, Thread, current_thread, main_thread
from types import FrameType


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
