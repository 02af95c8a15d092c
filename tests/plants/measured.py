"""Measured records, which lie beside the project; a test that needs one that is not there is skipped."""

from __future__ import annotations

from pathlib import Path

import pytest

DATA = Path(__file__).parents[3] / "shared" / "data"


def measured(name: str) -> Path:
    """Path of the measured record `name`, as in `kuka_kr300/traj_A.mat`; the test is skipped where it is absent."""
    path = DATA / name
    if not path.is_file():
        pytest.skip(f"the measured record {name} is in ../shared, which is not here")
    return path
