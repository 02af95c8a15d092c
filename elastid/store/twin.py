"""The torque of logs part by part, in validation.h5 or friction.h5."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from elastid.store.files import opened
from elastid.store.values import read_value, write_value
from elastid.validation.twin import TorqueBalance

# Beside the groups of the configurations, whose names are escaped: none begins with %.
_GROUP = "%torque"


def write_balances(file: Any, balances: Sequence[TorqueBalance]) -> None:
    """A group with an entry for each."""
    write_value(file, _GROUP, tuple(balances))


def read_balances(path: Path, kind: str) -> tuple[TorqueBalance, ...]:
    """Those in a file of a kind (validation, friction); none where the study has none."""
    with opened(path, kind) as file:
        if _GROUP not in file:
            return ()
        found: tuple[TorqueBalance, ...] = read_value(file, _GROUP, tuple[TorqueBalance, ...])
        return found
