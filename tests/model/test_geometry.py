"""Geometry as named numbers: where bodies, joints, compensators and loops sit, in the linear model and in a fit."""

from dataclasses import replace
from xml.etree import ElementTree as ET

import numpy as np
import pytest
from plants.commanded_arm import rigid_gears
from plants.linkages import LEVER, LOWER, linkage
from plants.refusals import refused

from elastid.linear.linearise import Linearisation, linearise
from elastid.linear.response.derivatives import Columns
from elastid.linear.response.kernel import Kernel
from elastid.linear.response.transfer import frequency_response
from elastid.model.formulation import formulate, serial
from elastid.model.spec import ModelSpec
from elastid.record import Configuration
from elastid.robot import (
    Anchor,
    Body,
    Compensator,
    Frame,
    GasSpring,
    Joint,
    Loop,
    Motor,
    Pin,
    Placement,
    Robot,
    Rod,
    Spring,
)
from elastid.targets.mujoco import mjcf

LINES = np.geomspace(0.7, 90, 8)


def bending_arm() -> Robot:
    """A gas spring on the shoulder, an upper arm that bends at 0.35 m, an elbow; a tool with an accelerometer."""
    gas = GasSpring(6000.0, 0.6, 0.4, 1.2, "draw")
    ends = Anchor("base", (-0.15, 0.02, -0.5)), Anchor("root", (-0.1, 0.01, 0.1))
    motor = Motor(2e-3, 60, 1e-3)
    bend = Joint("1b", "y", Spring(6e4, 30), point=(0.0, 0.0, 0.35))
    twist = Joint("1t", (0.1, 0.0, 1.0), Spring(2e4, 20), point=(0.02, 0.01, 0.3))
    return Robot(
        "bending arm",
        (
            Body(
                "root",
                "base",
                Placement((0.03, 0, 0.02)),
                (Joint("1", "y", Spring(3e4, 60), motor),),
                15,
                (0, 0, 0.2),
                1.0,
            ),
            Body("tip", "root", Placement(), (bend, twist), 20, (0.01, 0.02, 0.6), (1.0, 1.1, 0.4)),
            Body(
                "fore",
                "tip",
                Placement((0, 0.1, 0.8)),
                (Joint("2", "y", Spring(2e4, 40), motor),),
                25,
                (0.3, 0, 0),
                1.0,
            ),
        ),
        frames=(Frame("tool", "fore", Placement((0.6, 0.05, 0.1), (0.2, 0.1, -0.3))),),
        compensators=(Compensator("gas", ends, gas=gas),),
    )


def four_bar(rod: Rod | None, spatial: bool = False, **loop: object) -> Robot:
    """A four-bar whose lower arm bends, planar or on a turret, with a tool."""
    robot = linkage(rod, crank=0.33 if rod else LEVER, bends=rod is not None, spatial=spatial, **loop)
    return replace(robot, frames=(Frame("tool", "upper", Placement((0.9, 0.0, 0.1))),))


def jointed(pin: Pin | None) -> Robot:
    """A parallelogram whose rod is a body on the crank, joined to the upper arm by a pin or in a point."""
    seat = Placement((-LEVER, -0.069, 0.0))
    bar = Body("bar", "crank", seat, (Joint("knee", "y"),), 6, (0, 0, 0.4), (0.5, 0.5, 0.1))
    ends = Anchor("bar", (0, 0, LOWER)), Anchor("upper", (-LEVER, 0, 0))
    return four_bar(None, loop=Loop("l", ends, pin=pin), further=(bar,))


