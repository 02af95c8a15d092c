"""records.h5, frf.h5 and modes.h5: records, frequency responses and their modes."""

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING

from elastid.base.errors import StudyError
from elastid.nonlinear.compensated_friction import CompensatedFriction
from elastid.record import Record
from elastid.response import Response, Responses
from elastid.store.artefacts import NO_STAMP, Stamp, open_artefact
from elastid.store.files import once_per_version
from elastid.store.reading import entry_names, read_dataclass, read_part, reader
from elastid.store.values import write_artefact, writer

if TYPE_CHECKING:
    from elastid.modal.modes import Modes

RECORDS, RESPONSES = "records", "frf"
# A group for each record, written one at a time, uncompressed (reading would cost twice the FFT).
write_records = writer(RECORDS, {"records": "name"}, records=(tuple[Record, ...], ()))
# A group for each configuration with G (frequency, output, input) and its covariances, and friction.
write_responses = writer(
    RESPONSES,
    {"responses": "configuration.name"},
    responses=(tuple[Response, ...], ()),
    friction=(CompensatedFriction | None, None),
)


def read_records(path: Path | str, configuration: str | None = None) -> Iterator[Record]:
    """Yield records of records.h5, of one configuration or all, one at a time; `list(read_records(path))` has all.

    DataError names the configurations that there are where it is none of them.
    """
    with open_artefact(path, RECORDS) as file:
        entries = _entries(path)
        if configuration not in (None, *(name for _, name in entries)):
            names = ", ".join(dict.fromkeys(name for _, name in entries))
            raise StudyError(
                "run/earlier-stage", f"no records of configuration {configuration}; there are {names or 'none'}", path
            )
        for entry, name in entries:
            if configuration in (None, name):
                yield read_dataclass(file["records"][entry], Record)


def read_configurations(path: Path | str) -> tuple[str, ...]:
    """List configurations in records.h5, in the order measured."""
    with open_artefact(path, RECORDS):
        return tuple(dict.fromkeys(name for _, name in _entries(path)))


@once_per_version
def _entries(path: Path) -> tuple[tuple[str, str], ...]:
    """Return names of the records and of their configurations in an intact records.h5."""
    with open_artefact(path, RECORDS) as file:
        records = file["records"]
        return tuple((name, str(records[name]["configuration"].attrs["name"])) for name in entry_names(records))


def read_responses(path: Path | str) -> Responses:
    """Read the responses in frf.h5."""
    return Responses(read_part(path, RESPONSES, "responses", tuple[Response, ...]))


# The friction that was taken out of the responses in frf.h5; None where the study asked for none.
read_friction: Callable[[Path | str], CompensatedFriction | None] = reader(
    RESPONSES, "friction", CompensatedFriction, may_miss=True
)


def write_modes(path: Path | str, modes: "tuple[Modes, ...]", stamp: Stamp = NO_STAMP) -> None:
    """Write modes.h5: the modes of each response, with shapes, synthesis and stabilisation diagram."""
    from elastid.modal.modes import Modes  # brings SciPy's linear algebra

    write_artefact(path, "modes", stamp, {"modes": (modes, tuple[Modes, ...])}, {"modes": "configuration"})


def read_modes(path: Path | str) -> "tuple[Modes, ...]":
    """Read the modes of each response in modes.h5."""
    from elastid.modal.modes import Modes  # as above

    return read_part(path, "modes", "modes", tuple[Modes, ...])
