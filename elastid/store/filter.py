"""filter.h5: friction followed over the motions of joints."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from elastid.friction_study.follow import FollowedFriction
from elastid.store.files import NO_STAMP, Stamp, created, opened
from elastid.store.values import read_dataclass, write_value

FILTER = "filter"


def write_filter(path: Path, joints: Sequence[FollowedFriction], stamp: Stamp = NO_STAMP) -> None:
    """A group each joint."""
    with created(path, FILTER, stamp) as file:
        write_value(file, "joints", tuple(joints))


def read_filter(path: Path | str) -> tuple[FollowedFriction, ...]:
    """The joints in filter.h5."""
    with opened(path, FILTER) as file:
        return tuple(
            read_dataclass(file["joints"], str(i), FollowedFriction) for i in range(int(file["joints"].attrs["length"]))
        )
