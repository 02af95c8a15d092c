"""The targets of `elastid export` by name."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from elastid.export.code import write_c, write_casadi
from elastid.export.control import write_control
from elastid.export.csv import write_csv
from elastid.export.matlab import write_matlab
from elastid.export.mujoco import write_mujoco
from elastid.fit.fitted_model import FittedModel

Writer = Callable[[Path, FittedModel], tuple[Path, ...]]

TARGETS: dict[str, Writer] = {
    "control": write_control,
    "matlab": write_matlab,
    "mujoco": write_mujoco,
    "casadi": write_casadi,
    "c": write_c,
    "csv": write_csv,
}
