r"""One elastic joint with dry friction at its motor, alone or cut out of a robot whose other joints are held.

.. math:: J_m \ddot q_m + f \dot q_m + \tau_f(\dot q_m, z) + k (q_m - q_l) + d (\dot q_m - \dot q_l) = u, \qquad
          J_l \ddot q_l = k (q_m - q_l) + d (\dot q_m - \dot q_l)

on one side of the gear, with LuGre's bristles z of the motor. Torque is held between samples.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import casadi as ca
import numpy as np

from elastid.base.arrays import FloatArray
from elastid.friction.dynamic import Bristle
from elastid.friction.static import Curve
from elastid.model.formulation import formulate
from elastid.robot import Robot
from elastid.simulation.dynamics import runge_kutta_step

# The friction's numbers, in the order of the arguments.
FRICTION = ("sigma_0", "sigma_1", "coulomb", "stiction", "stribeck_velocity", "viscous")
# The states: angles and velocities of motor and link, deflection of the bristles.
STATES = ("q_m", "v_m", "q_l", "v_l", "z")


@dataclass(frozen=True)
class ElasticJoint:
    """Inertias of motor and link, stiffness and damping of the spring between them, all on one side, SI."""

    motor_inertia: float
    link_inertia: float
    stiffness: float
    damping: float

    def step(self, rate_hz: float, substeps: int = 1, exponent: float = 2.0) -> ca.Function:
        """(x (5,), numbers (6,), u) -> x one sample later, u held.

        substeps: Runge-Kutta steps in a sample; one at 1 kHz has a bristle mode of 30 Hz right to 1e-4.
        exponent: of the Stribeck curve.
        """
        x, p, u = ca.SX.sym("x", len(STATES)), ca.SX.sym("p", len(FRICTION)), ca.SX.sym("u")
        sigma_0, sigma_1, F_c, F_s, nu_s, viscous = ca.vertsplit(p)
        law, curve = Bristle(sigma_0, sigma_1), Curve(F_c, F_s, 1 / nu_s, exponent=exponent)

        def acceleration(q: ca.SX, v: ca.SX, z: ca.SX, torque: ca.SX) -> ca.SX:
            spring = self.stiffness * (q[0] - q[1]) + self.damping * (v[0] - v[1])
            friction = law.torque(v[0], z, curve) + viscous * v[0]
            return ca.vertcat((torque - friction - spring) / self.motor_inertia, spring / self.link_inertia)

        def advanced(z: ca.SX, v: ca.SX, step: float) -> ca.SX:
            return law.advanced(v[0], z, curve, step)

        q, v, z = ca.vertcat(x[0], x[2]), ca.vertcat(x[1], x[3]), x[4]
        for _ in range(substeps):
            q, v, z = runge_kutta_step(acceleration, advanced, q, v, z, [u] * 4, 1 / rate_hz / substeps)
        return ca.Function("step", [x, p, u], [ca.vertcat(q[0], v[0], q[1], v[1], z)], ["x", "p", "u"], ["next"])


def held_joint(robot: Robot, joint: str, angles: FloatArray) -> ElasticJoint | None:
    """Inertias of motor and link, link side, with the spring of the gear; None where it has no such form.

    angles (n_u,): posture in which the other joints are held, their springs and those of undriven joints stiff.
    Without the form: a stiff joint, one in a loop, of coupled gears, or with a spring that is not linear.
    """
    names = [part.name for part in robot.joints]
    index = names.index(joint)
    spec = robot.joints[index]
    if spec.motor is None or not spec.is_flexible or index in robot.joints_in_loops:
        return None
    place = robot.driven_indices.index(index)
    coupled = np.abs(robot.mixing[place]) + np.abs(robot.mixing[:, place])
    if np.count_nonzero(coupled) > 1 or not (spec.spring is None or spec.spring.is_linear):
        return None
    springs = [(spec.spring, 1.0), (spec.motor.spring, robot.ratio(joint) ** 2)]
    compliance = sum(1 / (scale * spring.stiffness) for spring, scale in springs if spring is not None)
    # Of two springs in series the softer one damps.
    damping = min(scale * spring.damping for spring, scale in springs if spring is not None)
    motor, link = held_inertias(robot, joint, angles)(np.array([value for value, _ in robot.parameters().values()]))
    return ElasticJoint(float(motor), float(link), 1 / compliance, damping)


def held_inertias(robot: Robot, joint: str, angles: FloatArray) -> Callable[[FloatArray], FloatArray]:
    """Inertias of motor and link (2,), link side, by the numbers theta of the robot; angles: as of `held_joint`."""
    model = formulate(robot)
    q = np.zeros(model.n_q)
    q[[model.index(f"joint {driven.name}") for driven in robot.driven]] = angles
    for driven, angle in zip(robot.driven, angles, strict=True):
        if driven in robot.flexible:
            q[model.index(f"motor {driven.name}")] = angle
    places = [model.index(f"{part} {joint}") for part in ("motor", "joint")]
    return lambda theta: np.diag(np.asarray(model.mass(q, theta)))[places]
