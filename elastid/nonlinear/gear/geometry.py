r"""Torques that a rigid arm takes beyond those of its linearisation, along the motion that was measured.

.. math:: \tau_g = M(q_0 + \delta)\, \ddot\delta + f(q_0 + \delta, \dot\delta)
                   - M(q_0)\, \ddot\delta - f(q_0, 0) - \partial f / \partial q\, \delta

They are distortion that a straight spring passes on, of second and third order in the motion delta of the joints.
"""

from __future__ import annotations

import casadi as ca
import numpy as np
from numpy.fft import irfft, rfft

from elastid.base.arrays import ComplexArray, FloatArray
from elastid.linear.equilibrium import equilibrium
from elastid.model.formulation import serial
from elastid.record import Configuration
from elastid.robot import Robot

# Points of a period over the highest line of the motion: products of three of them are not folded onto lines.
POINTS = 8
# Parameters that make no torque on a rigid arm: springs, dampers and friction of joints and motors.
ELASTIC = ("k_", "d_", "fm_", "f_")


def geometric_torques(robot: Robot, at: Configuration, motion: ComplexArray, s: ComplexArray) -> ComplexArray:
    """tau_g (F, n, M) of the driven joints of a robot without loops on lines s (F,), by amplitudes of motion (F, n, M).

    Masses and lengths are those of the robot's file.
    """
    model = serial(robot)
    rows = [model.index(f"joint {joint.name}") for joint in robot.driven]
    theta = model.carried(np.array(model.theta), at.carries)
    q0 = equilibrium(model, model.theta, at).q
    rigid = np.where([name.startswith(ELASTIC) for name in model.parameters], 0.0, theta)
    F, _, M = motion.shape
    torque = _torque(model.mass, model.force, q0, rows, rigid).map(POINTS * (F + 1))
    result = np.empty(motion.shape, dtype=complex)
    for m in range(M):
        delta, v, a = (_signals(motion[:, :, m] * s[:, None] ** order) for order in range(3))
        tau = torque(delta.T, v.T, a.T).full()
        result[:, :, m] = rfft(tau).T[1 : F + 1] * (2 / tau.shape[1])
    return result


def _torque(mass: ca.Function, force: ca.Function, q0: FloatArray, rows: list[int], theta: FloatArray) -> ca.Function:
    """tau_g (n,) of delta, its velocity and acceleration (n,)."""
    delta, v, a = (ca.SX.sym(name, len(rows)) for name in ("delta", "v", "a"))
    E = ca.DM(np.eye(len(q0))[:, rows])

    def whole(delta: ca.SX, v: ca.SX) -> ca.SX:
        q = ca.DM(q0) + E @ delta
        return E.T @ (mass(q, theta) @ (E @ a) + force(q, E @ v, theta))

    tau = whole(delta, v)
    still = ca.SX.zeros(len(rows))
    slope = ca.substitute(ca.jacobian(tau, delta), ca.vertcat(delta, v, a), ca.vertcat(still, still, still))
    return ca.Function("geometric", [delta, v, a], [tau - whole(still, still) - slope @ delta], {"cse": True})


def _signals(X: ComplexArray) -> FloatArray:
    """(POINTS (F + 1), n) of amplitudes (F, n) of lines 1 to F."""
    n = POINTS * (len(X) + 1)
    padded = np.zeros((n // 2 + 1, X.shape[1]), complex)
    padded[1 : len(X) + 1] = X
    return np.asarray(irfft(padded, n, axis=0) * (n / 2))
