"""The program: `elastid`, or python -m elastid. Nothing is imported before Ctrl-C has its answer."""

import gc
import sys

INTERRUPTED = 130  # as elastid.app.cli has it, which is not loaded yet


def main() -> None:
    """Run the command line; an interruption, however early or late, ends it without a traceback."""
    try:
        _end_at_a_signal()
        gc.set_threshold(20_000)  # at 700, collections take an eighth of the time of loading, and find nothing
        from elastid.app.cli import main as command_line

        command_line()
    except KeyboardInterrupt:
        sys.exit(INTERRUPTED)
    finally:
        gc.freeze()  # without a collection of all modules at the end
        # After a Ctrl-C in code made from text Python ends itself by SIGINT, unless there is other such code later.
        exec("")


def _end_at_a_signal() -> None:
    """End at once on Ctrl-C or SIGTERM, but while `elastid.app.cli` sees to it: nothing has begun, or all is done.

    Packages that load are left at once too; some of them make an error of their own of a KeyboardInterrupt.
    """
    import os
    import signal

    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda number, frame: os._exit(INTERRUPTED))


if __name__ == "__main__":
    main()
