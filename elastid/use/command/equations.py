r"""The elastic robot as it is commanded: forces that a motion takes, tool pose, and rest at an end.

.. math:: M(q)\, \ddot q + f(q, \dot q) + \tau_f(\dot q) + \Phi^T \lambda = B u, \qquad \varphi(q) = 0

with every number inserted. Dry friction is that of steady sliding, tanh(v / v_s) at standstill: bristles are integrated
along the reference where the torque is written (`friction_along`).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import casadi as ca
import numpy as np

from elastid.base.arrays import FloatArray
from elastid.base.errors import StudyError
from elastid.friction.robot_friction import frictions
from elastid.linear.equilibrium import equilibrium, rigid_posture
from elastid.model.elastic import ElasticModel
from elastid.model.formulation import EXACT, formulate
from elastid.model.frame_tree import direction, position, tree, turns
from elastid.model.kinematics import Poses, frame_poses
from elastid.model.loop_closure import partition
from elastid.model.spec import ModelSpec
from elastid.record import Configuration
from elastid.robot import Robot
from elastid.simulation.controller import rigid_motion, rigid_path, rigid_rates
from elastid.simulation.dynamics import contacts
from elastid.use.command.moves import Move

# rad/s (m/s) on the link side below which the planned friction turns around: slower than a move, faster than a step.
SLIDING = 0.01
LEVER = 0.1  # m: an error of orientation counts as that of a point so far from the tool


@dataclass(frozen=True, eq=False)
class CommandedRobot:
    """A robot with numbers, about to be commanded so that a frame follows a path.

    rows: of the constraints that are independent.
    """

    robot: Robot
    model: ElasticModel
    frame: str
    rows: tuple[int, ...]
    spec: ModelSpec = EXACT

    @classmethod
    def of(cls, robot: Robot, frame: str, posture: FloatArray, spec: ModelSpec = EXACT) -> CommandedRobot:
        """Robot in the formulation of `spec`, of loops of elastic rods in the minimal one; posture (n_u,): amid all."""
        model = formulate(robot, spec)
        if model.n_c:
            minimal = formulate(robot, ModelSpec("minimal"))
            model, spec = (minimal, ModelSpec("minimal")) if not minimal.n_c else (model, spec)
        rows: tuple[int, ...] = ()
        if model.n_c:
            point = equilibrium(model, model.theta, Configuration("move", posture))
            rows = tuple(partition(model, model.constraint_jacobian(point.q, model.theta).full()).rows.tolist())
        return cls(robot, model, frame, rows, spec)

    @property
    def is_posed(self) -> bool:
        """True if the orientation of the frame is followed, too: with more than three motors."""
        return self.model.n_u > 3

    @cached_property
    def balance(self) -> ca.Function:
        """(q, v, a, lambda) -> r (n_q,), the forces that a motion takes; phi, its slope."""
        m, n = self.model, self.model.n_q
        q, v, a = (ca.SX.sym(name, n) for name in "qva")
        lambda_, rows = ca.SX.sym("lambda", len(self.rows)), list(self.rows)
        force = m.mass(q, m.theta) @ a + m.force(q, v, m.theta) + self._friction(v)
        phi = m.constraint(q, m.theta)[rows]
        Phi = ca.jacobian(phi, q)
        if rows:
            force = force + Phi.T @ lambda_
        results = [ca.densify(part) for part in (force, phi, Phi)]
        return ca.Function("balance", [q, v, a, lambda_], results, {"cse": True})

    def _friction(self, v: ca.SX, of_motors: bool = False) -> ca.SX:
        """P tau_f (n_q,) of steady sliding, of all laws or those of motors alone."""
        laws = [law for law in frictions(self.robot) if law.place in self.model.inputs or not of_motors]
        total = ca.SX(self.model.n_q, 1)
        for law, column in zip(laws, contacts(self.model, laws).P.T, strict=True):
            slip, curve = ca.dot(ca.DM(column), v), law.symbols(law.curve().tolist())
            total += ca.DM(column) * (curve.level(slip) * ca.tanh(slip / SLIDING) + curve.growing(slip))
        return total

    def planned_friction(self, v: FloatArray) -> FloatArray:
        """Friction (N, n_u) of the motors at v (N, n_q) as it is planned with, turning around gradually."""
        symbols = ca.SX.sym("v", self.model.n_q)
        force = ca.Function("friction", [symbols], [ca.densify(self._friction(symbols, of_motors=True))])
        return np.asarray((np.linalg.pinv(self.model.B) @ force.map(len(v))(v.T).full()).T)

    @cached_property
    def tool(self) -> ca.Function:
        """(q, p, R) -> error (3,) or (6,) in m of the frame from a pose p (3,), R (9,) column by column; its slope."""
        q, p, R = ca.SX.sym("q", self.model.n_q), ca.SX.sym("p", 3), ca.SX.sym("R", 3, 3)
        layout = tree(self.robot)
        turned = turns(layout, q[: len(self.robot.joints)])
        names = [frame.name for frame in self.robot.frames]
        seat = layout.named[names.index(self.frame)]
        error = position(layout, turned, seat, (0.0, 0.0, 0.0)) - p
        if self.is_posed:
            own = ca.horzcat(*(direction(layout, turned, seat, axis) for axis in np.eye(3)))
            error = ca.vertcat(error, LEVER / 2 * sum(ca.cross(R[:, i], own[:, i]) for i in range(3)))
        results = [ca.densify(part) for part in (error, ca.jacobian(error, q))]
        return ca.Function("tool", [q, p, ca.vec(R)], results, {"cse": True})

    def torque(self, q: FloatArray, v: FloatArray, a: FloatArray) -> FloatArray:
        """u (N, n_u) that a motion (N, n_q) takes; the forces in loops are those of least squares."""
        m, n, n_r = self.model, len(q), len(self.rows)
        force, _, Phi = (part.full() for part in self.balance.map(n)(q.T, v.T, a.T, np.zeros((n_r, n))))
        carried = -Phi.reshape(n_r, n, m.n_q).transpose(1, 2, 0)
        columns = np.concatenate([np.broadcast_to(m.B, (n, *m.B.shape)), carried], axis=2)
        return np.asarray((np.linalg.pinv(columns) @ force.T[:, :, None])[:, : m.n_u, 0])

    def poses(self, q: FloatArray) -> Poses:
        """Poses of the frame at q (N, n_q)."""
        return frame_poses(self.robot, q[:, : len(self.robot.joints)], self.frame)

    def rigid(self, move: Move, t: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """q, v, a (N, n_q) of the robot without deflection along a move at times (N,)."""
        angles, rate, curvature = (move.at(t, order) for order in range(3))
        q = rigid_path(self.model, self.rigid_posture(angles[0]), angles[0], angles)
        return q, *rigid_rates(self.model, q, rate, curvature)[1:]

    def rest(self, angles: FloatArray) -> FloatArray:
        """q (n_q,) at rest under gravity with the tool where it is without deflection at angles (n_u,).

        StudyError where the robot finds no rest there.
        """
        target = self.poses(self.rigid_posture(angles)[None])
        motors = angles
        for _ in range(8):
            q = equilibrium(self.model, self.model.theta, Configuration("move", motors)).q
            R = target.rotation.transpose(0, 2, 1).reshape(9)
            error, J = (part.full() for part in self.tool(q, target.position[0], R))
            step = -np.linalg.pinv(J @ rigid_motion(self.model, q), rcond=1e-6) @ error[:, 0]
            if np.abs(step).max() < 1e-9:
                return q
            motors = motors + step
        raise StudyError(
            "robot/no-rest",
            f"no posture of the motors brings frame {self.frame} at rest to where it is "
            f"without deflection at {', '.join(f'{angle:.4g}' for angle in angles)} rad; the posture is near a "
            "singular one, choose another",
            f"robot {self.robot.name}",
        )

    def rigid_posture(self, angles: FloatArray) -> FloatArray:
        """q (n_q,) without deflection at angles (n_u,)."""
        return rigid_posture(self.model, Configuration("move", angles))
