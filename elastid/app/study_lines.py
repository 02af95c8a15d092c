"""YAML lines of a study for `elastid new --from`: head, channels, files; guesses are marked with their reason."""

import json
import os
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path

from elastid.base.escape import one_line
from elastid.logs.channel_names import ChannelGuess

DRIVE_UNIT = {"torque": "N*m", "force": "N", "current": "A", "voltage": "V"}


def head_lines(kind: str, first: Path) -> Iterator[str]:
    """Yield the head of a study that is named by its kind; first: the first log."""
    yield "# yaml-language-server: $schema=study.schema.json"
    yield f"# Written by `elastid new --from` from {one_line(first.name)}. Check the lines marked `guessed`, then"
    yield "# `elastid check study.yml` and `elastid run study.yml`"
    yield f"name: {kind}"


def join_lines(lines: Iterable[str]) -> str:
    """Join lines that are not empty."""
    return "\n".join(filter(None, lines)) + "\n"


def relative_paths(paths: Sequence[Path], folder: Path) -> list[str]:
    """Return paths relative to a folder."""
    return [Path(os.path.relpath(path.resolve(), folder.resolve())).as_posix() for path in paths]


def quote(text: str) -> str:
    """Quote a text for YAML unless it is a plain word."""
    is_plain = re.fullmatch(r"(?!(?i:null|true|false|yes|no|on|off)$)[A-Za-z]\w*([. ]\w+)*", text)
    return text if is_plain else json.dumps(text, ensure_ascii=False)


def channel_line(role: str, place: str, guess: ChannelGuess, drive: str = "") -> str:
    """Return the YAML line of a channel. drive: `torque` or `force`, the quantity of a robot's drive; else empty."""
    quantity, scale, why = guess.quantity, guess.scale, guess.why
    unit = guess.unit or DRIVE_UNIT.get(quantity, "")
    keys: dict[str, object] = {
        "role": role, "at": quote(place), "channel": quote(guess.name) if guess.name else None, "column": guess.column
    }  # fmt: skip
    if drive and quantity in ("voltage", "torque", "force") and quantity != drive:
        why = f"{why} a {quantity}; scale is the {DRIVE_UNIT[drive]} of one {unit}"
        keys |= {"quantity": drive, "unit": DRIVE_UNIT[drive], "scale": 1}
    else:
        keys |= {"quantity": quantity, "unit": unit, "scale": f"{scale:g}" if scale != 1 else None}
    if drive and quantity == "current":
        keys["torque_constant"] = "1 N*m/A"
        why = f"{why}; torque_constant is that of your motor's data sheet"
    keys |= {
        "rate_hz": guess.rate_hz, "file": guess.file if guess.file > 1 else None,
        "sign": -1 if guess.sign < 0 else None, "side": "motor" if guess.ratio != 1 else None,
    }  # fmt: skip
    return f"      - {mapping(keys)} # guessed: {one_line(why)}"


def file_line(path: str, **keys: object) -> str:
    """Return the YAML line of a file with its keys."""
    return f"      - {mapping({'path': quote(path), **keys})}"


def mapping(keys: Mapping[str, object]) -> str:
    """Return a YAML mapping in one line, without keys that have no value."""
    return f"{{{', '.join(f'{key}: {value}' for key, value in keys.items() if value is not None)}}}"
