"""Bytes of text logs: decompression and character encoding."""

import bz2
import codecs
import gzip
import lzma
import re
from pathlib import Path
from typing import Any

from elastid.base.errors import DataError

# Compressed texts by their first bytes, and most bytes of one.
_COMPRESSED: dict[bytes, Any] = {b"\x1f\x8b": gzip, b"BZh": bz2, b"\xfd7zXZ": lzma}
_MAX_BYTES = 1 << 30


def read_bytes(path: Path, size: int = -1) -> bytes:
    """Return the first bytes of a text, decompressed; DataError for a damaged text or more than _MAX_BYTES."""
    packed = decompressor(path)
    if packed is None:
        with path.open("rb") as file:
            return file.read(size)
    try:
        with packed.open(path, "rb") as file:
            raw: bytes = file.read(_MAX_BYTES + 1 if size < 0 else size)
        if len(raw) > _MAX_BYTES:
            raise ValueError(f"more than {_MAX_BYTES / 1e9:.3g} GB")
    except Exception as error:  # of each module its own
        raise DataError("files/damaged", f"{error}. Copy it again, or decompress it", path) from error
    return raw


def decompressor(path: Path) -> Any:
    """Return the module that decompresses a text; None for a plain text."""
    with path.open("rb") as file:
        head = file.read(6)
    return next((module for mark, module in _COMPRESSED.items() if head.startswith(mark)), None)


def decode_text(raw: bytes) -> str:
    """Decode a text; bytes that its code lacks become a replacement character."""
    return raw.decode(encoding_of(raw), errors="replace").removeprefix("\ufeff")


# Japanese with at least one kana, Chinese of common signs only: byte pairs that are rare in European languages.
_ASIAN = {
    "cp932": re.compile(
        rb"(?=[\0-\x7f]*+(?:[\x81-\x9f\xe0-\xea][@-\xfc][\0-\x7f]*+)*?(?:\x82[\x9f-\xf1]|\x83[@-\x96]))"
        rb"(?:[\0-\x7f]|[\x81-\x9f\xe0-\xea][@-\xfc])*+"
    ),
    "gb2312": re.compile(rb"(?:[\0-\x7f]|[\xa1-\xa3\xb0-\xd7][\xa1-\xfe])*+"),
}


def encoding_of(raw: bytes) -> str:
    """Return the name of the code of a text: UTF-8, UTF-16 or 32, Shift-JIS, GB2312, else cp1252."""
    if wide := wide_encoding(raw):
        return wide
    try:
        raw.decode("utf-8-sig")
    except UnicodeDecodeError:
        return next((code for code, pattern in _ASIAN.items() if pattern.fullmatch(raw)), "cp1252")
    return "utf-8-sig"


# Longer marks first: the mark of UTF-32 begins with the mark of UTF-16.
_MARKS = {getattr(codecs, f"BOM_UTF{n}_{end}"): f"utf-{n}" for n in ("32", "16") for end in ("LE", "BE")}


def wide_encoding(raw: bytes) -> str:
    """Return UTF-16 or 32 by the byte order mark, UTF-16 of Latin letters also by its zeros; else an empty text."""
    by_mark = next((name for mark, name in _MARKS.items() if raw.startswith(mark)), "")
    zeros = [len(side) > 20 and side.count(0) > 0.9 * len(side) for side in (raw[1:200:2], raw[:200:2])]
    return by_mark or (("utf-16-le" if zeros[0] else "utf-16-be" if zeros[1] else "") if sum(zeros) == 1 else "")
