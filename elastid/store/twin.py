"""The torque of logs part by part, and the twin moved along them, in validation.h5 or friction.h5."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from elastid.store.files import opened
from elastid.store.values import read_dataclass, write_value
from elastid.validation.twin_run import NO_TWIN, TwinFindings

# Beside the groups of the configurations, whose names are escaped: none begins with %.
_GROUP = "%twin"


def write_twin(file: Any, found: TwinFindings) -> None:
    """A group with an entry for each."""
    write_value(file, _GROUP, found)


def read_twin(path: Path | str, kind: str) -> TwinFindings:
    """Those in a file of a kind (validation, friction); none where the study has none."""
    with opened(path, kind) as file:
        return read_dataclass(file, _GROUP, TwinFindings) if _GROUP in file else NO_TWIN
