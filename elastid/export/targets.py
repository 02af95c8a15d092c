"""The targets of `elastid export` by name."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

from elastid.export.code import write_c, write_casadi
from elastid.export.control import write_control, write_responses_control
from elastid.export.csv import write_csv, write_responses_csv
from elastid.export.fmu import write_fmu
from elastid.export.matlab import write_matlab, write_responses_matlab
from elastid.export.mujoco import write_mujoco
from elastid.export.uff import write_uff
from elastid.export.urdf import write_urdf
from elastid.fit.fitted_robot import FittedRobot
from elastid.response import FrequencyResponse

Writer = Callable[[Path, FittedRobot], tuple[Path, ...]]
ResponseWriter = Callable[[Path, str, Sequence[FrequencyResponse]], tuple[Path, ...]]

TARGETS: dict[str, Writer] = {
    "control": write_control,
    "matlab": write_matlab,
    "mujoco": write_mujoco,
    "fmu": write_fmu,
    "urdf": write_urdf,
    "casadi": write_casadi,
    "c": write_c,
    "csv": write_csv,
}

# Of measured responses: all that a study without a robot has. uff takes those of any study.
RESPONSE_TARGETS: dict[str, ResponseWriter] = {
    "control": write_responses_control,
    "matlab": write_responses_matlab,
    "csv": write_responses_csv,
    "uff": write_uff,
}
