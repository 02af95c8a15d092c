"""Modes of a three-axis arm with an elastic link: frequencies, shapes, sticks, and their row in a report."""

from functools import cache

import numpy as np

from elastid.linear.equilibrium import equilibrium
from elastid.linear.linearise import linearise
from elastid.linear.modes import modes, robot_shapes
from elastid.model.formulation import formulate
from elastid.model.kinematics import StickFigure, stick_figure
from elastid.record import Configuration
from elastid.report.modes import ModeRow, mode_drawing
from elastid.robot import Body, Frame, Joint, Motor, Placement, Robot, Spring

MOTOR = Motor(1e-3, 100.0, 2e-3)
ARM = Robot(
    "arm",
    (
        Body("turret", "base", Placement((0, 0, 0.4)), (Joint("1", "z", Spring(3e5, 900), MOTOR),),
             80, (0, 0, 0.1), 6.0),
        Body("upper", "turret", Placement((0.2, 0, 0.3)), (Joint("2", "y", Spring(4e5, 300), MOTOR),),
             40, (0, 0, 0.4), 2.0),
        Body("half", "upper", Placement((0, 0, 0.4)),
             (Joint("b", "y", Spring(9e5, 90)), Joint("t", "z", Spring(2e5, 20))), 20, (0, 0, 0.2), 1.0),
        Body("fore", "half", Placement((0, 0, 0.4)), (Joint("3", "y", Spring(2e5, 200), MOTOR),),
             30, (0.3, 0.1, 0), 2.0),
    ),
    frames=(Frame("tool", "fore", Placement((0.8, 0.1, 0))),),
)  # fmt: skip
ANGLES = (0.4, 0.3, -0.2)


@cache
def swinging(robot: Robot = ARM) -> tuple[np.ndarray, np.ndarray, np.ndarray, StickFigure]:
    """Joints at rest (n_l,), frequencies, the joints' part of the shapes, and the sticks."""
    model = formulate(robot)
    at = Configuration("c1", np.array(ANGLES))
    linear = linearise(model, at, model.theta, model.inputs, "position")
    found = modes(linear, linear.theta_ref)
    n_l = len(robot.joints)
    q = equilibrium(model, model.theta, at).q[:n_l]
    return q, found.freq_hz, robot_shapes(linear, found.shapes)[:n_l], stick_figure(robot, q)


@cache
def mode_row(name: str = "c1") -> ModeRow:
    _, freq_hz, shapes, figure = swinging()
    energy = np.full((2, len(freq_hz)), 0.5)
    energy[:, 0] = 0.925, 0.075
    drawing = mode_drawing(figure, shapes, ARM.gravity)
    coordinates = tuple(f"joint {joint.name}" for joint in ARM.joints)
    zeta = np.full(len(freq_hz), 0.0421)
    return ModeRow(
        name, freq_hz, zeta, coordinates=coordinates, shapes=shapes, stores=("gear 2", "rod"), energy=energy,
        drawing=drawing,
    )  # fmt: skip
