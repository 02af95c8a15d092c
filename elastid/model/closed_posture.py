r"""Closed postures: the passive joints of a robot with rigid springs and rods, on the branch of its start.

.. math:: \varphi(q_a, q_p) = 0, \qquad \dot q_p = -\Phi_p^{-1} \Phi_a \dot q_a

Most loops close in two ways. The passive joints are found at the start posture by Newton's method from the joints'
`start` and followed from there to the angles wanted, in steps too small to change over. Many postures at once.
"""

from dataclasses import dataclass
from functools import lru_cache

import casadi as ca
import numpy as np

from elastid.base.arrays import BoolArray, FloatArray, IntArray
from elastid.base.errors import StudyError
from elastid.model.loop_closure import RANK_TOLERANCE, Closure, closures
from elastid.robot import Robot

# Numbers of the way to a closed posture, and limits.
PATH_STEP = 0.05  # rad or m of a driven joint between two postures on the way
NEWTON_STEPS = 4  # at each of them; the error of the predictor is about step^2
START_NEWTON_STEPS = 60  # from angles that are guesses
MAX_NEWTON_STEP = 0.3  # rad or m
MAX_GAP = 1e-10  # m between the ends of a closed loop
MIN_LEVER_SINE = 0.03  # of the angle between lever and rod; postures nearer to alignment are refused


