r"""Loop closure: constraints of each loop, dependent coordinates by pivots of Phi, and rods as energies.

.. math:: \varphi_{point} = p_2 - p_1, \qquad
          \varphi_{rod} = \frac{|p_2 - p_1|^2 - (L + s)^2}{2 L}

with s the rod's elongation. Points are seen from the last frame that carries both ends, so that a row holds the joints
of its loop and no others. Rods stand between points in space: the loop follows elasticity out of its plane, and neither
the rod's angles nor their redundant constraints exist.

.. math:: T = \tfrac12 m |(1-a) \dot p_1 + a \dot p_2|^2 + \tfrac12 \frac{I}{L^2} |\dot p_2 - \dot p_1|^2, \qquad
          V = \tfrac12 k s^2, \quad R = \tfrac12 d \dot s^2

exact for a rigid rod without spin. An elastic rod stretches evenly, so that its centre of mass stays at the part a; its
elongation s is a coordinate (`stretching`) or, the rod cut, |p_2 - p_1| - L (`cut`).

.. math:: \Phi\, \dot q = 0 \iff \dot q = Z \dot y, \qquad \Phi Z = 0

Constraints may be redundant (a planar loop closed in space): redundant rows have no pivot.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import casadi as ca
import numpy as np

from elastid.base.arrays import FloatArray, IntArray
from elastid.base.errors import StudyError
from elastid.model.drivetrain import Strain
from elastid.model.elastic import ElasticModel
from elastid.model.frame_tree import (
    NUMBERS,
    Attachment,
    Tree,
    Turn,
    between,
    direction,
    ends_of,
    last_common,
    position,
    tree,
    turns,
)
from elastid.model.open_chain import Equations, by_name, with_coordinates, with_energies, with_strains
from elastid.robot import Loop, Pin, Robot, unit_axis


@dataclass(frozen=True, eq=False)
class Closure:
    """One loop as expressions of the joints' coordinates.

    gap (3,): from the first end to the second.  ends: both in the base frame.  rows (n_rows,): zero where the loop is
    closed and its rod, if it has one, not stretched.  length: of its rod at rest, 0 without one.
    """

    loop: Loop
    gap: ca.SX
    ends: tuple[ca.SX, ca.SX]
    rows: ca.SX
    length: ca.SX | float = 0.0


def closures(robot: Robot, q: ca.SX, theta: Mapping[str, ca.SX] = NUMBERS) -> tuple[Closure, ...]:
    """Return the loops of a robot at joint coordinates q (n_l,); theta: names to symbols, as for `tree`."""
    layout = tree(robot, theta)
    joint_turns = turns(layout, q)
    return tuple(_closure(robot, layout, joint_turns, loop, theta) for loop in robot.loops)


def rod_row(closure: Closure, length: ca.SX | float) -> ca.SX:
    """Return (|gap|^2 - length^2) / (2 L), L the length at rest in the robot's description."""
    assert closure.loop.rod is not None
    return (ca.sumsqr(closure.gap) - length**2) / (2 * closure.loop.rod.length)


def _closure(
    robot: Robot, layout: Tree, joint_turns: tuple[Turn, ...], loop: Loop, theta: Mapping[str, ca.SX]
) -> Closure:
    first, second = ends_of(robot, layout, loop, "p", theta)
    gap = between(layout, joint_turns, first, second)
    closure = Closure(loop, gap, (position(layout, joint_turns, *first), position(layout, joint_turns, *second)), gap)
    if loop.rod is not None:
        length = theta.get(f"l_{loop.name}", loop.rod.length)
        return replace(closure, rows=rod_row(closure, length), length=length)
    if loop.pin is not None:
        return replace(closure, rows=_pin_rows(layout, joint_turns, (first[0], second[0]), loop.pin, gap))
    return closure


