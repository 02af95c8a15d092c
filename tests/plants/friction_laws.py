"""A friction law as functions of numbers, and stepped along a motion."""

import casadi as ca
import numpy as np

from elastid.friction.robot_friction import PlacedLaw, frictions
from elastid.friction.static import Curve, Law
from elastid.robot import Body, Friction, Joint, Motor, Robot


class Numeric:
    """A law as functions of numbers."""

    def __init__(self, law: Law, curve: Curve, step: float = 1e-4) -> None:
        v, z = ca.SX.sym("v"), ca.SX.sym("z", law.n_states)
        after = law.advanced(v, z, curve, step)
        self.n = law.n_states
        self.torque = ca.Function("torque", [v, z], [law.torque(v, z, curve)])
        self.path = ca.Function("step", [z, v], [after, law.torque(v, after, curve)])

    def follow(self, v: np.ndarray, z: np.ndarray | None = None) -> tuple[np.ndarray, np.ndarray]:
        """States (n, n_z) and torques (n,) after each of n steps at the velocities v (n,)."""
        walk = self.path.mapaccum("walk", len(v))
        start = np.zeros(self.n) if z is None else z
        states, torque = walk(start, v[None])
        return states.full().T, torque.full()[0]


def placed(spec: Friction, ratio: float = 1.0, viscous: float = 10.0) -> PlacedLaw:
    """The law of a motor."""
    motor = Motor(1e-3, ratio, viscous, friction=spec)
    (one,) = frictions(Robot("r", (Body("a", joints=(Joint("1", "z", motor=motor),), inertia=1.0),)))
    return one
