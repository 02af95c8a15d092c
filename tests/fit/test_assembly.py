"""Nonlinear springs from frequency responses: gravity loads them differently from posture to posture."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from plants.marks import SEEDS
from plants.measured_robots import deviations, responses_of

from elastid.fit.assembly import Assembly, relinearise
from elastid.fit.identify import identify
from elastid.fit.parameter_choice import choose
from elastid.fit.problem.least_squares import LocalOptimum
from elastid.fit.spec import FitSpec, ParameterSpec, WeightSpec
from elastid.response import Response
from elastid.robot import Body, Joint, Motor, Placement, Robot, Spring

FREQ = np.linspace(2, 60, 60)
# Joint 1 carries 850, 760, 290, 40, 990 Nm: from nearly its stiffness without load to five times as much.
POSTURES = ((1.2, 0.3), (0.6, -0.7), (0.1, 1.0), (-0.3, -0.3), (1.5, -1.0))
WANTED = FitSpec(starts=6, parameters={name: ParameterSpec() for name in ("k_*", "d_*", "fm_*", "k3_*")})


def arm(first: Spring, second: Spring) -> Robot:
    """Two driven links in a vertical plane."""
    upper = Body("upper", "base", Placement(), (Joint("1", "y", first, Motor(2.5e-3, 120, 1.5e-3)),), 60, (0, 0, 0.4))
    fore = (Joint("2", "y", second, Motor(1.6e-3, 110, 1.2e-3)),)
    return Robot(
        "arm",
        (
            replace(upper, inertia=(6.0, 6.2, 0.8)),
            Body("fore", "upper", Placement((0, 0, 0.85)), fore, 75, (0.45, 0, 0.1), (1.5, 11, 11.0)),
        ),
    )


CUBIC = arm(Spring(3e5, 500, cubic=2e11), Spring(1.8e5, 250, cubic=8e10))


def measure(robot: Robot, postures: tuple[tuple[float, float], ...], seed: int) -> list[Response]:
    """Exact responses of the tangent in each posture with 2 % noise of known variance."""
    return responses_of(robot, postures, np.random.default_rng(seed), FREQ)


def started_elsewhere(robot: Robot, by: float, seed: int) -> Robot:
    rng = np.random.default_rng(seed)
    wanted = [name for name in robot.parameters() if name.startswith(("k_", "d_", "fm_", "k3_"))]
    return robot.with_parameters({n: robot.parameters()[n][0] * float(by ** rng.uniform(-1, 1)) for n in wanted})


@pytest.mark.parametrize("seed", SEEDS)
@pytest.mark.slow
def test_cubic_stiffness_is_found_from_postures_with_different_preload(seed: int) -> None:
    """k and k3 of both gears from starts off by up to a factor of 2, within the claimed intervals."""
    result = identify(measure(CUBIC, POSTURES, seed), started_elsewhere(CUBIC, 2.0, seed), replace(WANTED, seed=seed))
    assert result.status == "converged"
    assert deviations(result, CUBIC).max() < 3.5
    for name in ("k_1", "k3_1", "k_2", "k3_2"):
        low, high = result.interval(name)
        assert high / low < 1.05
    assert result.model_error < 1.1


def test_a_fit_names_the_joint_that_rests_inside_its_gap() -> None:
    """Stiffness beyond the gap is found from loaded postures; the posture in between is spoken of."""
    truth = arm(Spring(9e5, 500, backlash=1e-4, inner_stiffness=1e5), Spring(4e5, 250, backlash=5e-5))
    wanted = replace(WANTED, starts=2, parameters={"k_*": ParameterSpec(), "d_*": ParameterSpec()})
    result = identify(measure(truth, POSTURES, 1), started_elsewhere(truth, 1.3, 1), wanted)
    assert result.status == "converged"
    assert deviations(result, truth).max() < 3.5
    (word,) = (note.text for note in result.notes if note.code == "robot/operating-point")
    assert word.startswith("joint 1 rests inside its backlash of +-0.0001 rad in c4 (deflected by")


def test_a_search_that_ends_where_the_robot_tips_over_comes_back_to_where_it_stands() -> None:
    """Springs a thousand times softer than those of the file carry neither link; the end says so, and is none."""
    robot, spec = (
        arm(Spring(3e5, 500), Spring(1.8e5, 250)),
        FitSpec(parameters={"k_*": ParameterSpec()}, weights=WeightSpec(floor=0.0)),
    )
    data = measure(robot, POSTURES[:2], seed=0)
    assembly = Assembly.of(data, robot, spec, choose(spec, robot, [G.configuration.name for G in data]))
    start = assembly.parameters.x
    soft = start + math.log(1e-3)
    end = relinearise(assembly, LocalOptimum(soft, soft, 0.0, 0, True, "soft"), "complex").end
    assert not end.converged
    assert "the robot cannot stand: configuration c1: joint 1 tips over" in end.message
    assembly.at(end.x, "complex")  # StudyError where the robot does not stand
    np.testing.assert_allclose(end.x, (soft + start) / 2)
