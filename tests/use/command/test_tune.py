"""A tuned move at its limits, on draws; moves that cannot be made; a robot follows its own plan. Gains: example 18."""

from dataclasses import replace

import numpy as np
import pytest
from plants.commanded_arm import END, START, arm, move
from plants.paths import ROBOTS
from plants.refusals import refused

from elastid.base.arrays import FloatArray
from elastid.fit.posture import default_frame
from elastid.robot import Frame, Robot
from elastid.study import load_robot
from elastid.use.commanded_robot import CommandedRobot
from elastid.use.moves import MotionLimits, point_to_point
from elastid.use.trajectory_optimisation import best_plan, sample_plan
from elastid.use.tune import MoveRobots, SimulatedLoop, tune_move


def given(torque: float = 900.0, draws: int = 3) -> MoveRobots:
    """A truth that is 20 % softer than the catalogue, known to 0.3 %."""
    rng, true = np.random.default_rng(0), arm(torque, 0.8)
    names = [name for name in true.parameters() if name.startswith("k_")]

    def drawn() -> Robot:
        factors = dict(zip(names, np.exp(3e-3 * rng.standard_normal(len(names))), strict=True))
        return true.with_parameters({name: true.parameters()[name][0] * factors[name] for name in names})

    robots = [drawn() for _ in range(draws + 1)]
    return MoveRobots(robots[0], arm(torque), true, "truth", tuple(robots[1:]), "tool", 500.0, 4.0, 1e-3)


HIGHEST = 2.0  # rad: the link hangs beyond the vertical, and gravity turns it back


@pytest.mark.slow
def test_limits_of_torque_hold_on_draws_with_their_feedback() -> None:
    """Where torque is short the tool leaves its path."""
    tuned = tune_move(given(torque=420.0), move(0.5), "arm")
    assert np.all(tuned.max_torque <= 420.0)
    assert np.all(np.abs(tuned.torque) <= 420.0)
    assert tuned.predicted_error.max() > 1e-3


def test_path_errors_separate_zeros_and_elasticity() -> None:
    """A zero that is 1 mrad off turns a tool of 1.2 m by 1.2 mm, which the loop of the motor does not see."""
    asked = given(draws=1)
    robot = asked.draws[0].with_parameters({"zero_1": 1e-3})
    told = []
    tuned = tune_move(replace(asked, draws=(robot,)), move(1.0), "arm", lambda *parts: told.append(parts))
    assert told == sorted(told)
    assert all(done < total == told[0][1] for done, total in told)
    high = tuned.outcomes[-1].high
    reach = np.linalg.norm(tuned.target, axis=1).max()
    assert tuned.geometric_error_m == pytest.approx(1e-3 * reach, rel=0.01)
    assert high.max() < 0.1 * tuned.geometric_error_m


def test_a_draw_that_no_loop_moves_is_refused() -> None:
    """A damping a hundred thousand times the estimate, of a fit that knows nothing of it."""
    asked = given(draws=1)
    (robot,) = asked.draws
    stiff = robot.with_parameters({"d_1": 1e5 * robot.parameters()["d_1"][0]})
    with refused("experiment/diverged"):
        tune_move(replace(asked, draws=(stiff,)), move(1.0), "arm")


@pytest.mark.slow
@pytest.mark.parametrize(
    ("torque", "end", "duration"),
    [(20.0, END, 0.15), (900.0, np.array([END[0], HIGHEST]), 1.0)],
    ids=["gravity", "deflection"],
)
def test_an_end_that_no_motor_holds_is_refused(torque: float, end: FloatArray, duration: float) -> None:
    """Gravity takes more than the motor has, in any time; or deflects so far that the motor stands at its limit."""
    with refused("use/move"):
        tune_move(given(torque, 0), point_to_point(START, end, duration), "arm")


LINKAGE = ROBOTS / "linkage_arm.yml"


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
    references = sample_plan(commanded, planned, 500.0, 0.3)
    target = commanded.poses(commanded.rigid(move, references.time_s)[0]).position
    loop = SimulatedLoop.of(commanded, robot, move.ends[0], 500.0, 4.0)
    outcome = loop.outcome("own", references, target, move.duration)
    assert outcome.largest < 1e-5
    assert outcome.residual < 1e-6
