"""Measured records, which lie beside the project; a test that needs one that is not there is skipped."""

import re
from pathlib import Path

import pytest

DATA = Path(__file__).parents[3] / "shared" / "data"
EMPS, EMPS_PULSES = "emps_prismatic_axis/DATA_EMPS.mat", "emps_prismatic_axis/DATA_EMPS_PULSES.mat"
BENCH = "motorbench_two_inertia/MultisineTypeA.mat"
KUKA = "kuka_kr300/traj_A.mat"
ARM = "daisy_robot_arm/robot_arm_dat.mat"


def measured(name: str) -> Path:
    """Path of a measured record; the test is skipped where it is absent."""
    path = DATA / name
    if not path.is_file():
        pytest.skip(f"the measured record {name} is in ../shared, which is not here")
    return path


def with_records(study: Path) -> Path:
    """The study, whose measured records are all there, or else the test is skipped."""
    for name in re.findall(r"shared/data/([^\s,}\"]+)", study.read_text()):
        measured(name)
    return study
