"""Robots with loops and what acts on them beside springs: compensators, riding motors, coupled and nonlinear gears."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from elastid.linear.equilibrium import equilibrium
from elastid.linear.linearise import linearise
from elastid.linear.response.transfer import frequency_response
from elastid.model.formulation import formulate
from elastid.model.spec import ModelSpec
from elastid.record import Configuration
from elastid.robot import Anchor, CoilSpring, Compensator, GearCoupling, Joint, Robot
from elastid.study import load_robot

ROBOTS = Path(__file__).parents[2] / "configs" / "robots"
LINES = np.geomspace(1, 150, 50)
CONSTRAINED, MINIMAL = ModelSpec("constrained"), ModelSpec("minimal")
AT = Configuration("c", np.array([0.2, 0.4, 0.1]))


def arm() -> Robot:
    return load_robot(ROBOTS / "irb4400_linkage.yml")


def changed(robot: Robot, name: str, change) -> Robot:
    """The robot with one joint made another."""

    def joints(body):
        return tuple(change(joint) if joint.name == name else joint for joint in body.joints)

    return replace(robot, bodies=tuple(replace(body, joints=joints(body)) for body in robot.bodies))


def riding(robot: Robot) -> Robot:
    """Motors 2 and 3 ride on the turret, with gears so low that it shows."""
    for name, on, axis in (("2", "turret", "y"), ("3", "turret", "y")):

        def onto(joint: Joint, on=on, axis=axis) -> Joint:
            assert joint.motor is not None
            return replace(joint, motor=replace(joint.motor, ratio=15.0, inertia=0.2, on=on, axis=axis))

        robot = changed(robot, name, onto)
    return robot


def hardening(joint: Joint) -> Joint:
    """With a cubic spring that gravity bends visibly."""
    assert joint.spring is not None
    return replace(joint, spring=replace(joint.spring, cubic=1e11))


BALANCE = Compensator(
    "balance",
    (Anchor("turret", (-0.28, 0.0, 0.78)), Anchor("lower_end", (0.12, 0.0, 0.1))),
    coil=CoilSpring(2e4, 0.3),
)
# From the crank to the upper arm, both ends moved by the loop.
ACROSS = Compensator(
    "across", (Anchor("crank", (-0.2, 0.0, 0.1)), Anchor("upper", (-0.2, 0.0, 0.1))), CoilSpring(8e4, 0.5)
)
ROBOTS_WITH = {
    "compensator to the lower arm": lambda: replace(arm(), compensators=(BALANCE,)),
    "compensator across the loop": lambda: replace(arm(), compensators=(ACROSS,)),
    "riding motors": lambda: riding(arm()),
    "coupled gears, springs after": lambda: replace(arm(), gears=(GearCoupling("3", "2", 40.0),)),
    "coupled gears, springs before": lambda: replace(arm(), gears=(GearCoupling("3", "2", 40.0, "before"),)),
    "a hardening gear": lambda: changed(arm(), "3", hardening),
}


def response(robot: Robot, spec: ModelSpec):
    model = formulate(robot, spec)
    linear = linearise(model, AT, model.theta, model.inputs, "acceleration")
    return frequency_response(linear, linear.theta_ref, LINES)


def far(G, reference) -> float:
    """Largest difference, relative to the largest element of the line."""
    return float((np.abs(G - reference).max(axis=(1, 2)) / np.abs(reference).max(axis=(1, 2))).max())


@pytest.mark.parametrize("name", ROBOTS_WITH)
def test_both_formulations_agree_with_all_that_drives_a_robot(name: str) -> None:
    """Responses to 1e-10, and the response is another one than without it."""
    robot = ROBOTS_WITH[name]()
    constrained = response(robot, CONSTRAINED)
    assert far(response(robot, MINIMAL), constrained) < 1e-10
    assert far(response(arm(), CONSTRAINED), constrained) > 1e-3
    np.testing.assert_allclose(
        constrained, np.swapaxes(constrained, 1, 2), rtol=0, atol=1e-9 * np.abs(constrained).max()
    )


@pytest.mark.parametrize("name", ROBOTS_WITH)
def test_holding_torques_are_the_slope_of_the_energy(name: str) -> None:
    """u0 = dV/dq_m along the equilibria, by central differences of the potential at rest."""
    robot = ROBOTS_WITH[name]()
    for spec in (CONSTRAINED, MINIMAL):
        model, step = formulate(robot, spec), 1e-4

        def energy(at, model=model) -> float:
            point = equilibrium(model, model.theta, Configuration("c", at))
            return float(model.potential(point.q, model.theta))

        u = equilibrium(model, model.theta, AT).u
        steps = step * np.eye(3)
        slope = [(energy(AT.angles + e) - energy(AT.angles - e)) / (2 * step) for e in steps]
        np.testing.assert_allclose(u, slope, rtol=2e-5, atol=2e-2)
