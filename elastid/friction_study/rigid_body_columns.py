r"""Torque of the rigid body that joints carry together, linear in its base parameters.

.. math:: u = Y(q, \dot q, \ddot q)\, \pi + J_m \ddot q + o + f \dot q + F_c\, \mathrm{sgn}\, \dot q

Y is the regressor of the robot's geometry; pi are masses, first moments and inertias, rotors J_m and offsets o (Khalil
& Dombre, Modeling, Identification and Control of Robots, 2002, chapter 12). The regression of friction eliminates pi.
The base parameters, with their columns, predict the torque of the rigid body along other logs.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property

import casadi as ca
import numpy as np
from scipy.linalg import qr

from elastid.base.arrays import FloatArray, IntArray, frozen_value
from elastid.base.errors import DataError
from elastid.friction_study.least_squares import RANK_TOLERANCE, Equations, Solution
from elastid.friction_study.motion_signals import PIECE, MotionLog
from elastid.model.rigid_body import inverse_dynamics, regressor
from elastid.robot import Robot

# Numbers of a joint's frame in the order of the regressor's columns, with their units.
_OF_FRAME = {"m": "kg"} | dict.fromkeys(("mcx", "mcy", "mcz"), "kg*m")
_OF_FRAME |= dict.fromkeys(("Ixx", "Iyy", "Izz", "Ixy", "Ixz", "Iyz"), "kg*m^2")
# Part of a column that is no combination of the base columns, above which other motions have not identified it.
MAX_UNIDENTIFIED = 1e-3
# Of columns of unit length: numbers that logs barely excite are large, of either sign, and predict no other motion
# (Hoerl and Kennard, Technometrics 12, 1970).
RIDGES = (0.0, 0.03, 0.1, 0.3, 1.0)


@frozen_value
class RigidBody:
    r"""Base parameters of joints that moved together: numbers (n_b,) of the columns Y_b of a robot's rigid body.

    .. math:: \tau = Y_b(q, \dot q, \ddot q)\, \pi_b, \qquad Y = Y_b\, regrouped

    Y: the regressor of all frames (10 n_l), rotors and offsets of the joints, n_c columns; base_columns: indices of
    Y_b. A base parameter is its number and regrouped (n_b, n_c) times those which the motions could not separate from
    it (Gautier, J. Robotic Systems 8(4), 1991).  columns: names of all n_c; units: of the base parameters. values: by
    least squares, with std; predicting: by ridge regression, for other logs.
    """

    joints: tuple[str, ...]
    units: tuple[str, ...]
    values: FloatArray
    std: FloatArray
    predicting: FloatArray
    base_columns: IntArray
    regrouped: FloatArray
    columns: tuple[str, ...]

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the base parameters, taken from their columns."""
        return tuple(self.columns[i] for i in self.base_columns)


def _states(robot: Robot, log: MotionLog, samples: slice = slice(None)) -> FloatArray:
    """Return q, v, a (3, n_l, n) of all joints of the robot."""
    names = [joint.name for joint in robot.joints]
    state = np.zeros((3, len(names), len(log.first.position[samples])))
    for joint, angle in log.resting.items():
        state[0, names.index(joint)] = angle
    for joint, signal in log.signals.items():
        states = (signal.position, signal.velocity, signal.acceleration)
        state[:, names.index(joint)] = [part[samples] for part in states]
    return state


def rigid_torque(robot: Robot) -> Callable[[FloatArray, FloatArray, FloatArray], FloatArray]:
    """Return the torque (n_l, n) of the robot model's rigid body at positions, velocities, accelerations (n_l, n)."""
    dynamics, theta = inverse_dynamics(robot), [value for value, _ in robot.parameters().values()]
    return lambda q, v, a: np.asarray(dynamics(q, v, a, theta).full())


def torques_in_file(robot: Robot, log: MotionLog) -> dict[str, FloatArray]:
    """Return the torque (n,) of rigid body and rotor by joint with the robot model's masses; DataError with loops."""
    if robot.loops:
        text = "it has loops, and the rigid body along a log is known of open chains; record one joint there and back"
        raise DataError("friction/rigid-body", text, f"robot {robot.name}")
    names, torque = [joint.name for joint in robot.joints], rigid_torque(robot)
    states = (_states(robot, log, slice(i, i + PIECE)) for i in range(0, len(log.first.position), PIECE))
    tau = np.hstack([torque(*state) for state in states])
    rotors = {j.name: j.motor.inertia * j.motor.ratio**2 for j in robot.driven if j.motor is not None}
    return {joint: tau[names.index(joint)] + rotors[joint] * axis.acceleration for joint, axis in log.signals.items()}


