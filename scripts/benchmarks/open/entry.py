"""Common code of all entries: run a method on each robot of a seed and write the result as one JSON object.

{"entry": "name", "seed": 0, "robots": {"stiff_gears": {"parameters": {"k_1": [value, std]}, "cpu_s": 1.2}}}
"""

import argparse
import json
import sys
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from robots import ROWS, Array, Robot


@dataclass(frozen=True)
class Task:
    """Public files of a robot: data sheet, its tolerances (std) and the experiments."""

    folder: Path
    sheet: Robot
    tolerances: dict[str, float]
    experiment: dict[str, Any]

    def logs(self, channels: str) -> Iterator[tuple[dict[str, Any], list[Array]]]:
        """Yield each log with its channels (samples, n); channels: one letter each, such as "uq"."""
        n = range(1, len(self.experiment["torque_rms"]) + 1)
        with h5py.File(self.folder / "logs.h5") as store:
            for file in self.experiment["files"]:
                log = store[Path(file["file"]).stem]
                yield file, [np.stack([log[f"{c}_{i}"][()] for i in n], axis=1) for c in channels]


def tasks(folder: Path, seed: int) -> Iterator[Task]:
    """Yield the tasks in FOLDER/seed-<seed>."""
    for place in sorted((folder / f"seed-{seed}").iterdir()):
        robot, experiment = (json.loads((place / file).read_text()) for file in ("robot.json", "experiment.json"))
        yield Task(place, Robot(**robot), robot["tolerances"], experiment)


def options(**others: str) -> argparse.Namespace:
    """Read the arguments FOLDER, --seed and --robots, and others with these defaults, from the command line."""
    parser = argparse.ArgumentParser(description=sys.modules["__main__"].__doc__)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--robots", nargs="+", choices=[row.name for row in ROWS])
    for name, default in others.items():
        parser.add_argument(f"--{name}", default=default)
    return parser.parse_args()


def enter(name: str, identify: Callable[[Task], dict[str, Any] | None]) -> None:
    """Identify the robots below FOLDER/seed-<seed>; None: the method does not apply. Other robots' results stay."""
    arguments = options()
    path = arguments.folder / "results" / f"{name}-{arguments.seed}.json"
    path.parent.mkdir(exist_ok=True)
    result = json.loads(path.read_text()) if path.exists() else {"entry": name, "seed": arguments.seed, "robots": {}}
    for task in tasks(arguments.folder, arguments.seed):
        robot, begin = task.folder.name, time.process_time()
        if robot in (arguments.robots or [robot]) and (estimates := identify(task)):
            result["robots"][robot] = estimates | {"cpu_s": time.process_time() - begin}
            print(robot, {key: value for key, value in estimates.items() if key != "parameters"}, flush=True)
            path.write_text(json.dumps(result, indent=1))
