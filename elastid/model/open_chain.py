r"""Equations: the terms of a robot whose loops are cut open, as CasADi expressions, and the ElasticModel made of them.

.. math:: \begin{bmatrix} M(q_l) & S(q_l) \\ S^T & M_m \end{bmatrix} \ddot q + f(q, \dot q) + \Phi^T \lambda = B u,
          \qquad q = [q_l;\, q_m]

Niglis & Oberg (2015), eq. (2.22), and eq. (2.10) where no motor rides on a body (S = 0). Every formulation starts from
`open_chain`; a formulation changes these values (constraints, fewer coordinates). Conventions of sign
and side: `elastic`.

Gravity compensators: potentials and torques of coil and gas springs between two bodies.

A compensator at the distance L between its two points has the potential

.. math:: V_{coil} = \tfrac12 k_c (L - L_0)^2, \qquad
          V_{gas} = F_0 h_0 \int_0^1 \ell\, e^{(\kappa - 1) \ell t}\, dt, \quad \ell = \ln (h_0 / h), \quad
          h = h_0 + s (L - L_0)

Their torque -dV/dq is tau_g of Niglis & Oberg (2015), eq. (2.32). s = 1 for a strut that pushes, -1 for a cylinder that
draws; the integral is [(h_0 / h)^(kappa - 1) - 1] / (kappa - 1), which is 0 / 0 at kappa = 1. dV/dq = (dV/dL) / (2 L)
d(L^2)/dq is written out: a simulation evaluates it at every step.
"""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import casadi as ca
import numpy as np

from elastid.base.arrays import FloatArray
from elastid.model.drivetrain import Strain, drivetrain, gear_deflections, input_matrix, joint_springs, rotors
from elastid.model.elastic import ElasticModel
from elastid.model.frame_tree import Tree, Turn, between, ends_of, tree, turns
from elastid.model.rigid_body import bias, composites, inertias, mass_matrix, sensor_kinematics
from elastid.robot import Compensator, Robot


@dataclass(frozen=True, eq=False)
class Equations:
    """Symbols q, v (n_q,), theta (n_theta,) and expressions of them, for a list of named coordinates.

    parameters: the names of theta, robot.parameters() and coordinates of the geometry that are to be symbols, too.
    M (n_q, n_q).  f (n_q,): Coriolis, centrifugal, dV/dq + dR/dv.  V: potential of springs, gravity and compensators.
    D (n_q, n_q): Hessian of R.  phi (n_c,): constraints, (0, 1) for most trees.  J (3 n_bodies + 6 n_f, n_q): J v
    stacks the absolute angular velocities of the bodies in their own axes, then velocity and angular velocity of each
    named frame in its own.  gravity (3 n_f,): seen in those frames.  B (n_q, n_u).  strains: of every spring.
    """

    coordinates: tuple[str, ...]
    parameters: tuple[str, ...]
    q: ca.SX
    v: ca.SX
    theta: ca.SX
    M: ca.SX
    f: ca.SX
    V: ca.SX
    D: ca.SX
    phi: ca.SX
    J: ca.SX
    gravity: ca.SX
    B: FloatArray
    strains: tuple[Strain, ...]


def open_chain(robot: Robot, geometry: Collection[str] = ()) -> Equations:
    """Build the equations of the tree of bodies: all joints, then the motors of flexible joints.

    Constraints are those of rigid gears that are coupled with elastic ones alone.  geometry: names of robot.geometry
    that are symbols in them; other names have no effect.
    """
    table = robot.parameters(geometry)
    motors = (f"motor {joint.name}" for joint in robot.flexible)
    coordinates = (*(f"joint {joint.name}" for joint in robot.joints), *motors)
    n_q, n_l = len(coordinates), robot.n_l
    q, v, theta = ca.SX.sym("q", n_q), ca.SX.sym("v", n_q), ca.SX.sym("theta", len(table))
    theta_by_name = dict(zip(table, ca.vertsplit(theta), strict=True))

    gravity, none = np.array(robot.gravity), ca.SX(n_q - n_l, 1)
    layout = tree(robot, theta_by_name)
    joint_turns = turns(layout, q[:n_l])
    bodies = inertias(robot, layout, theta_by_name)
    composite = composites(layout, bodies, joint_turns)
    M_bodies = ca.diagcat(mass_matrix(layout, composite, joint_turns), ca.SX(n_q - n_l, n_q - n_l))
    f_bodies = ca.vertcat(bias(layout, bodies, joint_turns, v[:n_l], gravity), none)
    J, gravity_seen = sensor_kinematics(robot, layout, joint_turns)
    J = ca.horzcat(J, ca.SX(J.size1(), n_q - n_l))
    B, delta, (M_drive, D, K) = input_matrix(robot), gear_deflections(robot), drivetrain(robot, theta_by_name)
    rigid = [box.rigid @ delta[list(box.gears)] for box in robot.gearboxes]
    M_carried, c_carried = rotors(robot, theta_by_name, q, v, J)
    V_hard, f_hard, strains = joint_springs(robot, q, theta_by_name)
    V_balance, f_balance = compensators(robot, layout, joint_turns, q, theta_by_name)
    M = M_bodies + M_drive + M_carried
    f = f_bodies + c_carried + K @ q + D @ v + f_hard + f_balance
    V = q.T @ K @ q / 2 - ca.dot(composite[-1].h, ca.DM(gravity)) + V_hard + V_balance
    phi = ca.sparsify(ca.DM(np.vstack([np.zeros((0, n_q)), *rigid]))) @ q
    return Equations(coordinates, tuple(table), q, v, theta, M, f, V, D, phi, J, gravity_seen, B, strains)