def _pin_rows(
    layout: Tree, joint_turns: tuple[Turn, ...], seats: tuple[Attachment, Attachment], pin: Pin, gap: ca.SX
) -> ca.SX:
    """Return displacements across the axis; for a spatial pin also along the axis, and the two tilts."""
    along = unit_axis(pin.axis)
    across = np.cross(np.eye(3)[int(np.argmin(np.abs(along)))], along)
    across /= np.linalg.norm(across)
    axes = (across, np.cross(along, across), along)
    root = last_common(layout, seats[0].frame, seats[1].frame)
    x, y, z = (direction(layout, joint_turns, seats[0], axis, root) for axis in axes)
    rows = [ca.dot(x, gap), ca.dot(y, gap)]
    if not pin.planar:
        axis = unit_axis(pin.axis if pin.other_axis is None else pin.other_axis)
        hinge = direction(layout, joint_turns, seats[1], axis, root)
        rows += [ca.dot(z, gap), ca.dot(x, hinge), ca.dot(y, hinge)]
    return ca.vertcat(*rows)


def with_rod_inertia(robot: Robot, equations: Equations, loops: Sequence[Closure], rods: bool = False) -> Equations:
    """Add mass and weight of all rods to the equations; rods: a point mass at each end, (1 - a) m and a m."""
    theta, gravity = by_name(equations), ca.DM(robot.gravity)
    for closure in loops:
        rod, name = closure.loop.rod, closure.loop.name
        if rod is None:
            continue
        m, a, inertia = (theta[f"{letter}_{name}"] for letter in "maI")
        first, second = closure.ends
        center = (1 - a) * first + a * second
        if rods:
            masses = ((1 - a) * m, first), (a * m, second)
        else:
            masses = (m, center), (inertia / closure.length**2, second - first)
        for mass, point in masses:
            equations = _with_mass(equations, mass, point)
        equations = with_energies(equations, -m * ca.dot(gravity, center), ca.SX(*equations.D.shape))
    return equations


def _with_mass(equations: Equations, mass: ca.SX, point: ca.SX) -> Equations:
    """Add T = mass |p'|^2 / 2: J^T m J to the mass matrix, J^T m (dJ/dt) v to the forces."""
    J = ca.jacobian(point, equations.q)
    return replace(
        equations,
        M=equations.M + mass * J.T @ J,
        f=equations.f + mass * J.T @ ca.jtimes(J @ equations.v, equations.q, equations.v),
    )


def elastic(loops: Sequence[Closure]) -> list[Closure]:
    """Select closures with an elastic rod."""
    return [closure for closure in loops if closure.loop.rod is not None and closure.loop.rod.is_elastic]


def cut_rods(equations: Equations, rods: Sequence[Closure]) -> Equations:
    """Add the elastic rods of loops as springs and dampers between their end points."""
    theta = by_name(equations)
    for closure in rods:
        name = closure.loop.name
        s = ca.norm_2(closure.gap) - closure.length
        y = ca.gradient(s, equations.q)
        equations = with_energies(equations, theta[f"k_{name}"] * s**2 / 2, theta[f"d_{name}"] * y @ y.T)
        equations = with_strains(equations, Strain(f"k_{name}", theta[f"k_{name}"], s))
    return equations


def stretching(equations: Equations, loops: Sequence[Closure]) -> tuple[Equations, list[ca.SX]]:
    """Add a coordinate `rod <name>` for each elastic rod; returns the rows that close all loops with stretched rods."""
    with_rod = elastic(loops)
    n = len(equations.coordinates)
    equations = with_coordinates(equations, [f"rod {closure.loop.name}" for closure in with_rod])
    theta, rows = by_name(equations), []
    for closure in loops:
        if closure not in with_rod:
            rows.append(closure.rows)
            continue
        name, i = closure.loop.name, n + with_rod.index(closure)
        y = ca.DM(len(equations.coordinates), 1)
        y[i] = 1
        equations = with_energies(
            equations, theta[f"k_{name}"] * equations.q[i] ** 2 / 2, theta[f"d_{name}"] * ca.sparsify(y @ y.T)
        )
        equations = with_strains(equations, Strain(f"k_{name}", theta[f"k_{name}"], equations.q[i]))
        rows.append(rod_row(closure, closure.length + equations.q[i]))
    return equations, rows


# A singular value or a pivot below this part of the largest is zero.
RANK_TOLERANCE = 1e-9


