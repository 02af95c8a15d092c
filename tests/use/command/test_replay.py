"""A robot in its drives' loops follows what was planned with its own numbers, loops closed by constraints included."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from elastid.fit.posture import default_frame
from elastid.robot import Frame
from elastid.simulation.controller import tune
from elastid.study import load_robot
from elastid.use.command.equations import CommandedRobot
from elastid.use.command.moves import MotionLimits, point_to_point
from elastid.use.command.plans import best_plan, sampled
from elastid.use.command.tune import DAMPING_RATIO, TwinLoop

LINKAGE = Path(__file__).parents[3] / "configs" / "robots" / "linkage_arm.yml"


@pytest.mark.slow
@pytest.mark.parametrize("rod", ["elastic", "rigid"])
def test_a_linkage_follows_its_own_plan(rod: str) -> None:
    """An elastic rod is cut, a rigid one is a constraint with its multiplier: to ten micrometres both."""
    robot = load_robot(LINKAGE)
    if rod == "rigid":
        loops = (replace(loop, rod=replace(loop.rod, stiffness=None, damping=0.0)) for loop in robot.loops)
        robot = replace(robot, loops=tuple(loops))
    robot = replace(robot, frames=(*robot.frames, Frame("tool", robot.bodies[-1].name)))
    move = point_to_point(np.radians([0.0, 10.0]), np.radians([40.0, 25.0]), 1.0)
    commanded = CommandedRobot.of(robot, default_frame(robot), move.ends[0])
    assert bool(commanded.rows) == (rod == "rigid")
    planned = best_plan(commanded, move, MotionLimits.of(robot), 0.05)
    assert planned.has_converged
    references = sampled(commanded, planned, 500.0, 0.3)
    target = commanded.poses(commanded.rigid(move, references.time_s)[0]).position
    gains = tune(commanded.model, commanded.rigid_posture(move.ends[0]), 4.0, DAMPING_RATIO)
    loop = TwinLoop.of(robot, commanded.model, commanded.frame, gains, 500.0)
    outcome = loop.outcome("own", references, target, move.duration)
    assert outcome.largest < 1e-5
    assert outcome.residual < 1e-6
