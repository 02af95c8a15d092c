"""records.h5 and frf.h5: the records of a measurement, and the frequency responses estimated from them."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path

from elastid.base.errors import DataError, check_kind
from elastid.nonlinear.result import FrictionTakenOut
from elastid.record import Record
from elastid.response import FrequencyResponse
from elastid.store.artefacts import NO_STAMP, Stamp, opened
from elastid.store.reading import entry_names, read_dataclass, read_optional_part, read_part
from elastid.store.values import write_artefact

RECORDS, RESPONSES = "records", "frf"


def write_records(path: Path | str, records: Iterable[Record], stamp: Stamp = NO_STAMP) -> None:
    """records.h5: a group for each record, written one at a time, uncompressed (reading would cost twice the FFT)."""
    write_artefact(path, RECORDS, stamp, {"records": (records, tuple[Record, ...])}, {"records": "name"})


def read_records(path: Path | str, configuration: str | None = None) -> Iterator[Record]:
    """The records in records.h5, of one configuration or all, one at a time: `list(read_records(path))` holds all.

    DataError names the configurations that there are where it is none of them.
    """
    with opened(path, RECORDS) as file:
        groups = [file["records"][name] for name in entry_names(file["records"])]
        names = [str(group["configuration"].attrs["name"]) for group in groups]
        if configuration not in (None, *names):
            known = ", ".join(dict.fromkeys(names))
            raise DataError(f"{path}: no records of configuration {configuration}; there are {known or 'none'}")
        for group, name in zip(groups, names, strict=True):
            if configuration in (None, name):
                yield read_dataclass(group, Record)


def read_configurations(path: Path | str) -> tuple[str, ...]:
    """The names of the configurations in records.h5, in the order measured."""
    with opened(path, RECORDS) as file:
        groups = (file["records"][name] for name in entry_names(file["records"]))
        return tuple(dict.fromkeys(str(group["configuration"].attrs["name"]) for group in groups))


def write_responses(
    path: Path | str,
    responses: Sequence[FrequencyResponse],
    stamp: Stamp = NO_STAMP,
    friction: FrictionTakenOut | None = None,
) -> None:
    """frf.h5: a group for each configuration with G (frequency, output, input) and its covariances, and friction."""
    check_kind(responses, Sequence, "responses", "give a sequence of FrequencyResponse, such as [response]")
    parts = {
        "friction": (friction, FrictionTakenOut | None),
        "responses": (responses, tuple[FrequencyResponse, ...]),
    }
    write_artefact(path, RESPONSES, stamp, parts, {"responses": "configuration.name"})


def read_responses(path: Path | str) -> tuple[FrequencyResponse, ...]:
    """The responses in frf.h5."""
    return read_part(path, RESPONSES, "responses", tuple[FrequencyResponse, ...])


def read_friction(path: Path | str) -> FrictionTakenOut | None:
    """The friction that was taken out of the responses in frf.h5; None where the study asked for none."""
    return read_optional_part(path, RESPONSES, "friction", FrictionTakenOut)
