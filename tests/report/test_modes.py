"""Names of springs, energies of modes by configuration."""

from dataclasses import replace

import numpy as np
import pytest
from plants.arm_modes import ANGLES, ARM, MOTOR, swinging
from plants.report_values import fit_result, pair

from elastid.app.summaries import modes_of
from elastid.base.errors import Note
from elastid.fit.fitted_robot import FittedRobot
from elastid.modal.modes import without_modes
from elastid.modal.spec import GeometrySpec
from elastid.model.formulation import formulate
from elastid.parameters import Parameter, Parameters
from elastid.record import Configuration
from elastid.report.modes import format_energy, load_name, measured_drawing, spring_names
from elastid.response import Response
from elastid.robot import Anchor, Body, CoilSpring, Compensator, Joint, Loop, Robot, Rod, Spring


def test_springs_are_called_what_they_are() -> None:
    """Gears, shafts, what bends or twists amid a link, other joints, rods, and the weight."""
    names = spring_names(ARM)
    assert (names["k_2"], names["km_2"], names["k_b"], names["k_t"]) == (
        "joint 2",
        "shaft of motor 2",
        "bending b",
        "torsion t",
    )
    foot = Body("foot", joints=(Joint("y", "y", Spring(1e6)), Joint("1", "z", Spring(1e5), MOTOR)), inertia=1.0)
    ends = (Anchor("foot"), Anchor("base", (1, 0, 0)))
    loops = (Loop("coupler", ends, rod=Rod(1.0, stiffness=1e6)), Loop("rod", ends, rod=Rod(1.0, stiffness=1e6)))
    robot = Robot("foot", (foot,), loops=loops, compensators=(Compensator("c", ends, CoilSpring(1.0)),))
    names = spring_names(robot)
    assert (names["k_y"], names["k_coupler"], names["k_rod"]) == ("joint y", "rod coupler", "rod")
    assert (load_name(ARM), load_name(robot)) == ("weight", "weight and compensators")
    assert set(formulate(ARM).springs) <= set(spring_names(ARM))
    assert format_energy(["a", "b"], np.array([np.nan, np.nan])) == ""


def test_measured_shapes_move_the_points_of_their_outputs() -> None:
    """Along the direction of each output; the furthest by 0.15 of the size; an output without a point moves none."""
    measured, _ = pair(2, 3)
    measured = replace(measured, outputs=("tip x", "tip -z", "nowhere"))
    modes = replace(
        without_modes(measured, Note("a", "b")), freq_hz=np.array([5.0, 9.0]), zeta=np.ones(2), shapes=SHAPES,
        outputs=measured.outputs, inputs=("u",), participation=np.ones((1, 2)),
    )  # fmt: skip
    geometry = GeometrySpec(points={"foot": (0.0, 0.0, 0.0), "tip": (0.0, 1.0, 2.0)})
    drawn = measured_drawing(modes, geometry)
    moved = np.stack([SHAPES[0], 0 * SHAPES[0], -SHAPES[1]])
    np.testing.assert_allclose(drawn.moved[1], 0.15 * 2.0 * moved / np.linalg.norm(moved, axis=0))
    assert not drawn.moved[0].any()
    assert drawn.links == ((0, 1, "strut"),)
    elsewhere = GeometrySpec(points={"foot": (0.0, 0.0, 0.0), "top": (0.0, 1.0, 2.0)})
    assert measured_drawing(modes, elsewhere) is None


SHAPES = np.array([[1.0, 0.5j], [-0.5, 1.0], [0.3, 0.2]])


def test_energies_follow_the_numbers_of_a_configuration() -> None:
    """A gear that is softer when warm holds more of the energy there; the pendulum of 0.12 Hz is no mode of springs."""
    parameters = Parameters(
        (
            *(Parameter(name, value, free=False) for name, (value, _) in ARM.parameters().items()),
            Parameter("delay", 0.0, "s", free=False),
            Parameter("k_2@warm", 2e5, log=True, only=("warm",)),
        )
    )
    result = replace(
        fit_result(), parameters=parameters, x=parameters.x, covariance=1e-4 * np.eye(1), at_bound=np.zeros(1, bool),
        starts=(), singular_values=np.ones(1),
    )  # fmt: skip
    freq_hz = np.array([5.0, 10.0])
    places, nothing = ARM.motor_locations, np.zeros((2, 3, 3), complex)
    responses = [
        Response(freq_hz, nothing, places, places, "acceleration", Configuration(name, np.array(ANGLES)))
        for name in ("cold", "warm")
    ]
    cold, warm = modes_of(FittedRobot.of(result, ARM, responses))
    assert cold.stores == ("joint 1", "joint 2", "bending b", "torsion t", "joint 3", "weight")
    for row in (cold, warm):
        np.testing.assert_allclose(row.energy.sum(axis=0), 1.0)
        assert row.drawing is not None
    soft = swinging(ARM.with_parameters({"k_2": 2e5}))[1][1:]
    np.testing.assert_allclose(warm.frequency_hz, soft, rtol=1e-9)
    gear = cold.stores.index("joint 2")
    assert warm.energy[gear, 1] != pytest.approx(cold.energy[gear, 1], rel=0.05)
