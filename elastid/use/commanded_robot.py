"""Robot model whose tool follows a path: equations of motion, tool error, rigid motion and friction of the motors."""

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
from elastid.model.frame_tree import position, rotation, tree, turns
from elastid.model.kinematics import Poses, frame_poses
from elastid.model.loop_closure import partition
from elastid.model.spec import ModelSpec
from elastid.record import Configuration
from elastid.robot import Robot
from elastid.simulation.contacts import contacts
from elastid.simulation.controller import rigid_motion, rigid_path, rigid_rates
from elastid.use.moves import Move

# Smoothing velocity of planned friction, rad/s (m/s), link side: slower than a move, faster than a step of the solver.
SLIDING = 0.01
LEVER = 0.1  # m: distance at which an error of orientation counts as an error of position


@dataclass(frozen=True, eq=False)
class CommandedRobot:
    """Robot model with numbers for trajectory optimisation of a frame.  rows: independent loop constraints."""

    robot: Robot
    model: ElasticModel
    frame: str
    rows: tuple[int, ...]
    spec: ModelSpec = EXACT

    @classmethod
    def of(cls, robot: Robot, frame: str, posture: FloatArray, spec: ModelSpec = EXACT) -> "CommandedRobot":
        """Build the model, with elastic rods in the minimal formulation.  posture (n_u,), rad: near the motion."""
        model = formulate(robot, spec)
        if model.n_c:
            minimal = formulate(robot, ModelSpec("minimal"))
            model, spec = (minimal, ModelSpec("minimal")) if not minimal.n_c else (model, spec)
        rows = ()
        if model.n_c:
            point = equilibrium(model, model.theta, Configuration("move", posture))
            rows = tuple(partition(model, model.constraint_jacobian(point.q, model.theta).full()).rows.tolist())
        return cls(robot, model, frame, rows, spec)

    @cached_property
    def balance(self) -> ca.Function:
        """Function (q, v, a, lambda) -> required forces (n_q,), constraint phi and its Jacobian."""
        m, n = self.model, self.model.n_q
        q, v, a = (ca.SX.sym(name, n) for name in "qva")
        lambda_, rows = ca.SX.sym("lambda", len(self.rows)), list(self.rows)
        phi = m.constraint(q, m.theta)[rows]
        Phi = ca.jacobian(phi, q)
        force = m.mass(q, m.theta) @ a + m.force(q, v, m.theta) + self.friction(v) + Phi.T @ lambda_
        results = [ca.densify(expression) for expression in (force, phi, Phi)]
        return ca.Function("balance", [q, v, a, lambda_], results, {"cse": True})

    def friction(self, v: ca.SX, of_motors: bool = False) -> ca.SX:
        """Return P tau_f (n_q,) in steady sliding of all friction models, or of the motors' only."""
        laws = [law for law in frictions(self.robot) if law.place in self.model.inputs or not of_motors]
        total = ca.SX(self.model.n_q, 1)
        for law, column in zip(laws, contacts(self.model, laws).P.T, strict=True):
            slip, curve = ca.dot(ca.DM(column), v), law.symbols(law.curve().tolist())
            total += ca.DM(column) * (curve.torque(slip) * ca.tanh(slip / SLIDING) + curve.growing(slip))
        return total

    @cached_property
    def tool(self) -> ca.Function:
        """Function (q, p (3,), R (9,) by columns) -> pose error (3,) or (6,), m, and its Jacobian."""
        q, p, R = ca.SX.sym("q", self.model.n_q), ca.SX.sym("p", 3), ca.SX.sym("R", 3, 3)
        layout = tree(self.robot)
        joint_turns = turns(layout, q[: self.robot.n_l])
        node = layout.named[[frame.name for frame in self.robot.frames].index(self.frame)]
        error = position(layout, joint_turns, node) - p
        if self.model.n_u > 3:  # the tool also follows the orientation
            axes = rotation(layout, joint_turns, node)
            error = ca.vertcat(error, LEVER / 2 * sum(ca.cross(R[:, i], axes[:, i]) for i in range(3)))
        results = [ca.densify(expression) for expression in (error, ca.jacobian(error, q))]
        return ca.Function("tool", [q, p, ca.vec(R)], results, {"cse": True})

    def torque(self, q: FloatArray, v: FloatArray, a: FloatArray) -> FloatArray:
        """Return the torques u (N, n_u) of a motion q, v, a (N, n_q); constraint forces by least squares."""
        m, n, n_r = self.model, len(q), len(self.rows)
        force, _, Phi = (values.full() for values in self.balance.map(n)(q.T, v.T, a.T, np.zeros((n_r, n))))
        of_constraints = -Phi.reshape(n_r, n, m.n_q).transpose(1, 2, 0)
        columns = np.concatenate([np.broadcast_to(m.B, (n, *m.B.shape)), of_constraints], axis=2)
        return np.asarray((np.linalg.pinv(columns) @ force.T[:, :, None])[:, : m.n_u, 0])

    def poses(self, q: FloatArray, robot: Robot | None = None) -> Poses:
        """Return the poses of the frame at q (N, n_q); robot: with other numbers, default this one."""
        return frame_poses(robot or self.robot, q[:, : self.robot.n_l], self.frame)

    def rigid(self, move: Move, t: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return q, v, a (N, n_q) of the rigid robot along a move at times t (N,)."""
        angles, rate, curvature = (move.at(t, order) for order in range(3))
        q = rigid_path(self.model, self.rigid_posture(angles[0]), angles[0], angles)
        return q, *rigid_rates(self.model, q, rate, curvature)[1:]

    def rest(self, angles: FloatArray) -> FloatArray:
        """Return the equilibrium q (n_q,) with the rigid robot's tool pose at angles (n_u,); StudyError without one."""
        target = self.poses(self.rigid_posture(angles)[None])
        motors = angles
        for _ in range(8):
            q = equilibrium(self.model, self.model.theta, Configuration("move", motors)).q
            R = target.rotation.transpose(0, 2, 1).reshape(9)
            error, J = (values.full() for values in self.tool(q, target.position[0], R))
            step = -np.linalg.pinv(J @ rigid_motion(self.model, q), rcond=1e-6) @ error[:, 0]
            if np.abs(step).max() < 1e-9:
                return q
            motors = motors + step
        raise StudyError(
            "robot/no-equilibrium",
            f"no equilibrium has frame {self.frame} where the rigid robot has it at "
            f"{', '.join(f'{angle:.4g}' for angle in angles)} rad, because the posture is nearly singular. Choose "
            "another posture",
            f"robot {self.robot.name}",
        )

    def rigid_posture(self, angles: FloatArray) -> FloatArray:
        """Return q (n_q,) of the rigid robot at angles (n_u,)."""
        return rigid_posture(self.model, Configuration("move", angles))


def coulomb_torque_along(robot: Robot, model: ElasticModel, velocity: FloatArray, rate_hz: float) -> FloatArray:
    """Return the dry friction (N, n_u) of motors along velocities (N, n_u), link side, starting at rest.

    Friction behind the spring of a gear is excluded, because the joint does not move like its motor.
    """
    laws = [law for law in frictions(robot) if law.place in model.inputs]
    placed = contacts(model, laws)
    if not laws:
        return np.zeros_like(velocity)
    v, z = ca.SX.sym("v", model.n_q), ca.SX.sym("z", placed.n_states)
    curves = ca.SX(placed.curves)
    step = ca.Function("friction", [z, v], [placed.advanced(v, z, curves, 1 / rate_hz), placed.torque(v, z, curves)])
    _, torque = step.mapaccum(len(velocity))(np.zeros(placed.n_states), model.B @ velocity.T)
    return np.asarray((np.linalg.pinv(model.B) @ torque.full()).T)
