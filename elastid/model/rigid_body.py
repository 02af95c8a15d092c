r"""Rigid bodies as a tree: velocities, mass matrix, bias forces, and torques of a rigid motion, in CasADi.

.. math:: M(q)\, a + c(q, v) + g(q) = \tau, \qquad \tau_{ext} = J(q)^T w

Niglis & Oberg (2015), eqs. (2.6), (2.7), (2.11). Recursions in joint frames: M by composite rigid bodies, c + g by
Newton-Euler (Featherstone, Rigid Body Dynamics Algorithms, 2008, chapters 5 and 6), on 3-vectors. M is linear in masses
and inertias, g in masses. Springs, dampers, friction and rotors are left out; an elastic joint is a joint like any
other here.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import chain

import casadi as ca
import numpy as np

from elastid.base.arrays import FloatArray
from elastid.model.frame_tree import BodyFrame, Tree, Turn, tree, turns
from elastid.robot import Robot
from elastid.robot.body import TENSOR


@dataclass(frozen=True)
class BodyInertia:
    """Mass m, first moment h (3,) = m c and inertia tensor I (3, 3) about a frame's origin, in the frame's axes."""

    m: ca.SX
    h: ca.SX
    I: ca.SX  # noqa: E741

    def __add__(self, other: "BodyInertia") -> "BodyInertia":
        return BodyInertia(self.m + other.m, self.h + other.h, self.I + other.I)


NOTHING = BodyInertia(ca.SX(0), ca.SX.zeros(3), ca.SX.zeros(3, 3))
# The coordinate axes (3, 1).
UNIT = tuple(ca.DM(axis) for axis in np.eye(3))


def inertias(robot: Robot, layout: Tree, theta: Mapping[str, ca.SX]) -> tuple[BodyInertia, ...]:
    """Sum the inertia of the bodies on each frame, as symbols of theta, without bodies fixed to the base."""
    bodies = [NOTHING] * len(layout.frames)
    for body, seat in zip(robot.all_bodies, layout.attachments, strict=True):
        if seat.frame < 0:
            continue
        m = theta[f"m_{body.name}"]
        c = seat.p + ca.DM(seat.R) @ ca.vertcat(*(theta[f"c_{body.name}_{a}"] for a in "xyz"))
        entries = [theta[f"I_{body.name}{suffix}"] for suffix in body.inertia_entries]
        tensor = [*(entries * 3 if len(entries) == 1 else entries), ca.SX(0), ca.SX(0), ca.SX(0)][:6]
        about_com = _tensor(ca.vertcat(*tensor))
        h = m * c
        steiner = ca.dot(c, h) * ca.DM.eye(3) - h @ c.T
        bodies[seat.frame] += BodyInertia(m, h, ca.DM(seat.R) @ about_com @ ca.DM(seat.R.T) + steiner)
    return tuple(bodies)


def _tensor(numbers: ca.SX) -> ca.SX:
    return ca.reshape(numbers[TENSOR.ravel().tolist()], 3, 3)


def composites(layout: Tree, bodies: tuple[BodyInertia, ...], joint_turns: tuple[Turn, ...]) -> tuple[BodyInertia, ...]:
    """Return the inertia moved by each joint, in its own frame, and last the robot's about the origin of the base."""
    total = [*bodies, NOTHING]
    for i in reversed(range(len(layout.frames))):
        body, frame, p = total[i], layout.frames[i], joint_turns[i].origin
        R = ca.DM(frame.R)
        h, tensor = R @ joint_turns[i].forth(body.h), R @ joint_turns[i].tensor(body.I) @ R.T
        # Steiner's theorem twice over: I - [p x][h x] - [h x][p x] - m [p x][p x], by way of g = 2 h + m p.
        product = p @ (2 * h + body.m * p).T
        tensor += ca.trace(product) * ca.DM.eye(3) - (product + product.T) / 2
        total[frame.parent] += BodyInertia(body.m, h + body.m * p, tensor)
    return tuple(total)


