"""An elastic arm of plain numbers and equations of its own, which share nothing with elastid's."""

from dataclasses import dataclass

import numpy as np

import elastid as ei

TOOL = (1.0, 0.0, 0.10)
LINES = np.concatenate([np.linspace(2, 40, 60), np.linspace(42, 60, 10)])
ASKED = np.linspace(2, 60, 60)


@dataclass(frozen=True)
class Joint:
    """A revolute joint of the outside robot: place and axis in the frame before it, spring, motor (link side)."""

    offset: np.ndarray
    axis: int
    k: float
    d: float
    f: float
    motor: tuple[float, float] | None  # inertia, viscous friction
    body: int  # that it moves, counted from 0


@dataclass(frozen=True)
class Outside:
    """A serial arm as plain numbers; q = joints, then motors; M, D, K about the equilibrium of held motors."""

    joints: tuple[Joint, ...]
    mass: np.ndarray
    center: np.ndarray
    inertia: np.ndarray  # (n_b, 3, 3)

    @property
    def driven(self) -> list[int]:
        """Joints with motors."""
        return [i for i, joint in enumerate(self.joints) if joint.motor is not None]

    def frames(self, q: np.ndarray) -> list[np.ndarray]:
        """4 x 4 transform of each joint's moved frame."""
        T, frames = np.eye(4), []
        for joint, angle in zip(self.joints, q, strict=False):
            step = np.eye(4)
            i, j = (joint.axis + 1) % 3, (joint.axis + 2) % 3
            step[[i, i, j, j], [i, j, i, j]] = np.cos(angle), -np.sin(angle), np.sin(angle), np.cos(angle)
            step[:3, 3] = joint.offset
            T = T @ step
            frames.append(T)
        return frames

    def jacobian(self, q: np.ndarray, last: int, local: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Linear and angular Jacobian (3, n_l) of a point behind joint `last`, and its frame's rotation."""
        frames = self.frames(q)
        point = frames[last][:3, :3] @ local + frames[last][:3, 3]
        Jv, Jw = np.zeros((3, len(self.joints))), np.zeros((3, len(self.joints)))
        for i in range(last + 1):
            axis = frames[i][:3, self.joints[i].axis]
            Jv[:, i], Jw[:, i] = np.cross(axis, point - frames[i][:3, 3]), axis
        return Jv, Jw, frames[last][:3, :3]

    def last_joint(self, body: int) -> int:
        """That moves a body."""
        return max(i for i, joint in enumerate(self.joints) if joint.body == body)

    def gradient(self, q: np.ndarray) -> np.ndarray:
        """d weight / d q in closed form."""
        rows = [self.mass[b] * self.jacobian(q, self.last_joint(b), c)[0][2] for b, c in enumerate(self.center)]
        return 9.81 * np.sum(rows, axis=0)

    def matrices(self, angles: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """M, D, K (n, n) with joints before motors, and the joints (n_l,) at rest."""
        n_l, driven = len(self.joints), self.driven
        rest = np.zeros(n_l)
        rest[driven] = angles
        k, held = np.array([joint.k for joint in self.joints]), rest.copy()

        def hessian(q: np.ndarray) -> np.ndarray:
            h = 1e-5
            columns = [(self.gradient(q + h * e) - self.gradient(q - h * e)) / (2 * h) for e in np.eye(n_l)]
            return (np.array(columns) + np.array(columns).T) / 2

        for _ in range(8):
            rest = rest - np.linalg.solve(np.diag(k) + hessian(rest), k * (rest - held) + self.gradient(rest))
        n = n_l + len(driven)
        M, D, K = np.zeros((n, n)), np.zeros((n, n)), np.zeros((n, n))
        for b, c in enumerate(self.center):
            Jv, Jw, R = self.jacobian(rest, self.last_joint(b), c)
            M[:n_l, :n_l] += self.mass[b] * Jv.T @ Jv + Jw.T @ R @ self.inertia[b] @ R.T @ Jw
        K[:n_l, :n_l] = hessian(rest)
        for i, joint in enumerate(self.joints):
            b = np.zeros(n)
            b[i] = 1.0
            D[i, i] += joint.f
            if joint.motor is not None:
                b[n_l + driven.index(i)] = -1.0
                row = n_l + driven.index(i)
                M[row, row], D[row, row] = joint.motor[0], joint.motor[1]
            K, D = K + joint.k * np.outer(b, b), D + joint.d * np.outer(b, b)
        return M, D, K, rest

    def motor_response(self, angles: np.ndarray) -> np.ndarray:
        """Acceleration of each motor per torque (F, n_u, n_u) on LINES."""
        M, D, K, _ = self.matrices(angles)
        s = 2j * np.pi * LINES[:, None, None]
        n_l = len(self.joints)
        return (s**2 * np.linalg.inv(s**2 * M + s * D + K))[:, n_l:, n_l:]

    def tool(self, angles: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """With the motors held: compliance (6, 6), natural frequencies, G (F, 3, 3) on ASKED, axes of the base."""
        M, D, K, rest = self.matrices(angles)
        n_l = len(self.joints)
        M, D, K = M[:n_l, :n_l], D[:n_l, :n_l], K[:n_l, :n_l]
        Jv, Jw, _ = self.jacobian(rest, n_l - 1, np.array(TOOL))
        J = np.vstack([Jv, Jw])
        A = np.block([[np.zeros_like(M), np.eye(n_l)], [-np.linalg.solve(M, K), -np.linalg.solve(M, D)]])
        poles = np.linalg.eigvals(A)
        s = 2j * np.pi * ASKED[:, None, None]
        G = Jv @ np.linalg.inv(s**2 * M + s * D + K) @ Jv.T
        return J @ np.linalg.solve(K, J.T), np.sort(np.abs(poles[poles.imag > 0])) / (2 * np.pi), G


def outside_of(robot: ei.Robot) -> Outside:
    """The numbers of a robot's file; nothing of its equations."""
    joints = []
    for b, body in enumerate(robot.bodies):
        for i, joint in enumerate(body.joints):
            motor = joint.motor
            drive = None if motor is None else (motor.inertia * motor.ratio**2, motor.viscous * motor.ratio**2)
            offset = np.array(body.placement.xyz if i == 0 else (0, 0, 0), float)
            spring = joint.spring
            joints.append(Joint(offset, "xyz".index(joint.axis), spring.stiffness, spring.damping, 0.0, drive, b))
    mass = np.array([body.mass for body in robot.bodies])
    center = np.array([body.center_of_mass for body in robot.bodies])
    return Outside(tuple(joints), mass, center, np.array([body.inertia_matrix for body in robot.bodies]))
