"""The study of a live identification, refused where live cannot measure it, and its folder: plans out, logs in.

DIR/live/x1.h5: the plan of the first experiment; references/x1-r0-e0.csv: a run of it; logs/x1-r0-e0.csv, or of any
other format that is read: its log; x1: the results of all experiments so far; study.yml, robot.yml: the study of all
logs. What is there is whole: a killed command leaves nothing that the next has to undo.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from elastid.app.stage_table import SIMULATED
from elastid.base.arrays import FloatArray
from elastid.base.errors import DataError, StudyError
from elastid.experiment.plan.movement import Reference
from elastid.experiment.plan.plan import Experiment, Plan
from elastid.experiment.simulated.hardware import logged_quantity
from elastid.experiment.simulated.rig import SimulatedRig
from elastid.experiment.specs.channels import ChannelSpec
from elastid.experiment.specs.experiment import ExperimentSpec
from elastid.experiment.specs.recorded import FileSpec, RecordedSpec
from elastid.recorded.channels import gather_channels
from elastid.recorded.files.formats import is_log, naming
from elastid.robot import Robot
from elastid.store.files import text_file, write_text
from elastid.store.measured import write_run
from elastid.study import Study
from elastid.study.robots import yaml_text

POLL_S = 0.5  # between two looks at a folder
# Sections of a study that mean the same with other configurations than its own.
KEPT = ("name", "seed", "model", "estimator", "fit", "gears", "report")
ROBOT, STUDY = "robot.yml", "study.yml"


@dataclass(frozen=True)
class LiveFolder:
    """path: of the folder; robot: with the tolerances that its logs are fitted with; outputs: places in the logs."""

    path: Path
    robot: Robot
    outputs: tuple[str, ...]

    def plan(self, step: int) -> Path:
        """The plan of an experiment, from 1."""
        return self.path / f"x{step}.h5"

    def results(self, step: int) -> Path:
        """The folder of the results of all experiments up to this one."""
        return self.path / f"x{step}"

    def log(self, run: Experiment) -> Path | None:
        """The log of a run; None until it is there. DataError where there are several."""
        logs = [path for path in sorted((self.path / "logs").glob(f"{run.name}.*")) if is_log(path)]
        if len(logs) > 1:
            names = ", ".join(path.name for path in logs)
            raise DataError(
                "live/logs", f"{names} are logs of one run; keep the one of its reference", f"{self.path / 'logs'}"
            )
        return logs[0] if logs else None

    @property
    def channels(self) -> tuple[ChannelSpec, ...]:
        """Channels of all logs: injected torque (r), acting torque (u) and motion (y), link side, SI."""
        inputs = self.robot.motor_locations
        torques = [ChannelSpec(role, at, channel=f"{role} {at}") for role in ("r", "u") for at in inputs]
        motions = [ChannelSpec("y", at, channel=f"y {at}", quantity=logged_quantity(at)) for at in self.outputs]
        return (*torques, *motions)

    def recorded(self, plans: Sequence[Plan]) -> RecordedSpec:
        """The measured periods of all logs of some plans, which are there."""
        files = [self._file(plan, run) for plan in plans for run in plan.experiments]
        period = float(plans[0].period_samples)
        return RecordedSpec(plans[0].rate_hz, self.channels, tuple(files), period_samples=period, hold="zero-order")

    def _file(self, plan: Plan, run: Experiment, whole: bool = False) -> FileSpec:
        log = self.log(run)
        assert log is not None
        first = plan.first_sample + plan.transient_periods * plan.period_samples
        samples = None if whole else (first, first + plan.periods * plan.period_samples)
        return FileSpec(f"logs/{log.name}", run.configuration.name, run.realisation, run.experiment, samples=samples)

    def signals(self, plan: Plan, run: Experiment) -> tuple[FloatArray, FloatArray, FloatArray]:
        """r, u and y (n, n_u) of the motors over the whole log of a run; DataError where it cannot be read."""
        file = self._file(plan, run, whole=True)
        spec = RecordedSpec(plan.rate_hz, self.channels, (file,))
        path = self.path / file.path
        with naming(path, f"its values cannot be used as a log; look at them with `elastid inspect {path}`"):
            gathered = gather_channels(spec, file, self.path, self.robot)
        columns = {(c.role, c.at): gathered.signals[:, i] for i, c in enumerate(gathered.channels)}
        inputs = self.robot.motor_locations
        r, u, y = (np.stack([columns[role, at] for at in inputs], axis=1) for role in ("r", "u", "y"))
        return r, u, y

    def write_references(self, plan: Plan, reference: Reference) -> None:
        """A file for each run of an experiment, unless it is there."""
        for run in plan.experiments:
            path = self.path / "references" / f"{run.name}.csv"
            path.parent.mkdir(parents=True, exist_ok=True)
            if not path.exists():
                write_run(path, reference, plan, run)

    def write_study(self, data: Mapping[str, Any], plans: Sequence[Plan]) -> Path:
        """study.yml and robot.yml of the logs of some plans; data: keys of the study that was asked for."""
        configurations = {c.name: tuple(c.angles.tolist()) for plan in plans for c in plan.configurations}
        experiment = ExperimentSpec(configurations, recorded=self.recorded(plans))
        kept = {key: data[key] for key in KEPT if data.get(key) is not None}
        text = yaml_text({**kept, "robot": ROBOT, "experiment": experiment}, ("The logs of a live identification.",))
        write_text(self.path / ROBOT, yaml_text(self.robot))
        write_text(self.path / STUDY, text)
        return self.path / STUDY


def write_simulated_log(folder: Path, rig: SimulatedRig, run: Experiment) -> None:
    """The log of a run on a simulated rig, as a controller would leave it."""
    plan = rig.plan
    time_s = (np.arange(plan.run_samples) - plan.first_sample) / plan.rate_hz
    roles = [("r", plan.inputs), ("u", plan.inputs), ("y", rig.outputs)]
    headings = [f"{role} {at}" for role, places in roles for at in places]
    rows = np.column_stack([time_s, *rig.log(run)])
    folder.mkdir(parents=True, exist_ok=True)
    with text_file(folder / f"{run.name}.csv") as file:
        np.savetxt(file, rows, fmt="%.12g", delimiter=",", header=",".join(["time_s", *headings]), comments="")


def require_one_robot_in_any_posture(study: Study, path: str) -> None:
    """StudyError for a study without a plan, or whose sections name configurations, which live chooses itself."""
    if study.kind != SIMULATED or study.excitation is None:
        raise StudyError(
            "live/study",
            "live plans experiments, which needs the sections excitation and experiment.simulated, whose "
            "controller and noise are those of the robot; a study of logs has none",
            path,
        )
    simulated, motors = study.experiment.as_simulated(), study.as_robot().motor_locations
    missing = sorted({*motors} - {*(simulated.outputs or motors)})
    own = [name for name, parameter in study.fit.parameters.items() if parameter.per is not None]
    offset = simulated.carrier is not None and simulated.carrier.kind == "offset"
    weighed = any(factor.configurations for factor in study.fit.weights.factors)
    for is_wrong, place in (
        (missing, "experiment.simulated.outputs"),
        (offset, "experiment.simulated.carrier"),
        (study.fit.robots, "fit.robots"),
        (own, f"fit.parameters.{''.join(own[:1])}.per"),
        (weighed, "fit.weights.factors"),
        (study.experiment.without_payload, "experiment.without_payload"),
    ):
        if is_wrong:
            raise StudyError(
                "live/study",
                "live chooses the configurations of one robot itself, without a carrier of constant velocity, and "
                "reads the position of every motor; leave this key out",
                place,
            )