def mass_matrix(layout: Tree, composite: tuple[BodyInertia, ...], joint_turns: tuple[Turn, ...]) -> ca.SX:
    """Return M (n, n), symmetric: row i is the momentum of joint i at a rate of 1, on every joint below it."""
    n = len(layout.frames)
    M, below = ca.SX(n, n), [list[tuple[list[int], ca.SX, ca.SX]]() for _ in layout.frames]
    for i, frame in reversed([*enumerate(layout.frames)]):
        angular, linear = composite[i].I[:, frame.axis], ca.cross(UNIT[frame.axis], composite[i].h)
        if frame.slides:
            angular, linear = -linear, composite[i].m * UNIT[frame.axis]
        branches, moments, forces = zip(([i], angular, linear), *below[i], strict=True)
        joints, angular, linear = [*chain(*branches)], ca.horzcat(*moments), ca.horzcat(*forces)
        row = (linear if frame.slides else angular)[frame.axis, :]
        M[i, joints], M[joints, i] = row, row.T
        if frame.parent >= 0:
            below[frame.parent].append((joints, *_force_on_parent(angular, linear, frame, joint_turns[i])))
    return M


def _force_on_parent(moment: ca.SX, force: ca.SX, frame: BodyFrame, turn: Turn) -> tuple[ca.SX, ca.SX]:
    """Transform moments about the origin and forces (3, n) of a frame to axes and origin of its parent."""
    R = ca.DM(frame.R)
    force = R @ turn.forth(force)
    return R @ turn.forth(moment) + ca.skew(turn.origin) @ force, force


def bias(
    layout: Tree, bodies: tuple[BodyInertia, ...], joint_turns: tuple[Turn, ...], v: ca.SX, gravity: FloatArray,
    acceleration: ca.SX | None = None,
) -> ca.SX:  # fmt: skip
    """Return c + g (n,): joint torques that balance Coriolis, centrifugal and gravity forces at velocities v (n,).

    With an acceleration v' (n,), the inverse dynamics M v' + c + g.
    Newton-Euler, the base accelerated by -gravity. U = [alpha x] + [omega x]^2 gives the acceleration
    a + U r of a point r of a body; with S the second moments of its mass, the moment of U r is the axis of U S - S U^T.
    """
    zero = ca.SX.zeros(3)
    still = zero, zero, ca.SX(-ca.DM(gravity)), ca.SX.zeros(3, 3)
    motion: list[tuple[ca.SX, ca.SX, ca.SX, ca.SX]] = []  # omega, alpha, a, U of each frame
    moments, forces = [], []
    for i, (frame, turn, body) in enumerate(zip(layout.frames, joint_turns, bodies, strict=True)):
        (omega, alpha, a, U), R = motion[frame.parent] if frame.parent >= 0 else still, ca.DM(frame.R.T)
        a = turn.back(R @ (a + U @ turn.origin))
        omega, alpha = turn.back(R @ omega), turn.back(R @ alpha)
        rate, gain = UNIT[frame.axis] * v[i], UNIT[frame.axis] * (0 if acceleration is None else acceleration[i])
        if frame.slides:
            a = a + 2 * ca.cross(omega, rate) + gain
        else:
            alpha = alpha + ca.cross(omega, rate) + gain
            omega = omega + rate
        U = ca.skew(alpha) + omega @ omega.T - ca.sumsqr(omega) * ca.DM.eye(3)
        motion.append((omega, alpha, a, U))
        S = ca.trace(body.I) / 2 * ca.DM.eye(3) - body.I
        moments.append(ca.cross(body.h, a) + ca.inv_skew(U @ S - (U @ S).T))
        forces.append(body.m * a + U @ body.h)
    for i in reversed(range(len(layout.frames))):
        parent = layout.frames[i].parent
        if parent >= 0:
            moment, force = _force_on_parent(moments[i], forces[i], layout.frames[i], joint_turns[i])
            moments[parent], forces[parent] = moments[parent] + moment, forces[parent] + force
    rows = zip(layout.frames, forces, moments, strict=True)
    return ca.vertcat(*((force if frame.slides else moment)[frame.axis] for frame, force, moment in rows))


