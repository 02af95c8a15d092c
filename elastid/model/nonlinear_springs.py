r"""Nonlinear springs: their potential and torque beyond the linear k Delta^2 / 2 and k Delta.

.. math:: V = \tfrac13 k_2 \Delta^3 + \tfrac13 k_{2s} |\Delta|^3 + \tfrac14 k_3 \Delta^4
              - \tfrac12 (k - k_i) [F(\Delta + b) - F(\Delta - b) - 2 F(b)], \qquad
          F(x) = \tfrac12 [x \sqrt{x^2 + e^2} + e^2 \,\mathrm{arsinh}(x / e)]

with F' = sqrt(x^2 + e^2), so that the last term takes the torque of the gap from a linear spring. The torque
is written out rather than differentiated: a simulation evaluates it at every step. Law and names: `robot.spring`;
the polynomial: Niglis & Oberg (2015), eq. (2.13).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import casadi as ca
import numpy as np

from elastid.base.arrays import FloatArray
from elastid.model.drivetrain import spring_deflections
from elastid.robot import Robot


def deflections(robot: Robot, q: ca.SX) -> dict[str, ca.SX]:
    """The deflection of each joint's spring, by joint: q_m - q_a of an elastic gear, q_na of an elastic joint.

    A spring before coupled gears is deflected by a combination of all their q_m - q_a (`drivetrain`); one in series
    with the spring of a motor's shaft has no deflection of its own.
    """
    gears = spring_deflections(robot)
    return {
        joint.name: ca.sparsify(ca.DM(gears[f"k_{joint.name}"])).T @ q if joint.is_flexible else q[i]
        for i, joint in enumerate(robot.joints)
        if joint.spring is not None and (not joint.is_flexible or f"k_{joint.name}" in gears)
    }


def nonlinear_springs(robot: Robot, q: ca.SX, theta: Mapping[str, ca.SX]) -> tuple[ca.SX, ca.SX]:
    """V, a scalar, and dV/dq (n_q, 1) beyond the linear springs; theta maps the robot's names to symbols."""
    V, gradient = ca.SX(0), ca.SX(q.size1(), 1)
    deflection = deflections(robot, q)
    for joint in robot.joints:
        if joint.spring is not None and not joint.spring.is_linear:
            x = deflection[joint.name]
            energy, torque = _beyond_linear(joint.name, x, theta)
            V += energy
            gradient += torque * ca.jacobian(x, q).T
    return V, gradient


def on_the_flanks(parameters: Sequence[str], theta: FloatArray) -> FloatArray:
    """theta (n_theta,) with every gap closed, k_i = k: the stiffness that motion meets once it crosses a gap."""
    values = dict(zip(parameters, theta, strict=True))
    return np.array([values[f"k_{name[3:]}"] if name.startswith("ki_") else value for name, value in values.items()])


def tangents(robot: Robot, q: ca.SX, theta: Mapping[str, ca.SX]) -> dict[str, ca.SX]:
    """d tau / d Delta of each joint's spring, by joint: the stiffness that small motion about q meets."""
    return tangents_at(deflections(robot, q), theta)


def tangents_at(deflection: Mapping[str, ca.SX], theta: Mapping[str, ca.SX]) -> dict[str, ca.SX]:
    """The same at given deflections, by joint."""
    x = ca.SX.sym("x")
    stiffness = {name: theta[f"k_{name}"] + ca.gradient(_beyond_linear(name, x, theta)[1], x) for name in deflection}
    return {name: ca.substitute(k, x, deflection[name]) for name, k in stiffness.items()}


def _beyond_linear(joint: str, x: ca.SX, theta: Mapping[str, ca.SX]) -> tuple[ca.SX, ca.SX]:
    energy, torque = ca.SX(0), ca.SX(0)
    if (k2 := theta.get(f"k2_{joint}")) is not None:
        energy, torque = energy + k2 * x**3 / 3, torque + k2 * x**2
    if (k2s := theta.get(f"k2s_{joint}")) is not None:
        energy, torque = energy + k2s * ca.fabs(x) * x**2 / 3, torque + k2s * ca.fabs(x) * x
    if (k3 := theta.get(f"k3_{joint}")) is not None:
        energy, torque = energy + k3 * x**4 / 4, torque + k3 * x**2 * x
    if (b := theta.get(f"b_{joint}")) is not None:
        missing, e = (theta[f"k_{joint}"] - theta[f"ki_{joint}"]) / 2, theta[f"e_{joint}"] * b
        energy -= missing * (_arch(x + b, e) - _arch(x - b, e) - 2 * _arch(b, e))
        torque -= missing * (_root(x + b, e) - _root(x - b, e))
    return energy, torque


def _root(x: ca.SX, e: ca.SX) -> ca.SX:
    """sqrt(x^2 + e^2), the smooth |x|."""
    return ca.sqrt(x**2 + e**2)


def _arch(x: ca.SX, e: ca.SX) -> ca.SX:
    """F, the integral of `_root` from 0."""
    return (x * _root(x, e) + e**2 * ca.asinh(x / e)) / 2