def rigid_body_torques(robot: Robot, body: RigidBody, log: MotionLog) -> dict[str, FloatArray]:
    """Return torque (n,) of the identified rigid body along a log, for each joint; empty without a rigid body.

    DataError where its motion takes numbers that the motions behind `body` have not identified.
    """
    rows = tuple(joint for joint in log.signals if joint in body.joints)
    if not rows:
        return {}
    sample = RigidColumns(robot, body.joints, rows).sampled(log).reshape(-1, len(body.columns))
    residual = np.linalg.norm(sample - sample[:, body.base_columns] @ body.regrouped, axis=0)
    lacking = residual / _sizes(sample) > MAX_UNIDENTIFIED
    if lacking.any():
        first = ", ".join(body.columns[i] for i in np.flatnonzero(lacking)[:3])
        raise DataError(
            "friction/rigid-body",
            f"the motion needs rigid-body parameters that are not identified ({first}"
            f"{', ...' if lacking.sum() > 3 else ''}). Use a friction study of a log in which these joints move",
        )
    torques = RigidColumns(robot, body.joints, rows, body.base_columns).torques(log, body.predicting)
    return dict(zip(rows, torques, strict=True))


def column_names(robot: Robot, joints: Sequence[str]) -> list[tuple[str, str]]:
    """Return name and unit of all columns: rigid body (10 n_l), rotors (m), offsets (m) and joints of coupled motors.

    Joints behind coupled motors have friction F, f of their own at joint speed.
    """
    frame_columns = [(f"{name}_{joint.name}", unit) for joint in robot.joints for name, unit in _OF_FRAME.items()]
    slides = {joint.name: joint.slides for joint in robot.joints}
    coupled_joints = [robot.driven_names[i] for i in _coupled_joints(robot)]
    groups = (
        ("Jm", joints, ("kg*m^2", "kg")), ("o", joints, ("N*m", "N")),
        ("F", coupled_joints, ("N*m", "N")), ("f", coupled_joints, ("N*m*s/rad", "N*s/m")),
    )  # fmt: skip
    rows = [(f"{letter}_{joint}", units[slides[joint]]) for letter, group, units in groups for joint in group]
    return [*frame_columns, *rows]


def _coupled_joints(robot: Robot) -> list[int]:
    """Return motors that a gear couples with other joints, among the driven ones."""
    return np.flatnonzero(np.count_nonzero(robot.mixing, axis=1) > 1).tolist()


def base_columns_of(robot: Robot, joints: tuple[str, ...], logs: Sequence[MotionLog]) -> tuple[IntArray, FloatArray]:
    """Return indices (n_b,) of columns that span all, and all columns as combinations (n_b, n_c) of these."""
    all_columns = RigidColumns(robot, joints, joints)
    sample = np.vstack([columns for log in logs for columns in all_columns.sampled(log)])
    size = _sizes(sample)
    _, R, order = qr(sample / size, mode="economic", pivoting=True)
    diagonal = np.abs(np.diag(R))
    chosen = np.sort(order[: int(np.sum(diagonal > RANK_TOLERANCE * diagonal[0]))]).astype(np.int64)
    return chosen, np.linalg.lstsq(sample[:, chosen] / size[chosen], sample, rcond=None)[0] / size[chosen, None]


def _sizes(sample: FloatArray) -> FloatArray:
    """Return norms (n_c,) of columns; infinite of one that is zero but for rounding, whose number no motion shows."""
    size = np.linalg.norm(sample, axis=0)
    return np.where(size > 1e-9 * size.max(), size, np.inf)


