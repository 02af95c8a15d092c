"""Names, places and readings of an ElasticModel, in closed form."""

from __future__ import annotations

import numpy as np

from elastid.model.formulation import serial
from elastid.robot import Body, Frame, Joint, Motor, Placement, Robot, Spring

MOTOR = Motor(1e-3, 80)


def arm() -> Robot:
    """An elastically geared joint, a rigidly geared one and a free one about y; a frame 0.5 m up the last body."""
    bodies = (
        Body("a", joints=(Joint("1", "y", Spring(5e4, 40), MOTOR),), mass=20, center_of_mass=(0, 0, 0.3), inertia=1.0),
        Body("b", "a", Placement((0, 0, 0.6)), (Joint("2", "y", motor=MOTOR),), 9, (0, 0, 0.2), 0.3),
        Body("c", "b", Placement((0, 0, 0.4)), (Joint("3", "y"),), 3, (0, 0, 0.2), 0.1),
    )
    return Robot("arm", bodies, (0.0, 0.0, -9.81), frames=(Frame("tip", "c", Placement((0, 0, 0.5))),))


def test_places_read_their_rates_and_an_accelerometer_gravity_as_it_tilts() -> None:
    """Upright: the tip moves by 1.5, 0.9 and 0.5 m along x per rad; tilted it sees g of gravity along -x per rad."""
    model = serial(arm())
    q, places = np.zeros(4), ("motor 1", "joint 3", "body c y", "frame tip x", "frame tip ry", "accelerometer tip x")
    C, T = (part.full() for part in model.readout(q, model.theta, places))
    expected = [[0, 0, 0, 1], [0, 0, 1, 0], [1, 1, 1, 0], [1.5, 0.9, 0.5, 0], [1, 1, 1, 0], [1.5, 0.9, 0.5, 0]]
    np.testing.assert_allclose(C, expected, atol=1e-12)
    np.testing.assert_allclose(T[:5], 0)
    np.testing.assert_allclose(T[5], [-9.81, -9.81, -9.81, 0])
    np.testing.assert_allclose(model.output_jacobian(q, places), C)
