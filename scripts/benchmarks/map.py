"""A map of a thousand postures: processor time beyond imports, of one core.

    python scripts/benchmarks/map.py [--quick]

The demo's three-axis arm with seven springs and seventeen identified numbers, the Manutec r3 with six axes, and a
linkage with an elastic rod: static compliance, modes, response on 300 lines, depth of cut, deflection, and the standard
deviation of each. Next to it the same postures asked one by one, of which a hundredth is timed, and as many
draws of robots, written as files. The last line is one JSON object with the numbers of the table; it is asserted that
the demo's map takes less than 2 s, and its draws less than 10 s.
"""

# One BLAS thread must be asked for before NumPy is loaded.
# ruff: noqa: E402
import os

for variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ[variable] = "1"

import argparse
import json
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from timing import cpu_seconds, machine

from elastid.export.draws import write_draws
from elastid.fit.parameter_choice import choose
from elastid.fit.result import FitResult
from elastid.fit.spec import FitSpec, ParameterSpec
from elastid.model.spec import ModelSpec
from elastid.robot import Robot
from elastid.study import load_robot
from elastid.use.draws import draw_robots
from elastid.use.map import map_workspace
from elastid.use.postures import random_postures

LINES = np.geomspace(2, 150, 300)
ROOT = Path(__file__).parents[2]
ROBOTS = {
    "demo": ROOT / "elastid" / "app" / "templates" / "serial" / "robot.yml",
    "manutec r3": ROOT / "configs" / "robots" / "manutec_r3.yml",
    "linkage, minimal": ROOT / "configs" / "robots" / "irb4400_linkage.yml",
}


def fitted(robot: Robot, spec: ModelSpec) -> FitResult:
    """As a fit of springs, dampers and motor frictions leaves it, each known to 1 %."""
    positive = [name for name, (value, _) in robot.parameters().items() if value > 0]
    free = {name: ParameterSpec() for name in positive if name.startswith(("k_", "d_", "fm_"))}
    chosen = choose(FitSpec(parameters=free), robot)
    n = len(chosen.free)
    ended = (1.0, 1, 1.0, "converged", "", (), 1, np.zeros(n, bool), np.ones(n), "complex")
    return FitResult(chosen, chosen.x, 1e-4 * np.eye(n), *ended, robot=robot, equations=spec)


def main() -> None:
    """Time each robot."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--quick", action="store_true", help="fewer postures, to see that it runs")
    count = 50 if parser.parse_args().quick else 1000
    print(machine())
    table = {}
    for name, path in ROBOTS.items():
        robot = load_robot(path)
        result = fitted(robot, ModelSpec("minimal") if robot.loops else ModelSpec())
        angles = random_postures(robot, count)
        result.at(angles[0]).stiffness()  # the equations are built once, as they are in a fit
        many = cpu_seconds(lambda r=result, a=angles: map_workspace(r, a, lines_hz=LINES), 3)
        few = angles[: max(1, count // 100)]

        def singly(r: FitResult = result, a: np.ndarray = few) -> None:
            for each in a:
                model = r.at(each)
                model.stiffness(), model.modes(), model.response_band(LINES)

        each = cpu_seconds(singly, 1) / len(few) * count
        with TemporaryDirectory() as folder:
            draws = cpu_seconds(lambda r=result, f=folder: write_draws(Path(f), draw_robots(r, count), "study"), 1)
        table[name] = {
            "postures": count,
            "map_s": round(many, 2),
            "one_by_one_s": round(each, 1),
            "draws_s": round(draws, 1),
        }
        print(f"{name:18} {count} postures: map {many:.2f} s, one by one {each:.1f} s; draws {draws:.1f} s", flush=True)
    print(json.dumps({"map": table}))
    assert count < 1000 or (table["demo"]["map_s"] < 2.0 and table["demo"]["draws_s"] < 10.0), table["demo"]


if __name__ == "__main__":
    main()
