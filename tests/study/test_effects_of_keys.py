"""Keys that no other test gives have the effect that their text promises."""

from pathlib import Path

import numpy as np
from plants.linkages import LEVER, LOWER, linkage
from plants.two_axes import ROBOT, STUDY

from elastid.app.compare import variants
from elastid.linear.linearise import linearise
from elastid.linear.response.transfer import frequency_response
from elastid.model.formulation import formulate
from elastid.model.spec import ModelSpec
from elastid.record import Configuration
from elastid.robot import Anchor, Body, Joint, Loop, Pin, Placement, Rod
from elastid.study import load


def test_second_pin_axis_is_in_second_body() -> None:
    """A bar whose frame is turned by 90 deg about x closes the same loop; its y axis is the other body's z axis."""
    inertia = (0.64, 0.0, 0.64)
    bar = Body(
        "bar",
        "crank",
        Placement((-LEVER, -0.069, 0.0)),
        (Joint("bar", "y"),),
        6.2,
        (0.0, 0.52 * LOWER, 0.0),
        inertia,
        Placement(rpy=(np.pi / 2, 0.0, 0.0)),
    )
    ends = (Anchor("bar", (0.0, LOWER, 0.0)), Anchor("upper", (-LEVER, 0.0, 0.0)))
    rod = Rod(LOWER, 6.2, 0.52, 0.64)
    at, freq_hz = Configuration("c", (0.4, 0.1)), np.array([5.0, 20.0, 60.0])
    pinned = linkage(loop=Loop("top", ends, Pin((0.0, 0.0, -1.0), other_axis="y")), further=(bar,))
    G = []
    for robot in (pinned, linkage(rod)):
        model = formulate(robot, ModelSpec("constrained"))
        linear = linearise(model, at, model.theta, model.inputs, "acceleration")
        G.append(frequency_response(linear, np.append(model.theta, 0.0), freq_hz))
    np.testing.assert_allclose(G[0], G[1], atol=1e-9 * np.abs(G[1]).max())


def test_variant_motor_coupling_limits_rotors_to_own_axis(tmp_path: Path) -> None:
    """The robot of the variant has no motor that rides on a body."""
    (tmp_path / "robot.yml").write_text(ROBOT)
    (tmp_path / "study.yml").write_text(STUDY)
    override = "compare.variants=[{name: uncoupled, motor_coupling: false}]"
    own, uncoupled = variants(load(tmp_path / "study.yml", [override]))
    assert [bool(joint.motor and joint.motor.on) for joint in own.robot.driven] == [False, True]
    assert [bool(joint.motor and joint.motor.on) for joint in uncoupled.robot.driven] == [False, False]
