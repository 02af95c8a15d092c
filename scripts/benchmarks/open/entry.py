"""What all entries share: run a method on each robot of a seed and write its result as one JSON object.

    {"entry": "name", "seed": 0, "robots": {"stiff_gears": {"parameters": {"k_1": [value, std]}, "cpu_s": 1.2}}}
"""

import argparse
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeAlias

Estimates: TypeAlias = dict[str, tuple[float, float]]


def enter(name: str, identify: Callable[[Path], tuple[Estimates, dict[str, Any]]]) -> None:
    """Identify the robots below FOLDER/seed-<seed>; estimates that exist already and are not asked for stay."""
    parser = argparse.ArgumentParser()
    parser.add_argument("folder", type=Path)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--robots", nargs="+")
    given = parser.parse_args()
    path = given.folder / "results" / f"{name}-{given.seed}.json"
    path.parent.mkdir(exist_ok=True)
    result = json.loads(path.read_text()) if path.exists() else {"entry": name, "seed": given.seed, "robots": {}}
    for folder in sorted((given.folder / f"seed-{given.seed}").iterdir()):
        if given.robots and folder.name not in given.robots:
            continue
        values, more = identify(folder)
        if values or more:
            result["robots"][folder.name] = {"parameters": values, **more}
            print(folder.name, more, flush=True)
        path.write_text(json.dumps(result, indent=1))
