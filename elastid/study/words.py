"""Words of the field in a study and in its results: where a key, or an array of a result, has a word in its text."""

from __future__ import annotations

import re
from collections.abc import Iterator
from textwrap import shorten

from elastid.fit.result import FitResult
from elastid.friction_study.result import FrictionResult
from elastid.record import Record
from elastid.response import FrequencyResponse
from elastid.store.kinds import fields_of, kind_of_annotation
from elastid.study.reference import every_key
from elastid.validation.results import Validation

# The values whose arrays are looked through, by the file of a run that has them.
_RESULTS = {
    "records.h5": Record, "frf.h5": FrequencyResponse, "fit.h5": FitResult, "validation.h5": Validation,
    "friction.h5": FrictionResult,
}  # fmt: skip


def explain_word(word: str) -> str:
    """The keys with a word in their text, then the results, a line each; empty where neither has it."""
    has_it = re.compile(rf"\b{re.escape(word)}", re.IGNORECASE)
    keys = {key.path: key.text for key in every_key() if has_it.search(f"{key.text} {key.advice}")}
    results = {
        path: text for file, kind in _RESULTS.items() for path, text in _fields(file, kind) if has_it.search(text)
    }
    parts = []
    for title, found in (("Keys of a study", keys), ("In the results (`elastid inspect FILE`)", results)):
        if found:
            lines = [
                f"  {path}: {shorten(text, max(100 - len(path), 40), placeholder=' ...')}"
                for path, text in found.items()
            ]
            parts.append("\n".join([f"{title} with {word}:", *lines]))
    return "\n\n".join(parts)


def _fields(path: str, annotation: object) -> Iterator[tuple[str, str]]:
    """The place and text of each labelled field of a value and of those below it."""
    kind = kind_of_annotation(annotation)
    if kind.form != "fields":
        for part in kind.parts:
            yield from _fields(path, part)
        return
    for field in fields_of(kind.type):
        name = f"{path}{'/' if ' ' in path else ' '}{field.name}"
        if field.label.text:
            yield name, f"{field.name.replace('_', ' ')}: {field.label.text}"
        yield from _fields(name, field.annotation)
