"""What is in a log of another program or in a result of elastid: names, shapes, units, rates."""

from __future__ import annotations

from pathlib import Path

from elastid.base.errors import StudyError
from elastid.experiment.specs.recorded import TextFormatSpec
from elastid.recorded.files.formats import contents
from elastid.recorded.files.text import described_format, guess_format
from elastid.recorded.responses.reading import contents_of
from elastid.recorded.responses.uff import is_universal_file
from elastid.store import described as described_artefact
from elastid.store import kind_of


def described(path: Path) -> str:
    """A page of plain text; StudyError where the file is not there, DataError where it cannot be read."""
    if not path.is_file():
        raise StudyError(f"{path}: no such file")
    if kind_of(path) is not None:
        return described_artefact(path)
    responses, lines = contents_of(path), []
    if responses:
        lines = [f"{path}: {len(responses)} frequency responses; list the file under experiment.responses.files"]
        lines += [f"  {response}" for response in responses]
    if not is_universal_file(path):
        text = guess_format(path)
        signals = contents(path, text)
        width = max(map(len, signals), default=0)
        lines.append(f"{path}: {len(signals)} signals; name them as `channel` in experiment.recorded.channels")
        if text != TextFormatSpec():
            lines.append(f"  its numbers are written with {described_format(text)}")
        lines += [f"  {name.ljust(width)}  {_shape(shape)}" for name, shape in signals.items()]
    return "\n".join(lines)


def _shape(shape: tuple[int, ...]) -> str:
    return " x ".join(map(str, shape)) or "one number"
