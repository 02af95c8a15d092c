"""Frames for names that a robot's file has no frame for: those of its bodies, and `tool` at the last one."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

from elastid.base.errors import StudyError, did_you_mean
from elastid.robot.body import TOOL, Frame
from elastid.robot.placement import Placement
from elastid.robot.robot import Robot


def with_frames(robot: Robot, names: Iterable[str]) -> Robot:
    """The robot with a frame for each of these names; StudyError for one that is neither of a frame nor of a body.

    `tool`, where no frame has this name, is at the centre of mass of the last body.
    """
    for name in dict.fromkeys(names):
        known = [frame.name for frame in robot.frames]
        if name in known:
            continue
        bodies, last = [body.name for body in robot.bodies], robot.bodies[-1]
        if name not in (*bodies, TOOL):
            raise StudyError(f"robot {robot.name} has no frame {name}; {did_you_mean(name, [*known, *bodies])}")
        made = Frame(name, name) if name in bodies else Frame(TOOL, last.name, Placement(last.center_of_mass))
        robot = replace(robot, frames=(*robot.frames, made))
    return robot
