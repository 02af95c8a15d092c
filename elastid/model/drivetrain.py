r"""The drivetrain of a robot: motors, gears, springs, dampers and viscous friction as energies, all on the link side.

.. math:: T_m = \tfrac12 \sum_i J_{m,i} (\eta\, \dot q_m)_i^2, \quad V_s = \tfrac12 \delta^T K_a \delta, \quad
          R = \tfrac12 \Big( \dot\delta^T D_a \dot\delta + \sum f \dot q_a^2 + \sum_i f_{m,i} (\eta \dot q_m)_i^2 \Big)

Niglis & Oberg (2015), eqs. (2.8a), (2.8b), with the deflections delta = q_m - q_a of elastic gears and delta = q_na of
joints that are elastic but not driven. This is the only place where gear ratios are applied to the model.
eta (n_u, n_u): turns of the motors per turn of the joints, not diagonal where gears couple axes; motor coordinates are
q_m = eta^-1 q_m^m, motor torques u = eta^T tau_m^m, so that a frequency response of motors is G^a = eta^-1 G^m eta^-T.

Spring s turns the joints by x_s k_s^-1 per torque x_s^T tau: compliances of springs in series, before, between and
after the stages of the gears, add,

.. math:: K_a^{-1} = \sum_s x_s k_s^{-1} x_s^T, \qquad D_a = K_a \Big( \sum_s x_s \frac{d_s}{k_s^2} x_s^T \Big) K_a

the damping to first order in omega d / k, below which a gearbox stays. Where there are no more springs than joints,
K_a = Z^T K Z with Z = X^-1, eta before the gears, 1 after them, exactly linear in each k, as is D_a: eqs. (2.24),
(2.26) to (2.30). Where there are fewer, since some of the coupled gears have no spring, the rigid directions are
constraints, N^T delta = 0 with N^T X = 0, and K_a acts on the deflections that X spans.

A rotor that rides on a body adds the inertial coupling S and the Coriolis terms C_1 and C_2 of the complete model:

.. math:: T = \tfrac12 \sum_i J_i w_i^2, \qquad w_i = a_i \cdot \omega_{carrier,i}(q_l, \dot q_l) + (\eta\, \dot q_m)_i

Each rotor is symmetric about its axis a_i, fixed to its carrier, and turns with q_m relative to it. With Y = dw/dv the
equations of motion get

.. math:: M = Y^T J\, Y, \qquad S = \partial^2 T / \partial \dot q_l\, \partial \dot q_m, \qquad
          c = Y^T J\, \dot w|_{\dot v = 0} + \dot Y^T J w - (\partial w / \partial q)^T J w

Niglis & Oberg (2015), eqs. (2.22), (3.1), (3.4): c is C_1 in the rows of the links, at most linear in q_m', and C_2 in
those of the motors, free of q_m'. S is strictly upper triangular only where motor i rides on link i - 1, which is not
so in eq. (3.2).

A nonlinear spring has beyond its linear part

.. math:: V = \tfrac13 k_2 \Delta^3 + \tfrac13 k_{2s} |\Delta|^3 + \tfrac14 k_3 \Delta^4
              - \tfrac12 (k - k_i) [F(\Delta + b) - F(\Delta - b) - 2 F(b)], \qquad
          F(x) = \tfrac12 [x \sqrt{x^2 + e^2} + e^2 \,\mathrm{arsinh}(x / e)]

with F' = sqrt(x^2 + e^2), so that the last term takes the torque of the gap from a linear spring. The torque is written
out rather than differentiated: a simulation evaluates it at every step. Law and names: `robot.spring`; the polynomial:
Niglis & Oberg (2015), eq. (2.13).

The energy of a spring in a small motion is

.. math:: E_s = \tfrac12\, c_s\, (b_s\, dq)^2, \qquad b_s = \partial x_s / \partial q

with the tangent stiffness c_s and the deflection x_s. For springs in series x_s is the torque X^T K_a (q_m - q_a) of
each spring, and c_s = 1 / k_s. The preload, which turns with the robot, is not included: together with the weight it
is the rest of the energy of K.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np

from elastid.base.arrays import FloatArray
from elastid.robot import BASE, Robot, unit_axis
from elastid.robot.gears import Gearbox


def input_matrix(robot: Robot) -> FloatArray:
    """Return B (n_q, n_u): a link-side torque acts on its motor's coordinate, or the joint's for a rigid gear.

    eta B^T (n_u, n_q): how fast each rotor turns in its housing per rate of the coordinates, motor side.
    """
    n_l = robot.n_l
    B = np.zeros((n_l + len(robot.flexible), robot.n_u))
    for i, (joint, index) in enumerate(zip(robot.driven, robot.driven_indices, strict=True)):
        B[n_l + robot.flexible.index(joint) if joint in robot.flexible else index, i] = 1.0
    return B


def drivetrain(robot: Robot, theta: Mapping[str, ca.SX]) -> tuple[ca.SX, ca.SX, ca.SX]:
    """Return M, D, K (n_q, n_q), the quadratic forms of T_m, R and V_s, with rotors that have no carrier.

    theta maps every name of robot.parameters() to its symbol.
    """
    n_q = robot.n_l + len(robot.flexible)
    inertia, damping, stiffness = (list[tuple[str, FloatArray]]() for _ in range(3))
    for joint, rate in zip(robot.joints, np.eye(n_q), strict=False):
        damping.append((f"f_{joint.name}", rate))
        if joint.spring is not None and not joint.is_flexible:
            stiffness.append((f"k_{joint.name}", rate))
            damping.append((f"d_{joint.name}", rate))
    for joint, turning in zip(robot.driven, robot.eta @ input_matrix(robot).T, strict=True):
        damping.append((f"fm_{joint.name}", turning))
        if joint.motor is not None and not joint.motor.on:
            inertia.append((f"Jm_{joint.name}", turning))
    for name, z in spring_deflections(robot).items():
        stiffness.append((name, z))
        damping.append((f"d{name[1:]}", z))
    M, D, K = (
        sum((theta[name] * (y @ y.T) for name, y in sparse), start=ca.SX(n_q, n_q))
        for sparse in ([(name, ca.sparsify(ca.DM(y))) for name, y in terms] for terms in (inertia, damping, stiffness))
    )
    delta = gear_deflections(robot)
    for box in robot.gearboxes:
        if box.is_in_series:
            X, to_q, K_a = ca.DM(box.X), ca.DM(delta[list(box.gears)]), series_stiffness(box, theta)
            slowness = [theta[f"d{name[1:]}"] / theta[name] ** 2 for name in box.springs]
            losses = sum((slow * X[:, s] @ X[:, s].T for s, slow in enumerate(slowness)), start=ca.SX(0))
            K, D = K + to_q.T @ K_a @ to_q, D + to_q.T @ (K_a @ losses @ K_a) @ to_q
    return M, D, K


def gear_deflections(robot: Robot) -> FloatArray:
    """Return delta = q_m - q_a of each driven joint as rows (n_u, n_q); zero rows for rigid gears."""
    rows = input_matrix(robot).T
    rows[range(len(rows)), robot.driven_indices] -= 1.0
    return rows


def spring_deflections(robot: Robot) -> dict[str, FloatArray]:
    """Return z (n_q,), by name k_..., with deflection z q of springs in elastic gears; None for springs in series."""
    delta = gear_deflections(robot)
    rows: dict[str, FloatArray] = {}
    for box in robot.gearboxes:
        if not box.is_in_series:
            rows |= dict(zip(box.springs, box.deflections @ delta[list(box.gears)], strict=True))
    return rows


def series_stiffness(box: Gearbox, theta: Mapping[str, ca.SX]) -> ca.SX:
    """Return K_a (n_g, n_g) of a gearbox, compliances added, on the deflections that its springs allow."""
    U = ca.sparsify(ca.DM(box.range))
    X = U.T @ ca.DM(box.X)
    compliance = sum((1 / theta[name] * X[:, s] @ X[:, s].T for s, name in enumerate(box.springs)), start=ca.SX(0))
    return U @ ca.inv(compliance) @ U.T


def deflections(robot: Robot, q: ca.SX) -> dict[str, ca.SX]:
    """Return the deflection of each joint's spring, by joint: q_m - q_a of an elastic gear, q_na of an elastic joint.

    A spring before coupled gears is deflected by a combination of all their q_m - q_a; one in series
    with the spring of a motor's shaft has no deflection of its own.
    """
    gears = spring_deflections(robot)
    return {
        joint.name: ca.sparsify(ca.DM(gears[f"k_{joint.name}"])).T @ q if joint.is_flexible else q[i]
        for i, joint in enumerate(robot.joints)
        if joint.spring is not None and (not joint.is_flexible or f"k_{joint.name}" in gears)
    }


def on_the_flanks(parameters: Sequence[str], theta: FloatArray) -> FloatArray:
    """Return theta (n_theta,) with every gap closed, k_i = k: the stiffness for motion that crosses a gap."""
    values = dict(zip(parameters, theta, strict=True))
    return np.array([values[f"k_{name[3:]}"] if name.startswith("ki_") else value for name, value in values.items()])


def tangents(deflection: Mapping[str, ca.SX], theta: Mapping[str, ca.SX]) -> dict[str, ca.SX]:
    """Return d tau / d Delta of each joint's spring at its deflection, by joint: the stiffness for small motion."""
    x = ca.SX.sym("x")
    stiffness = {name: theta[f"k_{name}"] + ca.gradient(_beyond_linear(name, x, theta)[1], x) for name in deflection}
    return {name: ca.substitute(k, x, deflection[name]) for name, k in stiffness.items()}


