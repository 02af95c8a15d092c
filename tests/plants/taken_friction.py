"""A robot, and friction that was taken out of one motor of two, made up: a sign and a bristle of known levels."""

import numpy as np

from elastid.base.errors import Note
from elastid.nonlinear.compensated_friction import CompensatedFriction
from elastid.nonlinear.friction_basis import BasisFunction
from elastid.robot import Body, Joint, Motor, Robot, Spring

LEVELS, STDS, THRESHOLD = (3.0, 1.5), (0.1, 0.2), 2e-3
LEFT = "no friction was taken out of the torque: it leaves 98 % of the power"
ROUGH, SMOOTH = Motor(1e-3, 50, 1e-3, coulomb=0.1), Motor(1e-3, 50, 1e-3)
ROBOT = Robot(
    "an elastic axis and two rigid ones",
    (
        Body("a", joints=(Joint("1", "z", Spring(1e4, 10.0), ROUGH, 1.0),), inertia=1.0),
        Body("b", "a", joints=(Joint("2", "y", None, ROUGH, 1.0),), inertia=1.0),
        Body("c", "b", joints=(Joint("3", "y", None, SMOOTH, 1.0),), inertia=1.0),
    ),
)


def taken_friction() -> CompensatedFriction:
    """At motor 1, in Nm; motor 2 slides and keeps its friction."""
    return CompensatedFriction(
        places=("motor 1", "motor 2"),
        place_units=("N*m", "N"),
        shapes=(BasisFunction("motor 1", "sign"), BasisFunction("motor 1", "stop", THRESHOLD)),
        coulomb_torque=np.array(LEVELS),
        covariance=np.diag(np.square(STDS)),
        configurations=("c1", "c2"),
        before=np.array([[0.41, 0.62], [0.43, 0.64]]),
        after=np.array([[0.11, 0.62], [0.13, 0.64]]),
        residual_power_ratio=np.array([0.0321, 0.98]),
        accelerance=np.array([0.2, 0.3]),
        notes=(
            Note("nonlinear/friction-compensated", "friction was taken out", "motor 1", "information"),
            Note("nonlinear/friction-not-compensated", LEFT, "motor 2", "information"),
        ),
    )
