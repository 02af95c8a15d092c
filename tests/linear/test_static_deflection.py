"""Deflections under static loads against closed forms, first order and differences."""

from dataclasses import replace

import numpy as np
import pytest
from plants.arm import closed_form, robot
from plants.linkages import linkage
from plants.refusals import refused

from elastid.linear.static_deflection import Load, LoadedRobot
from elastid.model.formulation import formulate
from elastid.model.spec import ModelSpec
from elastid.record import Configuration
from elastid.robot import Body, Frame, Joint, Motor, Placement, Robot, Spring

WHERE = Configuration("here", np.array([0.3, 0.5]))


def load(force=(0, 0, 0), torque=(0, 0, 0), where=WHERE):
    return Load(where, "tool", np.array(force, float), np.array(torque, float), "tool", np.eye(3))


def deflection(model, each, theta=None, dependent=()):
    theta = model.theta if theta is None else theta
    readings, slopes = LoadedRobot.of(model, (each,), (theta,), dependent).deflections((theta,))
    return readings[0], slopes[0]


def test_small_loads_deflect_arm_by_static_compliance():
    """Two links in closed form, C = J K^-1 J^T with gravity in K: a force and a torque small enough."""
    _, _, K, J = closed_form(WHERE.angles)
    y, _ = deflection(formulate(robot()), load(force=(0.06, 0, 0.08)))
    np.testing.assert_allclose(y[[0, 2]], J @ np.linalg.solve(K, J.T @ [0.06, 0.08]), rtol=1e-5)
    assert y[1] == 0
    y, _ = deflection(formulate(robot()), load(torque=(0, 0.05, 0)))
    np.testing.assert_allclose(y[[0, 2]], J @ np.linalg.solve(K, [0.05, 0.05]), rtol=1e-5)


def test_hardening_gear_deflects_by_its_cubic():
    """One horizontal arm without gravity: k x + c x^3 = F L cos x, solved by its own Newton steps."""
    k, c, L, F = 2e4, 5e9, 0.7, 400.0
    joint = Joint("1", "y", Spring(k, 1.0, cubic=c), Motor(1e-3, 50.0))
    arm = Robot(
        "one", (Body("arm", joints=(joint,), mass=1, inertia=1.0),), (0, 0, 0),
        frames=(Frame("tool", "arm", Placement((L, 0, 0))),),
    )  # fmt: skip
    x = 0.0
    for _ in range(40):
        x -= (k * x + c * x**3 - F * L * np.cos(x)) / (k + 3 * c * x**2 + F * L * np.sin(x))
    y, slopes = deflection(formulate(arm), load((0, 0, -F), where=Configuration("a", [0.0])), dependent=("k_1",))
    np.testing.assert_allclose(y, [L * (np.cos(x) - 1), 0, -L * np.sin(x)], rtol=1e-9, atol=1e-15)
    by_k = x / (k + 3 * c * x**2 + F * L * np.sin(x))  # -dx/dk
    np.testing.assert_allclose(slopes[2, 0], L * np.cos(x) * by_k, rtol=1e-8)


@pytest.mark.parametrize("equations", ["constrained", "minimal"])
def test_slopes_are_those_of_differences_also_in_a_closed_loop(equations):
    """A parallel linkage on a turret, both formulations: deflections agree, and slopes with central differences."""
    arm = linkage(spatial=True)
    arm = replace(arm, frames=(Frame("tool", arm.bodies[-1].name, Placement((0.1, 0.05, 0.02))),))
    model = formulate(arm, ModelSpec(equations))
    springs = tuple(name for name in model.parameters if name.startswith("k_"))
    each = load((30, 20, -50), (3, 2, 1), Configuration("a", [0.1, 0.2, -0.1]))
    own = LoadedRobot.of(model, (each,), (model.theta,), springs)
    readings, slopes = own.deflections((model.theta,))
    for column, place in enumerate(own.dependent):
        step = np.zeros(len(model.theta))
        step[place] = 1e-4 * model.theta[place]
        (up,), (down,) = (own.deflections((model.theta + sign * step,))[0] for sign in (1, -1))
        np.testing.assert_allclose(slopes[0][:, column], (up - down) / (2 * step[place]), rtol=1e-5, atol=1e-16)
    other, _ = deflection(formulate(arm, ModelSpec("minimal")), each)
    np.testing.assert_allclose(readings[0], other, rtol=1e-8, atol=1e-14)


def test_deflections_at_two_frames_are_reciprocal():
    """Maxwell and Betti: the work of one small force on the deflection by the other is equal both ways."""
    (tool,) = robot().frames
    model = formulate(replace(robot(), frames=(tool, Frame("elbow", tool.body, Placement((0.1, 0, 0))))))
    forces = np.array([[0.04, 0, -0.03], [0.02, 0, 0.05]])
    loads = [
        Load(WHERE, at, force, np.zeros(3), read_at, np.eye(3))
        for at, read_at, force in zip(("tool", "elbow"), ("elbow", "tool"), forces, strict=True)
    ]
    (elbow, hand), _ = LoadedRobot.of(model, loads, [model.theta] * 2, ()).deflections([model.theta] * 2)
    assert elbow @ forces[1] == pytest.approx(hand @ forces[0], rel=1e-4)
    assert abs(elbow @ forces[1]) > 1e-9


def test_without_rest_and_without_frame_it_says_so():
    """A step of the solver to infinite stiffness, and a frame that the robot lacks."""
    model = formulate(robot())
    own = LoadedRobot.of(model, (load((0, 0, -100)),), (model.theta,), ())
    infinite = np.where(np.char.startswith(model.parameters, "k_"), np.inf, model.theta)
    with pytest.raises(np.linalg.LinAlgError):
        own.deflections((infinite,))
    with refused("robot/unknown-name"):
        LoadedRobot.of(model, (replace(load(), frame="hook"),), (model.theta,), ())
