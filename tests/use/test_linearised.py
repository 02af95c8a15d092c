"""Slopes of matrices of many postures against differences, and postures without rest."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from plants.predicted_arm import result

from elastid.fit.parameter_choice import choose
from elastid.fit.posture import Asked
from elastid.fit.result import Result
from elastid.fit.spec import FitSpec, ParameterSpec
from elastid.robot import Body, Frame, GearCoupling, Joint, Motor, Placement, Robot, Spring
from elastid.use.compliance import linearised

ANGLES = np.array([[0.2, 0.4], [-0.7, 1.1], [1.3, -0.5]])


def coupled() -> Result:
    """Two links under gravity, the second motor turned along by the first joint, springs before the coupling."""
    joints = [Joint(str(i + 1), "y", Spring(4e4 / (i + 1), 30.0), Motor(1e-3, 100.0)) for i in range(2)]
    upper = Body("upper", joints=(joints[0],), mass=30, center_of_mass=(0.4, 0, 0.05), inertia=1.5)
    fore = Body("fore", "upper", Placement((0.8, 0, 0)), (joints[1],), 20, (0.3, 0.1, 0), 1.0)
    frames = (Frame("tool", "fore", Placement((0.5, 0.1, 0.2))),)
    robot = Robot("arm", (upper, fore), frames=frames, gears=(GearCoupling("2", "1", 50.0, "before"),))
    chosen = choose(FitSpec(parameters={"k_*": ParameterSpec(), "m_fore": ParameterSpec()}), robot)
    n = len(chosen.free)
    return Result(
        chosen, chosen.x, 1e-4 * np.eye(n), 1.0, 1, 1.0, "converged", "", (), 1, np.zeros(n, bool), np.ones(n),
        "complex", robot=robot,
    )  # fmt: skip


def test_slopes_are_those_of_differences() -> None:
    """dK and dM to the numbers that x moves, of gears that couple axes; without gravity the equilibrium stays."""
    fit = coupled()
    fit = replace(fit, robot=replace(fit.robot, gravity=(0.0, 0.0, 0.0)))
    family = fit.family(Asked())
    (here,), known = linearised(family, ANGLES), family.estimated
    for column, row in enumerate(known.moved):
        step = 1e-4 * np.eye(len(fit.x))[fit.parameters.free_names.index(known.names[row])]
        (up,), (down,) = (linearised(replace(fit, x=fit.x + sign * step).family(Asked()), ANGLES) for sign in (1, -1))
        scale = 2e-4 * known.theta(known.x)[row]
        for letter in "MK":
            slope = (getattr(up, letter) - getattr(down, letter)) / scale
            np.testing.assert_allclose(getattr(here, f"d{letter}")[:, column], slope, rtol=1e-6, atol=1e-6)


def test_a_posture_without_rest_is_not_found_and_the_others_keep_their_order() -> None:
    """Springs far too soft for the weight stretched out; hanging down the robot rests."""
    own = result()
    place = [own.parameters.free_names.index(name) for name in ("k_1", "k_2")]
    x = own.x.copy()
    x[place] = np.log([150.0, 60.0])
    (many,) = linearised(replace(own, x=x).family(Asked()), np.array([[-np.pi / 2, 0.0], [np.pi / 2, 0.0]]))
    assert many.found.tolist() == [False, True]
    assert len(many.M) == 1
