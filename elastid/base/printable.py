"""Text that a terminal shows and does not obey."""

from __future__ import annotations

import re

# Control characters but tab and line feed, half characters (surrogates), and what turns the direction of writing.
_NOT_SHOWN = re.compile("[\x00-\x08\x0b-\x1f\x7f-\x9f\ud800-\udfff\u202a-\u202e\u2066-\u2069]")


def printable(text: str) -> str:
    r"""The text with its control characters written out, so that a name in a file cannot steer the terminal.

    >>> printable("red \x1b[31m")
    'red \\x1b[31m'
    """
    return _NOT_SHOWN.sub(lambda found: found[0].encode("unicode_escape").decode(), text)
