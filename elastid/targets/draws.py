"""Export of posterior samples for Monte Carlo studies: robot models, MJCF if it can represent them, a table."""

from collections.abc import Callable
from pathlib import Path

import numpy as np

from elastid.base.errors import StudyError
from elastid.base.escape import xml_text
from elastid.model.closed_posture import assemble
from elastid.store.files import write_rows
from elastid.store.kinds import text_of
from elastid.targets.mujoco import NO_RODS, mjcf, rod_poses
from elastid.targets.target import Target
from elastid.use.draws import DrawnRobots


def write_draws(folder: Path, draws: DrawnRobots, name: str, warn: Callable[[str], None]) -> tuple[Path, ...]:
    """Write samples.csv, robots/*.yml (as JSON, which is fast) and mujoco/*.xml; warn if MJCF is impossible."""
    digits = len(str(len(draws.robots)))
    names = [f"{i:0{digits}d}" for i in range(1, len(draws.robots) + 1)]
    rows = ([number, *values] for number, values in zip(names, draws.values.tolist(), strict=True))
    write_rows(folder / "samples.csv", [["sample", *draws.names], *rows])
    robots, mjcf_folder = folder / "robots", folder / "mujoco"
    robots.mkdir(parents=True, exist_ok=True)
    head = f"# Robot of study {name}, draw "
    # Not written atomically, since flushing each of thousands of files to the disk takes minutes.
    for number, robot in zip(names, draws.robots, strict=True):
        (robots / f"robot_{number}.yml").write_text(f"{head}{number}\n{text_of(robot, 1)}\n", encoding="utf-8")
    start = draws.robots[0]  # gives the poses of the rods; MuJoCo closes the loops of the other samples
    try:
        rods = NO_RODS
        if start.loops:
            rods = rod_poses(start, assemble(start, np.array([joint.start for joint in start.driven])))
        first = mjcf(start, rods)
    except StudyError as error:
        warn(f"export: no MJCF of the samples: {error}")
        return folder / "samples.csv", robots
    mjcf_folder.mkdir(exist_ok=True)
    for number, robot in zip(names, draws.robots, strict=True):
        root = first if robot is start else mjcf(robot, rods)
        (mjcf_folder / f"robot_{number}.xml").write_text(f"{xml_text(root)}\n", encoding="utf-8")
    return folder / "samples.csv", robots, mjcf_folder


TARGETS = (
    Target(
        "samples", ("draws", "name", "warn"), "posterior samples as robot models, MJCF and a table", write_draws, True
    ),
)