@dataclass(frozen=True)
class RigidColumns:
    """Columns of all but friction in the torques of the joints of `rows`, of joints that moved together.

    chosen: indices of the columns in `column_names`; None for all.
    """

    robot: Robot
    joints: tuple[str, ...]
    rows: tuple[str, ...]
    chosen: IntArray | None = None

    @cached_property
    def _function(self) -> tuple[ca.Function, IntArray, list[int]]:
        """Rigid body's columns from q, v, a; indices of the others among `chosen`; places of the rows."""
        n_l, names = self.robot.n_l, [joint.name for joint in self.robot.joints]
        chosen = np.arange(len(column_names(self.robot, self.joints))) if self.chosen is None else self.chosen
        indices = [names.index(joint) for joint in self.rows]
        q, v, a = (ca.SX.sym(name, n_l) for name in "qva")
        columns = regressor(self.robot)(q, v, a)[indices, chosen[chosen < 10 * n_l].tolist()]
        return ca.Function("part", [q, v, a], [columns]), chosen[chosen >= 10 * n_l] - 10 * n_l, indices

    def at(self, log: MotionLog, samples: slice) -> FloatArray:
        """Return columns (n, len(rows), n_b) at some samples."""
        (function, further, indices), state = self._function, _states(self.robot, log, samples)
        n, m = state.shape[2], len(self.joints)
        rotors = np.zeros((n, len(indices), 2 * m))
        for i, (joint, index) in enumerate(zip(self.rows, indices, strict=True)):
            k = self.joints.index(joint)
            rotors[:, i, k], rotors[:, i, m + k] = state[2, index], 1.0
        body_columns = np.asarray(ca.DM(function(*state))).reshape(len(indices), n, -1).swapaxes(0, 1)
        coupled_joints, to_joints = _coupled_joints(self.robot), np.linalg.inv(self.robot.mixing)
        v = to_joints[coupled_joints] @ state[1, list(self.robot.driven_indices)]
        rows = to_joints.T[[self.robot.driven_names.index(joint) for joint in self.rows]][:, coupled_joints]
        sliding = np.concatenate([np.sign(v), v]).T[:, None] * np.tile(rows, 2)
        return np.concatenate([body_columns, np.concatenate([rotors, sliding], axis=2)[:, :, further]], axis=2)

    def sampled(self, log: MotionLog) -> FloatArray:
        """Return columns (n, len(rows), n_b) at some 500 samples."""
        return self.at(log, slice(0, None, max(1, len(log.first.position) // 500)))

    def torques(self, log: MotionLog, numbers: FloatArray) -> FloatArray:
        """Return torque (len(rows), n) of numbers (n_b,)."""
        starts = range(0, len(log.first.position), PIECE)
        return np.concatenate([self.at(log, slice(i, i + PIECE)) @ numbers for i in starts]).T

    def filtered(self, log: MotionLog) -> FloatArray:
        """Return columns (n, n_y, n_b) behind the filter of both sides, at the samples that are kept."""
        return np.concatenate([piece.filtered(self.at(log, span)) for piece, span in log.first.pieces()])


def ridge_estimate(logs: Sequence[Equations], solution: Solution, ridges: Sequence[float]) -> FloatArray:
    """Estimate base parameters (n_b,) by ridge regression on the torque of these logs without friction.

    Five-fold cross-validation selects the ridge.
    """
    weight = 1 / np.maximum(np.sqrt(solution.sum_of_squares), 1e-300)
    R = np.concatenate([weight[:, None] * log.R for log in logs])
    target = np.concatenate([weight * (log.y - log.X @ solution.beta) for log in logs])
    size, n_b, all_rows = np.maximum(np.linalg.norm(R, axis=(0, 1)), 1e-300), R.shape[2], np.arange(len(R))

    def numbers(rows: IntArray, ridge: float) -> FloatArray:
        flat = np.concatenate([(R[rows] / size).reshape(-1, n_b), ridge * np.eye(n_b)])
        return np.asarray(np.linalg.lstsq(flat, np.append(target[rows], np.zeros(n_b)), rcond=RANK_TOLERANCE)[0] / size)

    def error(ridge: float) -> float:
        folds = np.array_split(all_rows, 5)
        return float(sum(np.sum((target[f] - R[f] @ numbers(np.setdiff1d(all_rows, f), ridge)) ** 2) for f in folds))

    return numbers(all_rows, ridges[0] if len(ridges) == 1 else min(ridges, key=error))
