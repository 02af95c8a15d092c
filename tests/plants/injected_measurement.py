"""A measurement of a simulated arm whose truth is known, as files: logs, a study and a robot."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from io import StringIO
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from ruamel.yaml import YAML

from elastid.base.arrays import FloatArray
from elastid.excitation.spec import MultisineSpec
from elastid.experiment.plan.plan import make_plan
from elastid.experiment.simulated.rig import SimulatedRig
from elastid.experiment.specs.disturbances import NoiseSpec
from elastid.experiment.specs.experiment import ExperimentSpec
from elastid.experiment.specs.simulated import SimulatedSpec
from elastid.study import load_robot
from plants.two_axes import ROBOT

RATE_HZ, PERIOD_S, TORQUE_RMS = 500.0, 2.0, (60.0, 30.0)
CONFIGURATIONS = {"a": (0.0, 0.2), "b": (0.5, 0.9), "c": (-0.4, -0.7)}
NOISE = NoiseSpec(torque_std=0.5, angle_std=2e-7)


@dataclass
class Log:
    """One experiment: torques u and r and angles y, (n, 2) each, link side, and the clock t in s."""

    path: str
    signals: dict[str, FloatArray]

    def change(self, name: str, motor: int | None, by: Callable[[FloatArray], FloatArray]) -> None:
        """A signal of one motor, or of both, through a function of its samples (n,)."""
        values = np.array(self.signals[name])
        for i in (0, 1) if motor is None else (motor - 1,):
            values[:, i] = by(values[:, i])
        self.signals[name] = values

    def rows(self, chosen: Any) -> None:
        """Some of the samples alone."""
        self.signals = {name: values[chosen] for name, values in self.signals.items()}


@dataclass
class Measurement:
    """The robot's file and the study as YAML holds them, and the logs."""

    robot: dict[str, Any]
    study: dict[str, Any]
    logs: list[Log]

    @property
    def recorded(self) -> dict[str, Any]:
        """The section of the logs."""
        found: dict[str, Any] = self.study["experiment"]["recorded"]
        return found

    def body(self, name: str) -> dict[str, Any]:
        """A body of the robot's file."""
        return next(body for body in self.robot["bodies"] if body["name"] == name)

    def motor(self, number: int) -> dict[str, Any]:
        """A motor of the robot's file."""
        found: dict[str, Any] = self.robot["bodies"][number - 1]["joints"][0]["motor"]
        return found


def true_measurement(seed: int) -> tuple[Measurement, dict[str, float]]:
    """A measurement without a fault, and the true stiffnesses in N m/rad."""
    with TemporaryDirectory() as folder:
        (Path(folder) / "robot.yml").write_text(ROBOT, encoding="utf-8")
        robot = load_robot(Path(folder) / "robot.yml")
    simulated = SimulatedSpec(noise=NOISE, substeps=4)
    experiment = ExperimentSpec({**CONFIGURATIONS}, 1, 3, 2, simulated=simulated)
    excitation = MultisineSpec(RATE_HZ, PERIOD_S, (2.0, 50.0), TORQUE_RMS, grid="odd-random")
    rig = SimulatedRig(robot, experiment, make_plan(excitation, experiment, robot, seed), seed)
    logs, files, hold = [], [], "band-limited"
    for number, each in enumerate(rig.experiments):
        record = rig.measure(each)
        hold = record.hold
        time = np.arange(len(record.u)) / record.rate_hz
        signals = {"t": time, "u": np.array(record.u), "y": np.array(record.y)}
        if record.r is not None:
            signals["r"] = np.array(record.r)
        logs.append(Log(f"log{number}.h5", signals))
        files.append(
            {"path": f"log{number}.h5", "configuration": each.configuration.name, "experiment": each.experiment}
        )
    truth = {name: value for name, (value, _) in robot.parameters().items() if name.startswith("k_")}
    return Measurement(YAML(typ="safe").load(StringIO(ROBOT)), study_of(files, hold), logs), truth


def study_of(files: list[dict[str, Any]], hold: str) -> dict[str, Any]:
    """The study that reads the logs."""
    channels = [
        {"role": role, "at": f"motor {i}", "channel": name, "column": i, "quantity": quantity}
        for role, name, quantity in (("u", "u", "torque"), ("y", "y", "position"))
        for i in (1, 2)
    ]
    recorded = {"rate_hz": RATE_HZ, "period": PERIOD_S, "hold": hold, "channels": channels, "files": files}
    return {
        "name": "faults",
        "robot": "robot.yml",
        "seed": 1,
        "experiment": {"configurations": {n: list(q) for n, q in CONFIGURATIONS.items()}, "recorded": recorded},
        "fit": {"starts": 2, "start_factor": 1.5, "parameters": {"k_*": {}, "d_*": {}, "fm_*": {}}},
        "report": {"formats": []},
    }
