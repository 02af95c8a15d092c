r"""Motions that no mass resists, in NumPy, without the equations.

.. math:: T = \tfrac12 \dot q^T M \dot q, \quad M = \sum_{bodies} m J_v^T J_v + J_\omega^T I_c J_\omega
    + \sum_{rigid\ gears} e J_m r^2 e^T
"""

from __future__ import annotations

import numpy as np

from elastid.base.arrays import FloatArray
from elastid.model.frame_tree import tree
from elastid.model.kinematics import frames, placed, point_jacobians
from elastid.model.parallel_linkage.closed_posture import mechanism
from elastid.robot import Robot

# Eigenvalue of M, scaled to a unit diagonal, that rounding explains.
ROUNDING = 1e-12


def joint_without_inertia(robot: Robot, q: FloatArray) -> int | None:
    """The joint with most of a motion from q (n_l,) that moves no inertia; None where M is positive definite.

    Loops are kept closed, rods that stretch included.
    """
    M = _mass_matrix(robot, q)
    if robot.loops:
        _, Phi = mechanism(robot).rows(q[None])
        M = M + Phi[0].T @ Phi[0]
    scale = np.sqrt(np.where(np.diag(M) > 0, np.diag(M), 1.0))
    eigenvalues, motions = np.linalg.eigh(M / np.outer(scale, scale))
    return int(np.argmax(np.abs(motions[:, 0]))) if eigenvalues[0] <= ROUNDING else None


def _mass_matrix(robot: Robot, q: FloatArray) -> FloatArray:
    """M (n_l, n_l) of the joints: bodies, and rotors of gears without a spring."""
    layout = tree(robot)
    R, p = frames(layout, q[None])
    M = np.diag([_rotor(robot, i) for i in range(len(robot.joints))])
    for body, seat in zip(robot.all_bodies, layout.attachments, strict=True):
        if seat.frame >= 0:
            center = placed(R, p, seat.frame, seat.p + seat.R @ np.array(body.center_of_mass), 1)
            J = point_jacobians(layout, R, p, seat.frame, center)[0]
            axes = R[seat.frame][0] @ seat.R
            M += body.mass * J[:3].T @ J[:3] + J[3:].T @ axes @ body.inertia_matrix @ axes.T @ J[3:]
    return M


def _rotor(robot: Robot, i: int) -> float:
    """The inertia of a joint's rotor, link side; 0 behind a spring, where it moves by itself."""
    joint = robot.joints[i]
    return 0.0 if joint.motor is None or joint in robot.flexible else joint.motor.inertia * joint.motor.ratio**2
