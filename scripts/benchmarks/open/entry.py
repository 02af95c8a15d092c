"""Common code of all entries: run a method on each robot of a seed and write the result as one JSON object.

{"entry": "name", "seed": 0, "robots": {"stiff_gears": {"parameters": {"k_1": [value, std]}, "cpu_s": 1.2}}}
"""

import argparse
import json
import time
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from engine import PERIOD_S, Array
from robots import Body, Joint, Motor, Robot, Rod


@dataclass(frozen=True)
class Task:
    """Public files of a robot."""

    folder: Path
    robot: dict[str, Any]
    experiment: dict[str, Any]

    @property
    def sheet(self) -> Robot:
        """The data sheet."""
        return read_robot(self.robot)

    @property
    def period(self) -> int:
        """Samples in a period."""
        return round(PERIOD_S * self.experiment["rate_hz"])

    def logs(self, channels: str) -> Iterator[tuple[dict[str, Any], list[Array]]]:
        """Yield each log with its channels (samples, n); channels: one letter each, such as "uq"."""
        n = range(1, len(self.experiment["torque_rms"]) + 1)
        with h5py.File(self.folder / "logs.h5") as store:
            for file in self.experiment["files"]:
                log = store[Path(file["file"]).stem]
                yield file, [np.stack([log[f"{c}_{i}"][()] for i in n], axis=1) for c in channels]


def read_robot(row: Mapping[str, Any]) -> Robot:
    """Read a robot as the files have it."""
    bodies = []
    for b in row["bodies"]:
        joints = tuple(Joint(**(j | {"motor": j["motor"] and Motor(**j["motor"])})) for j in b["joints"])
        bodies.append(Body(**(b | {"joints": joints})))
    return Robot(row["name"], tuple(bodies), row["rod"] and Rod(**row["rod"]))


def tasks(folder: Path, seed: int) -> Iterator[Task]:
    """Yield the tasks in FOLDER/seed-<seed>."""
    for place in sorted((folder / f"seed-{seed}").iterdir()):
        yield Task(place, *(json.loads((place / file).read_text()) for file in ("robot.json", "experiment.json")))


def enter(name: str, identify: Callable[[Task], dict[str, Any] | None]) -> None:
    """Identify the robots below FOLDER/seed-<seed>; None: the method does not apply. Other robots' results stay."""
    parser = argparse.ArgumentParser()
    parser.add_argument("folder", type=Path)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--robots", nargs="+")
    options = parser.parse_args()
    path = options.folder / "results" / f"{name}-{options.seed}.json"
    path.parent.mkdir(exist_ok=True)
    result = json.loads(path.read_text()) if path.exists() else {"entry": name, "seed": options.seed, "robots": {}}
    for task in tasks(options.folder, options.seed):
        robot, begin = task.folder.name, time.process_time()
        if robot in (options.robots or [robot]) and (estimates := identify(task)):
            result["robots"][robot] = estimates | {"cpu_s": time.process_time() - begin}
            print(robot, {key: value for key, value in estimates.items() if key != "parameters"}, flush=True)
            path.write_text(json.dumps(result, indent=1))
