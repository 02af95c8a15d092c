r"""Nonlinear springs and gravity compensators: potentials, torques, deflection and stored energy in a small motion.

.. math:: V = \tfrac13 k_2 \Delta^3 + \tfrac13 k_{2s} |\Delta|^3 + \tfrac14 k_3 \Delta^4
              - \tfrac12 (k - k_i) [F(\Delta + b) - F(\Delta - b) - 2 F(b)], \qquad
          F(x) = \tfrac12 [x \sqrt{x^2 + e^2} + e^2 \,\mathrm{arsinh}(x / e)]

with F' = sqrt(x^2 + e^2), so that the last term takes the torque of the gap from a linear spring. The torque
is written out rather than differentiated: a simulation evaluates it at every step. Law and names: `robot.spring`;
the polynomial: Niglis & Oberg (2015), eq. (2.13).

A compensator at the distance L between its two points has the potential

.. math:: V_{coil} = \tfrac12 k_c (L - L_0)^2, \qquad
          V_{gas} = F_0 h_0 \int_0^1 \ell\, e^{(\kappa - 1) \ell t}\, dt, \quad \ell = \ln (h_0 / h), \quad
          h = h_0 + s (L - L_0)

Their torque -dV/dq is tau_g of Niglis & Oberg (2015), eq. (2.32). s = 1 for a strut that pushes, -1 for a cylinder that
draws; the integral is [(h_0 / h)^(kappa - 1) - 1] / (kappa - 1), which is 0 / 0 at kappa = 1. dV/dq = (dV/dL) / (2 L)
d(L^2)/dq is written out: a simulation evaluates it at every step.

.. math:: E_s = \tfrac12\, c_s\, (b_s\, dq)^2, \qquad b_s = \partial x_s / \partial q

with the tangent stiffness c_s and the deflection x_s. Of springs in series x_s is the torque that each bears, that of
X^T K_a (q_m - q_a) in the letters of `drivetrain`, and c_s = 1 / k_s. Preload, which turns with the robot, is no part
of it: with the weight it makes the rest of the energy of K.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import casadi as ca
import numpy as np

from elastid.base.arrays import FloatArray
from elastid.model.drivetrain import gear_deflections, series_stiffness, spring_deflections
from elastid.model.frame_tree import Tree, Turn, between, located, seat
from elastid.robot import Compensator, Robot


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


def on_the_flanks(parameters: Sequence[str], theta: FloatArray) -> FloatArray:
    """theta (n_theta,) with every gap closed, k_i = k: the stiffness that motion meets once it crosses a gap."""
    values = dict(zip(parameters, theta, strict=True))
    return np.array([values[f"k_{name[3:]}"] if name.startswith("ki_") else value for name, value in values.items()])


def tangents(deflection: Mapping[str, ca.SX], theta: Mapping[str, ca.SX]) -> dict[str, ca.SX]:
    """d tau / d Delta of each joint's spring at its deflection, by joint: the stiffness that small motion meets."""
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


@dataclass(frozen=True, eq=False)
class Strain:
    """A spring by its parameter's name: k_<joint>, km_<joint> or k_<rod>; stiffness c and deflection x, scalars."""

    spring: str
    stiffness: ca.SX
    deflection: ca.SX


def joint_springs(robot: Robot, q: ca.SX, theta: Mapping[str, ca.SX]) -> tuple[ca.SX, ca.SX, tuple[Strain, ...]]:
    """The springs of gears, motor shafts and elastic joints at q (n_q,); theta maps the robot's names to symbols.

    V, a scalar, and dV/dq (n_q, 1) beyond the linear springs, and the strain of every spring.
    """
    V, gradient = ca.SX(0), ca.SX(q.size1(), 1)
    deflection, shafts = deflections(robot, q), spring_deflections(robot)
    for joint in robot.joints:
        if joint.spring is not None and not joint.spring.is_linear:
            x = deflection[joint.name]
            energy, torque = _beyond_linear(joint.name, x, theta)
            V += energy
            gradient += torque * ca.jacobian(x, q).T
    tangent = tangents(deflection, theta)
    strains = [Strain(f"k_{joint}", tangent[joint], x) for joint, x in deflection.items()]
    strains += [Strain(name, theta[name], ca.DM(z).T @ q) for name, z in shafts.items() if name.startswith("km_")]
    for box in robot.gearboxes:
        if box.is_in_series:
            delta = ca.DM(gear_deflections(robot)[list(box.gears)])
            # x_s^T K_a (n_s, n_q): each spring bears this times q.
            torques = ca.vertsplit(ca.DM(box.X).T @ series_stiffness(box, theta) @ delta)
            strains += [
                Strain(name, 1 / theta[name], torque @ q) for name, torque in zip(box.springs, torques, strict=True)
            ]
    return V, gradient, tuple(strains)


# Nodes of Gauss and Legendre for the gas: exact to 1e-14 for columns that change by a factor of 5.
_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(7)


def compensators(
    robot: Robot, layout: Tree, turned: tuple[Turn, ...], q: ca.SX, theta: Mapping[str, ca.SX]
) -> tuple[ca.SX, ca.SX]:
    """V, a scalar, and dV/dq (n_q, 1) of all compensators; the joints that `turned` turns are among q."""
    V, gradient = ca.SX(0), ca.SX(q.size1(), 1)
    for compensator in robot.compensators:
        first, second = (
            (seat(robot, layout, end.body), located(f"pc{i}_{compensator.name}", end.point, theta))
            for i, end in enumerate(compensator.ends, start=1)
        )
        square = ca.sumsqr(between(layout, turned, first, second))
        # Two points that meet are 1 nm apart, so that a coil without rest length has its derivatives there too.
        L = ca.sqrt(square + 1e-9**2)
        energy, force = (_coil if compensator.coil is not None else _gas)(compensator, L, theta)
        V += energy
        gradient += force / (2 * L) * ca.gradient(square, q)
    return V, gradient


def _coil(compensator: Compensator, L: ca.SX, theta: Mapping[str, ca.SX]) -> tuple[ca.SX, ca.SX]:
    k, L0 = (theta[f"{letter}_{compensator.name}"] for letter in ("kc", "L0"))
    return k * (L - L0) ** 2 / 2, k * (L - L0)


def _gas(compensator: Compensator, L: ca.SX, theta: Mapping[str, ca.SX]) -> tuple[ca.SX, ca.SX]:
    F0, L0, h0, kappa = (theta[f"{letter}_{compensator.name}"] for letter in ("F0", "L0", "h0", "kappa"))
    s = 1 if compensator.gas is not None and compensator.gas.action == "push" else -1
    log = ca.log(h0 / (h0 + s * (L - L0)))
    integral = sum(
        weight / 2 * ca.exp((kappa - 1) * log * (1 + t) / 2) for t, weight in zip(_NODES, _WEIGHTS, strict=True)
    )
    return F0 * h0 * log * integral, -s * F0 * ca.exp(kappa * log)
