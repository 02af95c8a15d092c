"""Elastic gears, joints and rods can be rigid, in every formulation, as the limit of ever stiffer springs."""

from dataclasses import replace

import numpy as np
import pytest
from plants.arm import resting
from plants.dry_friction import robot as two_axes
from plants.gears import wrist
from plants.linkages import linkage
from plants.refusals import refused

from elastid.linear.linearise import linearise
from elastid.linear.response.transfer import frequency_response
from elastid.model.formulation import formulate
from elastid.model.spec import ModelSpec
from elastid.record import Configuration
from elastid.robot import Body, Joint, Motor, Robot, Spring
from elastid.robot.simplified import elastic_coordinates, with_stiff_joints

LINES = np.geomspace(1, 60, 30)
SERIAL, CONSTRAINED, MINIMAL = ModelSpec(), ModelSpec("constrained"), ModelSpec("minimal")
# Two axes whose second motor rides on the first link, with gravity and two joints that give sideways.
PLANTS = {
    "riding motors": (two_axes((0.0, 0.0)), (0.3, 0.9), (SERIAL,)),
    "shafts before the couplings": (wrist(), (0.3, 0.5, -0.2), (SERIAL,)),
    "springs before the couplings": (wrist("before", shafts=False, links=True), (0.3, 0.5, -0.2), (SERIAL,)),
    "springs after the couplings": (wrist(shafts=False, links=True), (0.3, 0.5, -0.2), (SERIAL,)),
    "springs between and in series": (wrist(links=True, before=("6",)), (0.3, 0.5, -0.2), (SERIAL,)),
    "parallelogram": (linkage(), (0.3, 0.1), (CONSTRAINED, MINIMAL)),
    "spatial, bending": (linkage(bends=True, spatial=True), (0.4, 0.3, 0.1), (CONSTRAINED, MINIMAL)),
}


def response(robot: Robot, spec: ModelSpec, angles: tuple[float, ...]) -> np.ndarray:
    model = formulate(robot, spec)
    linear = linearise(model, Configuration("c", angles), model.theta, model.inputs, "acceleration")
    return frequency_response(linear, linear.theta_ref, LINES)


@pytest.mark.parametrize(
    "plant", [pytest.param(plant, marks=pytest.mark.slow) if "spatial" in plant else plant for plant in PLANTS]
)
def test_stiff_springs_converge_with_their_compliance(plant: str) -> None:
    """Every coordinate in turn: ten times the stiffness, a tenth of the difference; motors stay inputs and outputs."""
    robot, angles, specs = PLANTS[plant]
    for spec in specs:
        for coordinate in elastic_coordinates(robot):
            rigid = with_stiff_joints(robot, [coordinate.name])
            exact = response(rigid, spec, angles)
            springs = {f"k_{coordinate.name}", f"km_{coordinate.name}"} & set(robot.parameters())
            off = []
            for factor in (1e4, 1e5):
                stiff = robot.with_parameters({name: factor * robot.parameters()[name][0] for name in springs})
                off.append(np.abs(response(stiff, spec, angles) - exact).max() / np.abs(exact).max())
            assert off[0] < 0.02
            assert off[0] / off[1] == pytest.approx(10, rel=0.05), coordinate.label


def test_a_rigid_gear_is_the_rotor_on_the_joint() -> None:
    """G = 1 / (I + n^2 J + (f + n^2 f_m) / s), and a deflection that is none under gravity."""
    motor = Motor(2e-3, 50, 3e-3)
    body = Body("arm", joints=(Joint("1", "y", Spring(1e4, 5.0), motor, 2.0),), mass=10, center_of_mass=(0.2, 0, 0))
    robot = with_stiff_joints(Robot("one", (replace(body, inertia=1.3),), (0.0, 0.0, -9.81)), ["1"])
    up = (-np.pi / 2,)  # the centre of mass above the joint, which gravity would tip over but for the motor
    s = 2j * np.pi * LINES
    gravity = -10 * 9.81 * 0.2
    inertia = 1.3 + 10 * 0.2**2 + 50**2 * 2e-3
    expected = s**2 / (s**2 * inertia + s * (2.0 + 50**2 * 3e-3) + gravity)
    np.testing.assert_allclose(response(robot, SERIAL, up)[:, 0, 0], expected, rtol=1e-9)
    assert resting(formulate(robot), 0.1).q.tolist() == [0.1]


@pytest.mark.parametrize("name", ["9", "elbow"])
def test_what_has_no_spring_cannot_be_made_rigid(name: str) -> None:
    """The message lists what can; a rod that is rigid already is a loop without a spring."""
    with refused("robot/no-spring", holds=(f"joint {name}", "2, 3, rod")):
        with_stiff_joints(linkage(), [name])
    with refused("robot/no-spring", holds=("loop rod", "2, 3")):
        with_stiff_joints(with_stiff_joints(linkage(), ["rod"]), ["rod"])
