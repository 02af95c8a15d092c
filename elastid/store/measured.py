"""Measured data in files: records.h5, frequency responses (frf.h5) and their modes (modes.h5)."""

from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

from elastid.base.errors import StudyError
from elastid.nonlinear.compensated_friction import CompensatedFriction
from elastid.record import Record
from elastid.response import Response, Responses
from elastid.store.artefacts import NO_STAMP, Stamp, open_artefact
from elastid.store.files import once_per_version
from elastid.store.reading import entry_names, read_dataclass, read_part
from elastid.store.writing import write_artefact, writer

if TYPE_CHECKING:
    from elastid.modal.modes import Modes

RECORDS, RESPONSES = "records", "frf"
# A group for each record, uncompressed: decompression would take twice as long as the FFT.
write_records = writer(RECORDS, {"records": "name"}, records=(tuple[Record, ...], ()))
# A group for each configuration with G (F, n_y, n_u) and its covariances, and compensated friction.
write_responses = writer(
    RESPONSES,
    {"responses": "configuration.name"},
    responses=(tuple[Response, ...], ()),
    friction=(CompensatedFriction | None, None),
)


def read_records(path: Path | str, configuration: str | None = None) -> Iterator[Record]:
    """Yield the records of one configuration or of all; StudyError for an unknown configuration."""
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
    """List the configurations in records.h5, in the order of measurement."""
    with open_artefact(path, RECORDS):
        return tuple(dict.fromkeys(name for _, name in _entries(path)))


@once_per_version
def _entries(path: Path | str) -> tuple[tuple[str, str], ...]:
    """Return the name of each record and the name of its configuration."""
    with open_artefact(path, RECORDS) as file:
        records = file["records"]
        return tuple((name, str(records[name]["configuration"].attrs["name"])) for name in entry_names(records))


def read_responses(path: Path | str) -> Responses:
    """Read the responses in frf.h5."""
    return Responses(read_part(path, RESPONSES, "responses", tuple[Response, ...]))


def read_friction(path: Path | str) -> CompensatedFriction | None:
    """Read the friction that was compensated in the responses of frf.h5; None without it or without the file."""
    friction = CompensatedFriction | None
    return read_part(path, RESPONSES, "friction", friction) if Path(path).is_file() else None  # type: ignore[arg-type]


def write_modes(path: Path | str, modes: "tuple[Modes, ...]", stamp: Stamp = NO_STAMP) -> None:
    """Write modes.h5: the modes of each response, with shapes, synthesis and stabilisation diagram."""
    from elastid.modal.modes import Modes  # a slow import: SciPy's linear algebra

    write_artefact(path, "modes", stamp, {"modes": (modes, tuple[Modes, ...])}, {"modes": "configuration"})


def read_modes(path: Path | str) -> "tuple[Modes, ...]":
    """Read the modes of each response in modes.h5."""
    from elastid.modal.modes import Modes

    return read_part(path, "modes", "modes", tuple[Modes, ...])