RIGID, ELASTIC = Rod(0.86, 6.2, 0.4, 0.5), Rod(0.86, 6.2, 0.4, 0.5, 2e7, 3000)
TOOL = ("accelerometer tool z", "frame tool x", "body {} y")
CASES = {
    "bending arm": (bending_arm(), ModelSpec(), (0.4, -0.3), "fore"),
    "constrained, rigid": (four_bar(RIGID), ModelSpec("constrained"), (0.2, 0.1), "upper"),
    "constrained, spatial": (four_bar(ELASTIC, True), ModelSpec("constrained"), (0.3, 0.2, 0.1), "upper"),
    "minimal, rigid": (four_bar(RIGID, True), ModelSpec("minimal"), (0.3, 0.2, 0.1), "upper"),
    "minimal, elastic": (four_bar(ELASTIC), ModelSpec("minimal"), (0.2, 0.1), "upper"),
    "minimal, lumped": (four_bar(ELASTIC), ModelSpec("minimal", "lumped_rod"), (0.2, 0.1), "upper"),
    "series stiffness": (four_bar(ELASTIC), ModelSpec("minimal", "series_stiffness"), (0.2, 0.1), "upper"),
    "planar pin": (jointed(Pin("y", planar=True)), ModelSpec("minimal"), (0.2, 0.1), "upper"),
    "planar pin, constrained": (jointed(Pin("y", planar=True)), ModelSpec("constrained"), (0.2, 0.1), "upper"),
    "bending outside": (four_bar(RIGID), ModelSpec("minimal", "bending_outside"), (0.2, 0.1), "upper"),
}


@pytest.mark.parametrize("case", CASES)
@pytest.mark.slow
def test_derivatives_to_every_coordinate_follow_the_operating_point(case: str) -> None:
    """dG/dtheta of all parameters at once, geometry and what it deflects, against differences of fourth order."""
    robot, spec, angles, body = CASES[case]
    model = formulate(robot, spec, robot.geometry)
    outputs, at = (*robot.motor_locations, *(place.format(body) for place in TOOL)), Configuration("c", angles)
    linearisation = Linearisation.of(model)
    linear = linearisation.at(at, model.theta, outputs, "acceleration")
    kernel = Kernel(linear, LINES, linear.parameters)
    G, dG = Columns(kernel).evaluate(linear.theta_ref)
    np.testing.assert_allclose(G, frequency_response(linear, linear.theta_ref, LINES), rtol=1e-9)
    scale = np.abs(G).max(axis=0)
    found = replace(linearisation, point=None)  # responses alone

    def moved_by(place: int, by: float) -> np.ndarray:
        theta = model.theta.copy()
        theta[place] += by
        there = found.at(at, theta, outputs, "acceleration")
        return frequency_response(there, there.theta_ref, LINES)

    for place, name in enumerate(model.parameters):
        if not (name in robot.geometry or name.startswith(("k_", "m_", "c_", "F0_", "I_rod", "a_"))):
            continue
        size = max(abs(model.theta[place]), 0.3)
        h = 2e-4 * size
        near, far = (moved_by(place, step) - moved_by(place, -step) for step in (h, 2 * h))
        difference = (8 * near - far) / (12 * h)
        error = np.abs(dG[place] - difference)
        allowed = 1e-6 * np.maximum(np.abs(difference).max(axis=0), 1e-2 * scale / size)
        assert np.all(error <= allowed), (name, (error / allowed).max())


@pytest.mark.oracle("mujoco")
def test_mujoco_sees_the_joints_where_they_are() -> None:
    """Mass matrix and weight of the exported tree, joints at points of their own included, in MuJoCo's arithmetic."""
    import mujoco

    arm = bending_arm()
    rigid = replace(rigid_gears(arm), compensators=())
    engine = mujoco.MjModel.from_xml_string(ET.tostring(mjcf(rigid), encoding="unicode"))
    data, model = mujoco.MjData(engine), serial(rigid)
    for q in np.random.default_rng(1).uniform(-0.5, 0.5, (3, model.n_q)):
        data.qpos[:] = q
        mujoco.mj_forward(engine, data)
        M = np.zeros((engine.nv, engine.nv))
        mujoco.mj_fullM(engine, data, M)
        np.testing.assert_allclose(model.mass(q, model.theta).full(), M, rtol=1e-9, atol=1e-9)
        springs = np.array([0, 6e4 * q[1], 2e4 * q[2], 0])
        weight = model.potential_gradient(q, model.theta).full()[:, 0] - springs
        np.testing.assert_allclose(weight, data.qfrc_bias, rtol=1e-9, atol=1e-6)


@pytest.mark.parametrize("pin", [None, Pin("y")])
def test_a_number_that_would_open_a_planar_loop_is_refused(pin: Pin | None) -> None:
    model = formulate(jointed(pin), ModelSpec("minimal"), ("p1_l_y",))
    with refused("robot/loops", place="p1_l_y"):
        linearise(model, Configuration("c", (0.2, 0.1)), model.theta, model.inputs, "acceleration")
