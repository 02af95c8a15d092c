r"""Rods as energies of their end points: no body, no angles.

.. math:: T = \tfrac12 m |(1-a) \dot p_1 + a \dot p_2|^2 + \tfrac12 \frac{I}{L^2} |\dot p_2 - \dot p_1|^2, \qquad
          V = \tfrac12 k s^2, \quad R = \tfrac12 d \dot s^2

exact for a rigid rod without spin. An elastic rod stretches evenly, so that its centre of mass stays at the part a; its
elongation s is a coordinate (`stretching`) or, the rod cut, |p_2 - p_1| - L (`cut`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import casadi as ca

from elastid.model.open_chain import Equations, by_name, with_coordinates, with_energies, with_strains
from elastid.model.parallel_linkage.loop_closure import Closure, rod_row
from elastid.model.spring_energy import Strain
from elastid.robot import Robot


def with_rod_inertia(robot: Robot, of: Equations, found: Sequence[Closure], lumped: bool = False) -> Equations:
    """The equations with mass and weight of all rods; lumped: a point mass at each end, (1 - a) m and a m."""
    theta, gravity = by_name(of), ca.DM(robot.gravity)
    for closure in found:
        rod, name = closure.loop.rod, closure.loop.name
        if rod is None:
            continue
        m, a, inertia = (theta[f"{letter}_{name}"] for letter in "maI")
        first, second = closure.ends
        if lumped:
            masses = ((1 - a) * m, first), (a * m, second)
        else:
            masses = (m, (1 - a) * first + a * second), (inertia / closure.length**2, second - first)
        for mass, point in masses:
            of = _with_mass(of, mass, point)
        of = with_energies(of, -m * ca.dot(gravity, (1 - a) * first + a * second), ca.SX(of.D.shape[0], of.D.shape[1]))
    return of


def _with_mass(of: Equations, mass: ca.SX, point: ca.SX) -> Equations:
    """T = mass |p'|^2 / 2 more: J^T m J to the mass matrix, J^T m (dJ/dt) v to the forces."""
    J = ca.jacobian(point, of.q)
    velocity = J @ of.v
    return replace(of, M=of.M + mass * J.T @ J, f=of.f + mass * J.T @ ca.jtimes(velocity, of.q, of.v))


def elastic(found: Sequence[Closure]) -> list[Closure]:
    """Those with an elastic rod."""
    return [closure for closure in found if closure.loop.rod is not None and closure.loop.rod.is_elastic]


def cut(of: Equations, found: Sequence[Closure]) -> Equations:
    """Elastic rods as springs and dampers between their end points."""
    theta = by_name(of)
    for closure in elastic(found):
        name = closure.loop.name
        s = ca.norm_2(closure.gap) - closure.length
        y = ca.gradient(s, of.q)
        of = with_energies(of, theta[f"k_{name}"] * s**2 / 2, theta[f"d_{name}"] * y @ y.T)
        of = with_strains(of, Strain(f"k_{name}", theta[f"k_{name}"], s))
    return of


def stretching(of: Equations, found: Sequence[Closure]) -> tuple[Equations, list[ca.SX]]:
    """Elastic rods with a coordinate `rod <name>` each; and the rows that close all loops, stretched as they are."""
    with_rod = elastic(found)
    n = len(of.coordinates)
    of = with_coordinates(of, [f"rod {closure.loop.name}" for closure in with_rod])
    theta, rows = by_name(of), []
    for closure in found:
        if closure not in with_rod:
            rows.append(closure.rows)
            continue
        name, i = closure.loop.name, n + with_rod.index(closure)
        y = ca.DM(len(of.coordinates), 1)
        y[i] = 1
        of = with_energies(of, theta[f"k_{name}"] * of.q[i] ** 2 / 2, theta[f"d_{name}"] * ca.sparsify(y @ y.T))
        of = with_strains(of, Strain(f"k_{name}", theta[f"k_{name}"], of.q[i]))
        rows.append(rod_row(closure, closure.length + of.q[i]))
    return of, rows
