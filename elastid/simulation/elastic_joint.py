r"""One elastic joint with dry friction at its motor, the numbers of the friction as arguments: one step of it.

.. math:: J_m \ddot q_m + f \dot q_m + \tau_f(\dot q_m, z) + k (q_m - q_l) + d (\dot q_m - \dot q_l) = u, \qquad
          J_l \ddot q_l = k (q_m - q_l) + d (\dot q_m - \dot q_l)

on one side of the gear, with LuGre's bristles z of the motor. Torque is held between samples.
"""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca

from elastid.friction.dynamic import Bristle
from elastid.friction.law import Curve
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
            q, v, z = runge_kutta_step(acceleration, advanced, q, v, z, [u, u, u], 1 / rate_hz / substeps)
        return ca.Function("step", [x, p, u], [ca.vertcat(q[0], v[0], q[1], v[1], z)], ["x", "p", "u"], ["next"])
