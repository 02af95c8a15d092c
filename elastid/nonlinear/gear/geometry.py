r"""Torques that a rigid arm takes beyond those of its linearisation, along the motion that was measured.

.. math:: \tau_g = M(q_0 + \delta)\, \ddot\delta + f(q_0 + \delta, \dot\delta)
                   - M(q_0)\, \ddot\delta - f(q_0, 0) - \partial f / \partial q\, \delta

They are distortion that a straight spring passes on, of second and third order in the motion delta of the joints. Of a
carrier's slow turn they look like errors of transmission, which are functions of the angle, too.
"""

from __future__ import annotations

from dataclasses import replace

import casadi as ca
import numpy as np
from numpy.fft import irfft, rfft

from elastid.base.arrays import ComplexArray, FloatArray
from elastid.linear.equilibrium import equilibrium
from elastid.model.formulation import serial
from elastid.nonlinear.gear.drive_lines import DriveLines
from elastid.nonlinear.gear.period_lines import PeriodLines
from elastid.record import Configuration
from elastid.robot import Robot

# Points of a period over the highest line of the motion: products of three of them are not folded onto lines.
POINTS = 8
REACH = 2  # times the highest line of the motion, up to which the torques are kept
# Parameters of torques that are no arm's: springs, dampers and friction of joints and motors.
ELASTIC = ("k_", "d_", "fm_", "f_")


def geometric_torques(robot: Robot, at: Configuration, motion: ComplexArray, s: ComplexArray) -> ComplexArray:
    """tau_g (F, n, M) of the driven joints of a robot without loops on lines s (F,), by amplitudes of motion (F, n, M).

    Masses and lengths are those of the robot's file.
    """
    model = serial(robot)
    E = np.zeros((model.n_q, len(robot.driven)))  # motors turn with their joints: no gear is wound up
    for column, joint in zip(E.T, robot.driven, strict=True):
        column[[model.index(f"{side} {joint.name}") for side in ("joint", "motor")]] = 1.0
    theta = model.carried(np.array(model.theta), at.carries)
    q0 = equilibrium(model, model.theta, at).q
    rigid = np.where([name.startswith(ELASTIC) for name in model.parameters], 0.0, theta)
    F, _, M = motion.shape
    torque = _torque(model.mass, model.force, q0, E, rigid).map(POINTS * (F + 1))
    result = np.empty(motion.shape, dtype=complex)
    for m in range(M):
        delta, v, a = (_signals(motion[:, :, m] * s[:, None] ** order) for order in range(3))
        tau = torque(delta.T, v.T, a.T).full()
        result[:, :, m] = rfft(tau).T[1 : F + 1] * (2 / tau.shape[1])
    return result


def without_arm(lines: PeriodLines, drive: DriveLines, robot: Robot) -> PeriodLines:
    """The lines with the motion by tau_g taken out of their angles; as they are of a robot with loops.

    The motion of the joints is that of the model `drive` under such torques at the motors as make the measured angles.
    """
    if robot.loops:
        return lines
    top = int(np.flatnonzero(lines.excited)[-1]) + 1
    H, s = drive.H[:top], lines.s
    y = lines.Y[:top] / drive.sensor[:top, :, None]
    motion = drive.places["link"] @ H @ drive.B @ np.linalg.solve(drive.C @ H @ drive.B, y)
    reach = min(REACH * top, len(s))
    padded = np.zeros((reach, *motion.shape[1:]), complex)
    padded[:top] = motion
    tau = geometric_torques(robot, lines.configuration, padded, s[:reach])
    Y = lines.Y.copy()
    Y[:reach] += drive.sensor[:reach, :, None] * (drive.C @ drive.H[:reach] @ drive.places["link"].T @ tau)
    return replace(lines, Y=Y)


def _torque(mass: ca.Function, force: ca.Function, q0: FloatArray, moved: FloatArray, theta: FloatArray) -> ca.Function:
    """tau_g (n,) of delta, its velocity and acceleration (n,); moved (n_q, n): coordinates by delta."""
    n, E = moved.shape[1], ca.DM(moved)
    delta, v, a = (ca.SX.sym(name, n) for name in ("delta", "v", "a"))

    def whole(delta: ca.SX, v: ca.SX) -> ca.SX:
        q = ca.DM(q0) + E @ delta
        return E.T @ (mass(q, theta) @ (E @ a) + force(q, E @ v, theta))

    tau = whole(delta, v)
    still = ca.SX.zeros(n)
    slope = ca.substitute(ca.jacobian(tau, delta), ca.vertcat(delta, v, a), ca.vertcat(still, still, still))
    return ca.Function("geometric", [delta, v, a], [tau - whole(still, still) - slope @ delta], {"cse": True})


def _signals(X: ComplexArray) -> FloatArray:
    """(POINTS (F + 1), n) of amplitudes (F, n) of lines 1 to F."""
    n = POINTS * (len(X) + 1)
    padded = np.zeros((n // 2 + 1, X.shape[1]), complex)
    padded[1 : len(X) + 1] = X
    return np.asarray(irfft(padded, n, axis=0) * (n / 2))
