"""Robots drawn from a fit, for Monte Carlo elsewhere: robot files, MJCF where it can carry them, a table of numbers."""

from collections.abc import Callable
from pathlib import Path
from xml.etree import ElementTree as ET

import numpy as np

from elastid.base.errors import StudyError
from elastid.model.closed_posture import assemble
from elastid.store.files import write_rows
from elastid.store.values import text_of
from elastid.targets.mujoco import NO_RODS, mjcf, rod_poses
from elastid.targets.target import Target
from elastid.use.draws import DrawnRobots


def write_draws(folder: Path, draws: DrawnRobots, name: str, warn: Callable[[str], None]) -> tuple[Path, ...]:
    """Write samples.csv, robots/*.yml and mujoco/*.xml; return table and folders. warn: called if MJCF is missing.

    The robot files are YAML in its JSON form, which is written and read a hundred times as fast.
    """
    digits = len(str(len(draws.robots)))
    names = [f"{i:0{digits}d}" for i in range(1, len(draws.robots) + 1)]
    rows = ([number, *values] for number, values in zip(names, draws.values.tolist(), strict=True))
    write_rows(folder / "samples.csv", [["sample", *draws.names], *rows])
    robots, engine = folder / "robots", folder / "mujoco"
    robots.mkdir(parents=True, exist_ok=True)
    head = f"# Robot of study {name}, draw "
    # Plain writes: to have each of thousands of files on the disk before the next takes minutes.
    for number, robot in zip(names, draws.robots, strict=True):
        (robots / f"robot_{number}.yml").write_text(f"{head}{number}\n{text_of(robot, 1)}\n", encoding="utf-8")
    start = draws.robots[0]  # the posture in which rods are drawn; the engine closes the loops of the others
    try:
        rods = NO_RODS
        if start.loops:
            rods = rod_poses(start, assemble(start, np.array([joint.start for joint in start.driven])))
        first = mjcf(start, rods)
    except StudyError as refused:
        warn(f"export: no MJCF of the samples: {refused}")
        return folder / "samples.csv", robots
    engine.mkdir(exist_ok=True)
    for number, robot in zip(names, draws.robots, strict=True):
        root = first if robot is start else mjcf(robot, rods)
        ET.indent(root)
        (engine / f"robot_{number}.xml").write_text(f"{ET.tostring(root, encoding='unicode')}\n", encoding="utf-8")
    return folder / "samples.csv", robots, engine


TARGETS = (
    Target(
        "samples", ("draws", "name", "warn"), "posterior samples as robot models, MJCF and a table", write_draws, True
    ),
)