@dataclass(frozen=True, eq=False)
class Mechanism:
    """Closure of a robot's loops over many postures: rows (n_g,), gaps (3 n_loops,) and their Jacobians to q (n_l,).

    closures: of its loops, at the symbols q.  passive (n_p,), driven (n_u,): the joints that the loops move, and those
    that motors move.
    """

    robot: Robot
    q: ca.SX
    closures: tuple[Closure, ...]
    function: ca.Function
    passive: IntArray
    driven: IntArray

    def rows(self, q: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return phi (Q, n_g) and Phi (Q, n_g, n_l) at q (Q, n_l)."""
        rows, Phi, _ = (matrix.full() for matrix in self.function.map(len(q))(q.T))
        return np.array(rows.T), np.asarray(Phi.reshape(len(Phi), len(q), -1).transpose(1, 0, 2))

    def lever(self, q: FloatArray) -> float:
        """Return the longest displacement (m) of a rod's end per radian of a passive joint, at q (n_l,)."""
        _, _, gaps = self.function(q)
        length = np.sqrt((np.array(gaps.full()[:, self.passive]).reshape(-1, 3, len(self.passive)) ** 2).sum(axis=1))
        return float(length.max(initial=0.0))


@lru_cache(maxsize=8)
def mechanism(robot: Robot) -> Mechanism:
    """Build the mechanism, once in a process for each robot."""
    q = ca.SX.sym("q", robot.n_l)
    loops = closures(robot, q)
    rows, gaps = ca.vertcat(*(loop.rows for loop in loops)), ca.vertcat(*(loop.gap for loop in loops))
    passive = [i for i in robot.joints_in_loops if robot.joints[i].is_passive]
    function = ca.Function("closure", [q], [rows, ca.densify(ca.jacobian(rows, q)), ca.densify(ca.jacobian(gaps, q))])
    return Mechanism(robot, q, loops, function, np.array(passive, np.int64), np.array(robot.driven_indices, np.int64))


def assemble(robot: Robot, angles: FloatArray) -> FloatArray:
    """Solve joints (n_l,) at the driven joints' angles (n_u,): passive joints by loop closure, elastic joints at 0.

    StudyError where the loops do not close there, leave a joint undetermined, lock a motor or are about to fold over.
    """
    if not robot.loops:
        return robot.joint_positions(angles)
    linkage = mechanism(robot)
    q = follow_angles(robot, angles[None]).ravel()
    phi, _ = linkage.rows(q[None])
    if not np.abs(phi).max(initial=0.0) <= MAX_GAP:
        raise StudyError("robot/loops", _why_open(linkage, angles))
    _check_posture(linkage, q)
    return q


def follow_angles(robot: Robot, angles: FloatArray, near: FloatArray | None = None) -> FloatArray:
    """Solve joints (Q, n_l) at the driven joints' angles (Q, n_u), along a path from the start; some may stay open.

    near (n_u,): angles close to all of `angles`. The path from the start to `near` is then solved only once.
    """
    start = robot.joint_positions(np.array([[joint.start for joint in robot.driven]]))
    if not robot.loops:
        return robot.joint_positions(angles)
    linkage = mechanism(robot)
    start[:, linkage.passive] = [robot.joints[i].start for i in linkage.passive]
    q = start
    for _ in range(START_NEWTON_STEPS):
        q = q + _correction(linkage, q)
        if np.abs(linkage.rows(q)[0]).max() <= MAX_GAP:
            break
    q = q + _correction(linkage, q)
    return _continue_posture(linkage, q if near is None else _continue_posture(linkage, q, near[None]), angles)


def open_loops(robot: Robot, angles: FloatArray) -> float:
    """Return the largest gap (m) of loops at the driven joints' angles (Q, n_u), 0 if all close."""
    if not robot.loops:
        return 0.0
    gap = float(np.abs(mechanism(robot).rows(follow_angles(robot, angles, angles[0]))[0]).max(initial=0.0))
    return gap if gap > MAX_GAP else 0.0


def are_closed(robot: Robot, q: FloatArray) -> BoolArray:
    """True (Q,) for joints q (Q, n_l) with closed loops away from singularities, as `assemble` accepts them."""
    if not robot.loops:
        return np.ones(len(q), bool)
    linkage = mechanism(robot)
    phi, Phi = linkage.rows(q)
    is_closed = np.abs(phi).max(axis=1, initial=0.0) <= MAX_GAP
    n_p = len(linkage.passive)
    if not n_p:
        return np.asarray(is_closed)
    s = np.linalg.svd(Phi[:, :, linkage.passive], compute_uv=False)
    smallest = s[:, n_p - 1] if s.shape[1] >= n_p else np.zeros(len(q))
    return np.asarray(is_closed & (smallest > MIN_LEVER_SINE * np.array([linkage.lever(joints) for joints in q])))


def _continue_posture(linkage: Mechanism, q: FloatArray, angles: FloatArray) -> FloatArray:
    """Solve postures at the driven joints' angles (Q, n_u), from one posture q (1, n_l)."""
    steps = max(1, int(np.ceil(np.abs(angles - q[0, linkage.driven]).max(initial=0.0) / PATH_STEP)))
    q = np.repeat(q, len(angles), axis=0)
    step = (angles - q[:, linkage.driven]) / steps
    for _ in range(steps):
        # Along the tangent, then back onto the closure.
        q = q + (rates(linkage.robot, q) @ step[:, :, None])[:, :, 0]
        for _ in range(NEWTON_STEPS):
            q = q + _correction(linkage, q)
    return q


def rates(robot: Robot, q: FloatArray) -> FloatArray:
    """Return T (Q, n_l, n_u) with q' = T q_a' at joints q (Q, n_l), without deflection of springs and rods."""
    T = np.zeros((len(q), robot.n_l, robot.n_u))
    T[:, robot.driven_indices, range(robot.n_u)] = 1.0
    if robot.loops:
        parts = mechanism(robot)
        _, Phi = parts.rows(q)
        T[:, parts.passive] = -np.linalg.pinv(Phi[:, :, parts.passive], rcond=RANK_TOLERANCE) @ Phi[:, :, parts.driven]
    return T


def _correction(parts: Mechanism, q: FloatArray) -> FloatArray:
    phi, Phi = parts.rows(q)
    dq = np.zeros_like(q)
    dq[:, parts.passive] = -(np.linalg.pinv(Phi[:, :, parts.passive], rcond=RANK_TOLERANCE) @ phi[:, :, None])[:, :, 0]
    longest = np.abs(dq).max(axis=1, initial=0.0, keepdims=True)
    return np.asarray(dq * np.minimum(1.0, MAX_NEWTON_STEP / np.maximum(longest, MAX_NEWTON_STEP)))


def _why_open(linkage: Mechanism, angles: FloatArray) -> str:
    """Name the loop that stays open and its gap, at the requested posture or already at the start, or locked joints."""
    robot = linkage.robot
    (start,) = follow_angles(robot, np.array([[joint.start for joint in robot.driven]]))
    (end,) = follow_angles(robot, angles[None])
    at_start = np.abs(linkage.rows(start[None])[0]).max() > MAX_GAP
    loop, gap = _widest(linkage, start if at_start else end)
    if at_start:
        return (
            f"loop {loop} does not close at the start posture: {gap}; correct its ends or its rod's length, "
            "or the `start` of its joints"
        )
    _check_locked(linkage, start)
    return (
        f"loop {loop} does not close: {gap} at the driven joints' angles "
        f"{', '.join(f'{a:.4g}' for a in angles)}, followed from the start posture; move them nearer to it, or correct "
        "the loop's ends or its rod's length"
    )


def _check_locked(parts: Mechanism, q: FloatArray) -> None:
    """Refuse driven joints that no motion of the passive joints follows; StudyError."""
    _, Phi = parts.rows(q[None])
    is_locked = np.abs(Phi[0] @ rates(parts.robot, q[None])[0]).max(axis=0) > 1e-6 * max(np.abs(Phi).max(), 1e-300)
    if names := ", ".join(joint.name for joint, locks in zip(parts.robot.driven, is_locked, strict=True) if locks):
        raise StudyError(
            "robot/loops",
            "no motion of the passive joints follows, so that only springs could give; leave "
            "a joint of the loop without motor and spring, or drop a constraint",
            f"the loops lock {names}",
        )


def _widest(linkage: Mechanism, q: FloatArray) -> tuple[str, str]:
    rows = [np.abs(ca.Function("rows", [linkage.q], [loop.rows])(q).full()).max() for loop in linkage.closures]
    worst = linkage.closures[int(np.argmax(rows))]
    gap = float(np.linalg.norm(ca.Function("gap", [linkage.q], [worst.gap])(q).full()))
    rod = worst.loop.rod
    length = "" if rod is None else f", the rod is {1e3 * rod.length:.4g} mm long"
    return worst.loop.name, f"its ends are {1e3 * gap:.4g} mm apart{length}"


def _check_posture(parts: Mechanism, q: FloatArray) -> None:
    """Check that every passive joint follows the driven joints, without a folded (singular) lever."""
    _, Phi = parts.rows(q[None])
    _check_locked(parts, q)
    n_p = len(parts.passive)
    if not n_p:
        return
    _, s, Vt = np.linalg.svd(Phi[0][:, parts.passive])
    smallest, lever = s[n_p - 1] if len(s) >= n_p else 0.0, parts.lever(q)
    if smallest > MIN_LEVER_SINE * lever:
        return
    sine = smallest / max(lever, 1e-300)
    free = [parts.robot.joints[parts.passive[i]].name for i in np.flatnonzero(np.abs(Vt[n_p - 1]) > 0.3)]
    raise StudyError(
        "robot/loops",
        f"the linkage is singular: lever and rod are aligned to within {sine:.2g} rad, and joint {', '.join(free)} can "
        "move with all motors locked. Choose another configuration. If all are singular, close the loop by a rod, or "
        "give the joint a spring",
    )
