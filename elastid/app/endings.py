"""How a command ends: a message for whoever reads it, an exit code for programs.

0 done; 1 the data or the fit are at fault; 2 usage or study; 3 done and written, but a misfit, not to be believed as it
stands; 130 interrupted.
"""

from __future__ import annotations

import shlex
from collections.abc import Sequence
from errno import EDQUOT, EFBIG, ENOSPC
from io import StringIO

import click

from elastid.base.errors import ElastidError
from elastid.base.escape import printable

INTERRUPTED = 130


def explained(error: Exception) -> int:
    """The exit code of an error that has a message for the user; any other is a bug and raised again."""
    match error:
        case ElastidError():
            return _ended(str(error), error.exit_code)
        case click.exceptions.Exit():
            return error.exit_code
        case click.ClickException():
            shown = StringIO()
            error.show(file=shown)
            click.echo(printable(shown.getvalue()), err=True, nl=False)
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
    return _ended(f"interrupted: finished parts are kept, and `{again}` resumes from there", INTERRUPTED)


def _ended(message: str, code: int) -> int:
    click.echo(printable(message), err=True)
    return code