def by_name(equations: Equations) -> dict[str, ca.SX]:
    """Return the symbol of each parameter by name."""
    return dict(zip(equations.parameters, ca.vertsplit(equations.theta), strict=True))


def with_coordinates(equations: Equations, names: Sequence[str]) -> Equations:
    """Append coordinates without inertia and stiffness to the equations."""
    n_names = len(names)
    if not n_names:
        return equations
    return replace(
        equations,
        coordinates=(*equations.coordinates, *names),
        q=ca.vertcat(equations.q, ca.SX.sym("s", n_names)),
        v=ca.vertcat(equations.v, ca.SX.sym("s_rate", n_names)),
        M=ca.diagcat(equations.M, ca.SX(n_names, n_names)),
        f=ca.vertcat(equations.f, ca.SX(n_names, 1)),
        D=ca.diagcat(equations.D, ca.SX(n_names, n_names)),
        J=ca.horzcat(equations.J, ca.SX(equations.J.size1(), n_names)),
        B=np.vstack([equations.B, np.zeros((n_names, equations.B.shape[1]))]),
    )


def with_strains(equations: Equations, *strains: Strain) -> Equations:
    """Add strains of further springs, which replace previous strains of the same springs."""
    by_spring = {strain.spring: strain for strain in (*equations.strains, *strains)}
    return replace(equations, strains=tuple(by_spring.values()))


def with_energies(equations: Equations, V: ca.SX, D: ca.SX) -> Equations:
    """Add a further potential V(q) and dissipation v^T D(q) v / 2."""
    return replace(
        equations, V=equations.V + V, D=equations.D + D, f=equations.f + ca.gradient(V, equations.q) + D @ equations.v
    )


def elastic_model(robot: Robot, equations: Equations, independent: tuple[str, ...] | None = None) -> ElasticModel:
    """Build the named functions of the contract; the stiffness is the exact Hessian of V + lambda^T phi."""
    table = robot.parameters(equations.parameters)
    q, V, n_b = equations.q, equations.V, 3 * len(robot.all_bodies)
    lambda_ = ca.SX.sym("lambda", equations.phi.size1())
    symbols = {"q": q, "v": equations.v, "lambda_": lambda_, "theta": equations.theta}
    K = ca.hessian(V + ca.dot(lambda_, equations.phi), q)[0]
    stiffness = ca.vertcat(ca.SX(0, 1), *(strain.stiffness for strain in equations.strains))
    deflection = ca.vertcat(ca.SX(0, 1), *(strain.deflection for strain in equations.strains))
    terms: dict[str, tuple[tuple[str, ...], dict[str, ca.SX]]] = {
        "mass": (("q", "theta"), {"M": equations.M}),
        "force": (("q", "v", "theta"), {"f": equations.f}),
        "constraint": (("q", "theta"), {"phi": equations.phi}),
        "damping": (("q", "theta"), {"D": equations.D}),
        "stiffness": (("q", "lambda_", "theta"), {"K": K}),
        "potential_gradient": (("q", "theta"), {"g": ca.gradient(V, q)}),
        "potential": (("q", "theta"), {"V": V}),
        "constraint_jacobian": (("q", "theta"), {"Phi": ca.jacobian(equations.phi, q)}),
        "angular_velocity": (("q", "theta"), {"J": equations.J[:n_b, :]}),
        "frame_velocity": (("q", "theta"), {"J": equations.J[n_b:, :]}),
        "frame_gravity": (("q", "theta"), {"g": equations.gravity}),
        "strain": (("q", "theta"), {"c": stiffness, "b": ca.jacobian(deflection, q)}),
    }
    functions: dict[str, Any] = {
        name: ca.Function(name, [symbols[symbol] for symbol in inputs], [*results.values()], [*inputs], [*results])
        for name, (inputs, results) in terms.items()
    }
    theta, springs = np.array([x for x, _ in table.values()]), tuple(strain.spring for strain in equations.strains)
    names = equations.coordinates, robot.motor_locations, tuple(table)
    return ElasticModel(robot, *names, theta, equations.B, **functions, springs=springs, independent=independent)


# Nodes of Gauss and Legendre for the gas: exact to 1e-14 for columns that change by a factor of 5.
_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(7)


def compensators(
    robot: Robot, layout: Tree, joint_turns: tuple[Turn, ...], q: ca.SX, theta: Mapping[str, ca.SX]
) -> tuple[ca.SX, ca.SX]:
    """Return V, a scalar, and dV/dq (n_q, 1) of all compensators; joints turned by `joint_turns` are among q."""
    V, gradient = ca.SX(0), ca.SX(q.size1(), 1)
    for compensator in robot.compensators:
        square = ca.sumsqr(between(layout, joint_turns, *ends_of(robot, layout, compensator, "pc", theta)))
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
