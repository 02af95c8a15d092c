r"""Torques that a rigid arm takes beyond those of its linearisation, along the motion that was measured.

.. math:: \tau(\delta) = Z^T [M(q)\, \ddot q + f(q, \dot q)], \quad \varphi(q) = 0, \quad \dot q = Z \dot\delta, \qquad
          \tau_g = \tau(\delta) - \tau(0) - \left.\frac{d \tau(h \delta)}{d h}\right|_{h = 0}

They are distortion that a straight spring passes on, of second and third order in the motion delta of the joints. Of a
carrier's slow turn they look like errors of transmission, which are functions of the angle, too. Z (n_q, n): motors
turn with their joints, and joints that neither a motor nor a spring holds follow the loops, whose forces do no work
along Z. The same therefore in every formulation of a robot with loops.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import casadi as ca
import numpy as np
from numpy.fft import irfft, rfft

from elastid.base.arrays import ComplexArray, FloatArray
from elastid.base.errors import DataError
from elastid.linear.equilibrium import equilibrium
from elastid.linear.linearise import linearise
from elastid.model.elastic import ElasticModel
from elastid.model.formulation import formulate
from elastid.nonlinear.period_lines import DriveLines, PeriodLines
from elastid.record import Configuration
from elastid.robot import Joint, Robot

# Points of a period over the highest line of the motion: products of three of them are not folded onto lines.
POINTS = 8
REACH = 2  # times the highest line of the motion, up to which the torques are kept
# Parameters of torques that are no arm's: springs, dampers and friction of joints and motors.
ELASTIC = ("k_", "d_", "fm_", "f_")
_PASSES = 3  # motion and torques by each other
_SMALL = 1e-3  # part of the motion, over which the torques of first order are taken
_STEPS, _CLOSED = 8, 1e-12  # of Newton's method; gap of a loop, m, which second order then leaves far behind


def geometric_torques(
    robot: Robot, at: Configuration, motion: ComplexArray, s: ComplexArray, joints: Sequence[Joint] = ()
) -> ComplexArray:
    """tau_g (F + 1, n, M) of joints, or else the driven ones, its mean and lines s (F,), by their motion (F, n, M).

    Masses and lengths are those of the robot's file.  DataError where its loops do not close along the motion.
    """
    arm, (F, n, M) = _RigidArm.of(robot, at, joints or robot.driven), motion.shape
    states = [_signals(motion * s[:, None, None] ** order) for order in range(3)]

    def tau(part: float) -> FloatArray:
        return arm.torques(*(part * x for x in states))

    first = (tau(_SMALL) - tau(-_SMALL)) / (2 * _SMALL)
    beyond = (tau(1.0) - first - tau(0.0)).reshape(n, -1, M)
    of_lines = np.where(np.arange(F + 1) == 0, 1, 2)[:, None, None] / beyond.shape[1]
    return np.asarray(rfft(beyond, axis=1)[:, : F + 1].swapaxes(0, 1) * of_lines)


def without_arm(lines: PeriodLines, drive: DriveLines, robot: Robot) -> PeriodLines:
    """The lines with tau_g, and with the motion by it taken out of their angles.

    The motion of the joints is that of the model `drive` under tau_g, and such torques at the motors as make the rest
    of the measured angles.
    """
    top = int(np.flatnonzero(lines.excited)[-1]) + 1
    reach = min(REACH * top, len(lines.s))
    H, links, sensor = drive.H[:reach], drive.places["link"], drive.sensor[:reach, :, None]
    of_angles = links @ H @ drive.B @ np.linalg.inv(drive.C @ H @ drive.B)
    Y, arm = lines.Y.copy(), np.zeros((len(lines.s) + 1, len(links), lines.Y.shape[2]), complex)
    for _ in range(_PASSES):
        motion = of_angles @ (Y[:reach] / sensor) - links @ H @ links.T @ arm[1 : reach + 1]
        motion[top:] = 0.0
        arm[: reach + 1] = geometric_torques(robot, lines.configuration, motion, lines.s[:reach])
        Y[:reach] = lines.Y[:reach] + sensor * (drive.C @ H @ links.T @ arm[1 : reach + 1])
    return replace(lines, Y=Y, arm=arm)


def arm_distortion(lines: PeriodLines, inputs: Sequence[str], robot: Robot) -> ComplexArray:
    """Angles (F, n_u, M) of the motors `inputs` by tau_g, to first order, up to the highest excited line.

    Of a robot with the numbers of its file, whose elastic joints move as well.
    """
    model, top = formulate(robot), int(np.flatnonzero(lines.excited)[-1]) + 1
    linear = linearise(model, lines.configuration, np.array(model.theta), robot.motor_locations, "position")
    order = [robot.motor_locations.index(place) for place in inputs]
    s, C, Z = lines.s[:top, None, None], linear.C[order], np.eye(model.n_q) if linear.Z is None else linear.Z
    moving = [i for i, joint in enumerate(robot.joints) if not joint.is_passive]
    H, joints = np.linalg.inv(s**2 * linear.M + s * linear.D + linear.K), Z[moving]
    of_motors = H @ linear.B[:, order]
    motion = joints @ of_motors @ np.linalg.inv(C @ of_motors) @ lines.Y[:top]
    tau = geometric_torques(robot, lines.configuration, motion, lines.s[:top], [robot.joints[i] for i in moving])[1:]
    return np.asarray(-C @ H @ joints.T @ tau, np.complex128)


@dataclass(frozen=True, eq=False)
class _RigidArm:
    """A robot whose other springs stay as they are at rest, q0 (n_q,).  moved (n_q, n): coordinates by joints.

    dynamics(q, v, a) -> M a + f and loops(q, v) -> phi, Phi, (dPhi/dt) v: of one point of time.
    """

    model: ElasticModel
    q0: FloatArray
    moved: FloatArray
    dynamics: ca.Function
    loops: ca.Function

    @classmethod
    def of(cls, robot: Robot, at: Configuration, joints: Sequence[Joint]) -> _RigidArm:
        """At rest in a configuration."""
        model = formulate(robot)
        moved = np.zeros((model.n_q, len(joints)))
        for column, joint in zip(moved.T, joints, strict=True):
            sides = ("joint",) if joint.motor is None else ("joint", "motor")
            column[[model.index(f"{side} {joint.name}") for side in sides]] = 1.0
        own = model.carried(np.array(model.theta), at.carries)
        theta = np.where([name.startswith(ELASTIC) for name in model.parameters], 0.0, own)
        q, v, a = (ca.SX.sym(name, model.n_q) for name in ("q", "v", "a"))
        torque, Phi = model.mass(q, theta) @ a + model.force(q, v, theta), model.constraint_jacobian(q, theta)
        rows = [model.constraint(q, theta), Phi, ca.jtimes(Phi @ v, q, v)]
        dynamics = ca.Function("dynamics", [q, v, a], [torque], {"cse": True})
        return cls(model, equilibrium(model, model.theta, at).q, moved, dynamics, ca.Function("loops", [q, v], rows))

    def torques(self, delta: FloatArray, v: FloatArray, a: FloatArray) -> FloatArray:
        """tau (n, N) of the joints by their motion from rest (n, N) and its derivatives."""
        q = self.q0[:, None] + self.moved @ delta
        if not self.model.n_c:
            whole = self.dynamics.map(q.shape[1])(q, self.moved @ v, self.moved @ a)
            return np.asarray(self.moved.T @ whole.full())
        q, follow = self._closed(q)
        Z = np.tile(self.moved, (q.shape[1], 1, 1))
        Z[:, self.model.passive] = -follow @ self._loops(q, 0 * q)[1] @ self.moved
        dq, ddq = (np.einsum("kij,jk->ik", Z, x) for x in (v, a))
        ddq[self.model.passive] -= np.einsum("kij,jk->ik", follow, self._loops(q, dq)[2])
        return np.asarray(np.einsum("kji,jk->ik", Z, self.dynamics.map(q.shape[1])(q, dq, ddq).full()))

    def _closed(self, q: FloatArray) -> tuple[FloatArray, FloatArray]:
        """q (n_q, N) with passive joints where the loops close; their motion (N, n_p, n_c) by gaps of these."""
        q, passive = q.copy(), self.model.passive
        for _ in range(_STEPS):
            phi, Phi, _ = self._loops(q, 0 * q)
            follow, gap = np.linalg.pinv(Phi[:, :, passive]), float(np.abs(phi).max())
            if gap < _CLOSED:
                return q, np.asarray(follow)
            q[passive] -= np.einsum("kij,jk->ik", follow, phi)
        raise DataError(
            "robot/loops",
            f"the loops of robot {self.model.robot.name} stay open by {gap:.2g} m along the motion of the records, so "
            "that its own distortion is not known; check the lengths of its loops, and the angles of configurations",
        )

    def _loops(self, q: FloatArray, v: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """phi (n_c, N), Phi (N, n_c, n_q) and (dPhi/dt) v (n_c, N)."""
        phi, Phi, bias = (x.full() for x in self.loops.map(q.shape[1])(q, v))
        return phi, Phi.reshape(self.model.n_c, -1, self.model.n_q).swapaxes(0, 1), bias


def _signals(X: ComplexArray) -> FloatArray:
    """Signals (n, N M), N = POINTS (F + 1), of amplitudes (F, n, M) of lines 1 to F."""
    F, n, M = X.shape
    padded = np.zeros((POINTS * (F + 1) // 2 + 1, n, M), complex)
    padded[1 : F + 1] = X
    x = irfft(padded, POINTS * (F + 1), axis=0) * (POINTS * (F + 1) / 2)
    return np.asarray(x.swapaxes(0, 1).reshape(n, -1))
