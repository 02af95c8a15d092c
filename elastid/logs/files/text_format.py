"""The format of a text log, delimiter and decimal, guessed by the numbers that its last lines have with it."""

from itertools import starmap
from pathlib import Path
from typing import Literal

from elastid.experiment.specs.logs import TextFormatSpec
from elastid.logs.files.cells import is_number, plain_numbers, split_line
from elastid.logs.files.encodings import decode_text, read_bytes

# The usual delimiters and decimals of numbers in columns, the most usual first.
_DECIMALS: tuple[Literal[".", ","], ...] = (".", ",")
_FORMATS = [(sign, mark) for sign in (",", ";", "tab", "whitespace", "|") for mark in _DECIMALS if mark != sign]
HEAD_BYTES = 1 << 16  # of a large text, which show its code
FORMAT_HINT = "; it seems to be written with "


def guess_format(path: Path) -> TextFormatSpec:
    """Guess the format of a text log: the delimiter and decimal with which most of its fields are numbers."""
    return TextFormatSpec() if path.is_dir() else _best_format(path)[1]


def _best_format(path: Path) -> tuple[int, TextFormatSpec]:
    raw = read_bytes(path, HEAD_BYTES)
    lines = decode_text(raw).splitlines()
    lines = lines[-21:-1] if len(raw) == HEAD_BYTES else lines[-20:]  # the last of 64 KiB may be cut

    def numeric_score(text: TextFormatSpec) -> int:
        plain = plain_numbers("\n".join(lines), text).splitlines()
        fields = [field for line in plain for field in split_line(line, text) if field]
        return sum(1 if is_number(field) else -1 for field in fields)

    return max([(numeric_score(text), text) for text in starmap(TextFormatSpec, _FORMATS)], key=lambda pair: pair[0])


def format_hint(path: Path, text: TextFormatSpec) -> str:
    """Return the end of a message on an unreadable log: the format that it seems to have, if another."""
    surplus, seems = _best_format(path)
    if surplus <= 0 or (seems.delimiter, seems.decimal) == (text.delimiter, text.decimal):
        return ""
    return f"{FORMAT_HINT}{describe_format(seems)}"


def describe_format(text: TextFormatSpec) -> str:
    """Return a format as a study states it."""
    return f"text: {{delimiter: '{text.delimiter}', decimal: '{text.decimal}'}}"