def sensor_kinematics(robot: Robot, layout: Tree, joint_turns: tuple[Turn, ...]) -> tuple[ca.SX, ca.SX]:
    """Return J (3 n_bodies + 6 n_f, n) and gravity (3 n_f,) in axes fixed to bodies and named frames.

    J v stacks the absolute angular velocity of each body, then velocity of the origin and angular velocity of each
    named frame, each in its own axes.
    """
    n, gravity = len(layout.frames), ca.SX(ca.DM(np.array(robot.gravity)))
    still = ca.SX(3, n), ca.SX(3, n), gravity
    # Angular velocity, velocity of the origin and gravity in each joint's frame; last, in the base.
    rows: list[tuple[ca.SX, ca.SX, ca.SX]] = []
    for i, (frame, turn) in enumerate(zip(layout.frames, joint_turns, strict=True)):
        (angular, linear, g), R = rows[frame.parent] if frame.parent >= 0 else still, ca.DM(frame.R.T)
        linear = turn.back(ca.densify(R @ (linear - ca.skew(turn.origin) @ angular)))
        angular = turn.back(ca.densify(R @ angular))
        (linear if frame.slides else angular)[frame.axis, i] += 1
        rows.append((angular, linear, turn.back(R @ g)))
    rows.append(still)
    turning = [ca.DM(seat.R.T) @ rows[seat.frame][0] for seat in layout.attachments]
    moving, falling = [], []
    for seat in layout.named:
        (angular, linear, g), R = rows[seat.frame], ca.DM(seat.R.T)
        across = ca.skew(ca.DM(seat.p) if isinstance(seat.p, np.ndarray) else seat.p)
        moving += [R @ (linear - across @ angular), R @ angular]
        falling.append(R @ g)
    return ca.vertcat(*turning, *moving), ca.vertcat(ca.SX(0, 1), *falling)


def inverse_dynamics(robot: Robot) -> ca.Function:
    """Build the joint torques tau(q, v, a, theta) (n_l,) by Newton-Euler; theta in the order of robot.parameters().

    Nm of a rotation, N of a translation, in the order of robot.joints. For coupled motors q, v and a are
    of the shaft divided by the motor's ratio, and tau multiplied by it: q = robot.mixing @ angles of the driven joints.
    """
    names = list(robot.parameters())
    theta = ca.SX.sym("theta", len(names))
    state, tau = _at_shafts(robot, inertias(robot, tree(robot), dict(zip(names, ca.vertsplit(theta), strict=True))))
    return ca.Function("inverse_dynamics", [*state, theta], [tau], ["q", "v", "a", "theta"], ["tau"])


def _at_shafts(robot: Robot, bodies: Sequence[BodyInertia]) -> tuple[list[ca.SX], ca.SX]:
    """Return symbols q, v, a (n_l,) and torques (n_l,) for shafts of motors and for joints without a motor."""
    layout, state = tree(robot), [ca.SX.sym(name, robot.n_l) for name in "qva"]
    E = np.eye(robot.n_l)
    E[np.ix_(robot.driven_indices, robot.driven_indices)] = robot.mixing
    of_shafts = ca.sparsify(ca.DM(np.linalg.inv(E)))
    q, v, a = (of_shafts @ x for x in state)
    return state, of_shafts.T @ bias(layout, tuple(bodies), turns(layout, q), v, np.array(robot.gravity), a)


def regressor(robot: Robot) -> ca.Function:
    r"""Return Y(q, v, a) (n_l, 10 n_l) of the inverse dynamics, which are linear in the numbers of the bodies.

    .. math:: \tau = Y(q, v, a)\, \pi, \qquad
              \pi = (m, m c_x, m c_y, m c_z, I_{xx}, I_{yy}, I_{zz}, I_{xy}, I_{xz}, I_{yz})

    for each joint's frame in turn, I about its origin (Atkeson, An and Hollerbach, Int. J. Robotics Research 5(3),
    1986). Some columns are zero or depend on others: only combinations of the numbers can be identified.
    """
    pi = ca.SX.sym("pi", 10, robot.n_l)
    bodies = [BodyInertia(column[0], column[1:4], _tensor(column[4:])) for column in ca.horzsplit(pi)]
    state, tau = _at_shafts(robot, bodies)
    return ca.Function("regressor", state, [ca.jacobian(tau, ca.vec(pi))], ["q", "v", "a"], ["Y"])