@dataclass(frozen=True)
class Partition:
    """rows, dependent (n_r,): pivots, in the order of elimination.  independent (n_q - n_r,): the other coordinates."""

    rows: IntArray
    dependent: IntArray
    independent: IntArray

    def basis(self, Phi: FloatArray) -> FloatArray:
        """Return Z (n_q, n_q - n_r) of Phi (n_c, n_q): the unit matrix for the independent coordinates."""
        Z = np.zeros((Phi.shape[1], len(self.independent)))
        Z[self.independent, range(len(self.independent))] = 1.0
        rows = Phi[self.rows]
        Z[self.dependent] = -np.linalg.solve(rows[:, self.dependent], rows[:, self.independent])
        return Z


def partition(model: ElasticModel, Phi: FloatArray) -> Partition:
    """Choose pivots of Phi (n_c, n_q) by complete pivoting, coordinates of loops before coordinates of motors.

    Raises StudyError where the coordinates that a minimal formulation asks for are not independent.
    """
    kept_names = model.independent or ()
    tier = np.array([_tier(model, name) for name in model.coordinates])
    is_candidate = ~np.isin(model.coordinates, kept_names)
    rows: list[int] = []
    dependent = []
    scale = np.abs(Phi).max(axis=1, initial=0.0, keepdims=True)
    A = Phi / np.where(scale > 0, scale, 1.0)
    rank = np.linalg.matrix_rank(Phi, tol=RANK_TOLERANCE * np.abs(Phi).max(initial=0.0)) if Phi.size else 0
    passes = [(tier <= last) & is_candidate for last in range(int(tier.max()) + 1)]
    # Pivots below 0.05 of their row only where the preferred dependent coordinates are used up.
    for threshold, columns in [*((0.05, columns) for columns in passes), (RANK_TOLERANCE, passes[-1])]:
        while len(rows) < rank:
            size = np.abs(A) * columns
            size[rows] = 0.0
            row, column = np.unravel_index(int(np.argmax(size)), size.shape)
            if size[row, column] <= threshold:
                break
            other_rows = np.setdiff1d(np.arange(len(A)), [*rows, row])
            A[other_rows] -= np.outer(A[other_rows, column] / A[row, column], A[row])
            rows.append(int(row))
            dependent.append(int(column))
    if len(rows) < rank or (kept_names and len(kept_names) != model.n_q - rank):
        raise StudyError(
            "robot/loops",
            f"model.independent: {', '.join(kept_names)} are not the {model.n_q - rank} independent coordinates that "
            "the loops leave here (elastic rods are cut and determine none); choose others of "
            f"{', '.join(model.coordinates)}, or leave the choice to the rank",
        )
    independent = np.setdiff1d(np.arange(model.n_q), dependent)
    return Partition(np.array(rows, np.int64), np.array(dependent, np.int64), independent)


def _tier(model: ElasticModel, coordinate: str) -> int:
    """Rank coordinates: 0 rod elongation, 1 passive, 2 elastic, 3 elastically driven joint, 4 motor or rigid drive."""
    kind, _, name = coordinate.partition(" ")
    if kind == "rod":
        return 0
    joint = next(joint for joint in model.robot.joints if joint.name == name)
    if kind == "joint" and joint.is_passive:
        return 1
    if joint.motor is None:
        return 2
    return 3 if kind == "joint" and joint in model.robot.flexible else 4


def motions(model: ElasticModel, Phi: FloatArray) -> FloatArray:
    """Return Z (n_q, n) that spans the null space of Phi (n_c, n_q): orthonormal, or of the independent coordinates."""
    if model.independent is not None and (Phi.size or model.independent):
        return partition(model, Phi).basis(Phi)
    return null_space(Phi)


def null_space(Phi: FloatArray) -> FloatArray:
    """Return Z (n_q, n), orthonormal columns, of Phi (n_c, n_q); the unit matrix without constraints."""
    if not Phi.size:
        return np.eye(Phi.shape[1])
    _, s, Vt = np.linalg.svd(Phi)
    return Vt[int(np.sum(s > RANK_TOLERANCE * s.max())) :].T
