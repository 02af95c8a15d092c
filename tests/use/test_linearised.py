"""Matrices of many postures at once against those of one posture, and slopes against differences."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from plants.predicted_arm import result

from elastid.fit.parameter_choice import choose
from elastid.fit.posture import Asked, Family
from elastid.fit.result import Result
from elastid.fit.spec import FitSpec, ParameterSpec
from elastid.record import Configuration
from elastid.robot import Body, Frame, GearCoupling, Joint, Motor, Placement, Robot, Spring
from elastid.use.linearised import ManyPostures

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


@pytest.mark.parametrize("make", [result, coupled])
def test_matrices_are_those_of_each_posture(make) -> None:
    """M, D, K, J in the axes of the base, and the compliance of the frame; gears that couple axes, too."""
    family = make().family(Asked(axes="world"))
    (many,) = ManyPostures(family).at(ANGLES)
    assert many.found.all()
    for i, angles in enumerate(ANGLES):
        alone = family.at(Configuration("p", angles))
        A = alone.matrices(family.estimated.x)
        for name in "MDKJ":
            np.testing.assert_allclose(getattr(many, name)[i], getattr(A, name), rtol=1e-7, atol=1e-9)
        C = many.J[i] @ np.linalg.solve(many.K[i], many.J[i].T)
        np.testing.assert_allclose(C, alone.stiffness().compliance, rtol=1e-7, atol=1e-14)


def test_slopes_are_those_of_differences() -> None:
    """dK and dM to the numbers that x moves, about the equilibrium as it is: without gravity it stays."""
    fit = coupled()
    still = replace(fit, robot=replace(fit.robot, gravity=(0.0, 0.0, 0.0)))

    def at(x: np.ndarray) -> tuple[ManyPostures, Family]:
        family = replace(still, x=x).family(Asked())
        return ManyPostures(family), family

    many, family = at(still.x)
    (here,) = many.at(ANGLES)
    known = family.estimated
    moves = np.flatnonzero(np.any(known.slopes, axis=1))
    for column, (row, name) in enumerate((row, known.names[row]) for row in moves):
        place = still.parameters.free_names.index(name)
        step = 1e-4 * np.eye(len(still.x))[place]
        (up,), (down,) = (list(at(still.x + sign * step)[0].at(ANGLES)) for sign in (1, -1))
        scale = 2e-4 * known.theta(known.x)[row]
        for letter in "MK":
            slope = (getattr(up, letter) - getattr(down, letter)) / scale
            np.testing.assert_allclose(getattr(here, f"d{letter}")[:, column], slope, rtol=1e-6, atol=1e-9)


def test_a_posture_without_rest_is_not_found_and_the_others_keep_their_order() -> None:
    """Springs far too soft for the weight stretched out; hanging down the robot rests."""
    own = result()
    place = [own.parameters.free_names.index(name) for name in ("k_1", "k_2")]
    x = own.x.copy()
    x[place] = np.log([150.0, 60.0])
    (many,) = ManyPostures(replace(own, x=x).family(Asked())).at(np.array([[-np.pi / 2, 0.0], [np.pi / 2, 0.0]]))
    assert many.found.tolist() == [False, True]
    assert len(many.M) == 1