def spring_torque(joint: str, x: ca.SX, theta: Mapping[str, Any]) -> ca.SX:
    """Return n(x), a scalar, of the spring of a joint at a deflection x; theta: numbers or symbols by name."""
    torque: ca.SX = theta[f"k_{joint}"] * x + _beyond_linear(joint, x, theta)[1]
    return torque


def _beyond_linear(joint: str, x: ca.SX, theta: Mapping[str, Any]) -> tuple[ca.SX, ca.SX]:
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
    """Return sqrt(x^2 + e^2), the smooth |x|."""
    return ca.sqrt(x**2 + e**2)


def _arch(x: ca.SX, e: ca.SX) -> ca.SX:
    """Return F, the integral of `_root` from 0."""
    return (x * _root(x, e) + e**2 * ca.asinh(x / e)) / 2


@dataclass(frozen=True, eq=False)
class Strain:
    """A spring by its parameter's name: k_<joint>, km_<joint> or k_<rod>; stiffness c and deflection x, scalars."""

    spring: str
    stiffness: ca.SX
    deflection: ca.SX


def joint_springs(robot: Robot, q: ca.SX, theta: Mapping[str, ca.SX]) -> tuple[ca.SX, ca.SX, tuple[Strain, ...]]:
    """Return springs of gears, motor shafts and elastic joints at q (n_q,); theta maps the robot's names to symbols.

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


def rotors(
    robot: Robot, theta: Mapping[str, ca.SX], q: ca.SX, v: ca.SX, angular_velocity: ca.SX
) -> tuple[ca.SX, ca.SX]:
    """Return M (n_q, n_q) and Coriolis and centrifugal forces c (n_q,) of all rotors that have a carrier.

    q, v (n_q,): coordinates and rates.  angular_velocity (3 n_bodies, n_q): J v of the bodies in their own axes.
    """
    n_q, bodies = v.size1(), [body.name for body in robot.bodies]
    rates, inertias = [], []
    for joint, turning in zip(robot.driven, robot.eta @ input_matrix(robot).T, strict=True):
        motor = joint.motor
        if motor is None or motor.axis is None:
            continue
        Y = ca.SX(ca.sparsify(ca.DM(turning)).T)
        if motor.on != BASE:
            row = 3 * bodies.index(motor.on)
            # A motor on a body turns with it about its axis.
            Y += ca.sparsify(ca.DM(unit_axis(motor.axis))).T @ angular_velocity[row : row + 3, :]
        rates.append(Y)
        inertias.append(theta[f"Jm_{joint.name}"])
    if not rates:
        return ca.SX(n_q, n_q), ca.SX(n_q, 1)
    Y, J = ca.sparsify(ca.vertcat(*rates)), ca.vertcat(*inertias)
    return Y.T @ ca.diag(J) @ Y, _coriolis(Y, J, q, v)


def _coriolis(Y: ca.SX, J: ca.SX, q: ca.SX, v: ca.SX) -> ca.SX:
    """Derive c (n_q,) from the scalar rates w = Y v along the motion and to q, with fixed momenta p = J w."""
    w, p = Y @ v, ca.SX.sym("p", J.size1())
    bias = ca.jtimes(Y.T @ p, q, v) - ca.gradient(ca.dot(p, w), q)
    return Y.T @ (J * ca.jtimes(w, q, v)) + ca.substitute(bias, p, J * w)
