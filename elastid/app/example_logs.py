"""Small simulated logs of the templates `recorded` and `frf`, so that a new study can be checked and run at once."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

import numpy as np

from elastid.base.arrays import FloatArray
from elastid.store import text_file

_SEED = 1


def write_shaken_masses(folder: Path) -> None:
    """logs/bench_1.csv to bench_4.csv of three masses with two shakers: two realisations of two experiments."""
    from elastid.experiment.simulated.structure import shake

    columns = ("force_1", "force_3", "acc_1", "acc_2", "acc_3")
    logs = (log for realisation in range(2) for log in shake(256.0, 2048, 4, _SEED + realisation))
    for i, log in enumerate(logs, start=1):
        _write_log(folder / "logs" / f"bench_{i}.csv", columns, np.hstack([log.force, log.acceleration]))


def write_elastic_joint(folder: Path) -> None:
    """logs/bench_1.csv and bench_2.csv of the template's robot with other numbers than its file has."""
    from elastid.excitation.spec import MultisineSpec
    from elastid.experiment.plan.plan import make_plan
    from elastid.experiment.simulated.rig import SimulatedRig
    from elastid.experiment.specs.disturbances import NoiseSpec
    from elastid.experiment.specs.experiment import ExperimentSpec
    from elastid.experiment.specs.simulated import SimulatedSpec
    from elastid.study import load_robot

    robot = load_robot(folder / "robot.yml")
    noise = NoiseSpec(torque_std=1e-4, angle_std=2e-6)
    rig = SimulatedSpec(truth=dict(TRUTH), outputs=("motor 1", "joint 1"), noise=noise)
    experiment = ExperimentSpec({"bench": (0.0,)}, periods=4, simulated=rig)
    excitation = MultisineSpec(rate_hz=1000, period=2, band_hz=(1, 150), torque_rms=0.1)
    plan = make_plan(excitation, experiment, robot, _SEED)
    simulated = SimulatedRig(robot, experiment, plan, _SEED)
    columns = ("current", "motor_angle", "load_angle")
    for i, run in enumerate(simulated.experiments, start=1):
        record = simulated.measure(run)
        _write_log(folder / "logs" / f"bench_{i}.csv", columns, np.hstack([record.u / TORQUE_CONSTANT, record.y]))


# The numbers that the fit of the template `recorded` is to find, and the constant in its study.
TRUTH: Mapping[str, float] = {"k_1": 64.0, "d_1": 0.014, "Jm_1": 1.2e-3, "I_load": 0.8e-3, "fm_1": 2e-3}
TORQUE_CONSTANT = 0.17

EXAMPLE_LOGS: Mapping[str, Callable[[Path], None]] = {"recorded": write_elastic_joint, "frf": write_shaken_masses}


def _write_log(path: Path, columns: Sequence[str], values: FloatArray) -> None:
    path.parent.mkdir(exist_ok=True)
    with text_file(path) as file:
        file.write(",".join(columns) + "\n")
        np.savetxt(file, values, fmt="%.6g", delimiter=",")
