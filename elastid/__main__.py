"""The program: `elastid`, or python -m elastid. Nothing is imported before Ctrl-C has its answer."""

import sys


def main() -> None:
    """The command line, ended without a traceback however early it is interrupted."""
    try:
        from elastid.app.cli import main as command_line

        command_line()
    except KeyboardInterrupt:
        sys.exit(130)  # as elastid.app.endings has it


if __name__ == "__main__":
    main()
