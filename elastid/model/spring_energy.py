r"""Deflection and stored energy of each spring of a robot in a small motion dq about q.

.. math:: E_s = \tfrac12\, c_s\, (b_s\, dq)^2, \qquad b_s = \partial x_s / \partial q

with the tangent stiffness c_s and the deflection x_s. Of springs in series x_s is the torque that each bears, that of
X^T K_a (q_m - q_a) in the letters of `drivetrain`, and c_s = 1 / k_s. Preload, which turns with the robot, is no part
of it: with the weight it makes the rest of the energy of K.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import casadi as ca

from elastid.model.drivetrain import series_torques, spring_deflections
from elastid.model.nonlinear_springs import deflections, tangents
from elastid.robot import Robot


@dataclass(frozen=True, eq=False)
class Strain:
    """A spring by its parameter's name: k_<joint>, km_<joint> or k_<rod>; stiffness c and deflection x, scalars."""

    spring: str
    stiffness: ca.SX
    deflection: ca.SX


def strains_of_joints(robot: Robot, q: ca.SX, theta: Mapping[str, ca.SX]) -> tuple[Strain, ...]:
    """The springs of gears, motor shafts and elastic joints at q (n_q,); theta maps the robot's names to symbols."""
    tangent, shafts = tangents(robot, q, theta), spring_deflections(robot)
    terms = [Strain(f"k_{joint}", tangent[joint], x) for joint, x in deflections(robot, q).items()]
    terms += [Strain(name, theta[name], ca.DM(z).T @ q) for name, z in shafts.items() if name.startswith("km_")]
    series = series_torques(robot, theta)
    return (*terms, *(Strain(name, 1 / theta[name], torque @ q) for name, torque in series.items()))
