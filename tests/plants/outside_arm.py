"""A serial elastic arm by equations of its own, which share with elastid's the numbers of a robot's file alone."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

import elastid as ei

TOOL = (1.0, 0.0, 0.10)
LINES = np.concatenate([np.linspace(2, 40, 60), np.linspace(42, 60, 10)])
ASKED = np.linspace(2, 60, 60)


def natural_frequencies(M: np.ndarray, D: np.ndarray, K: np.ndarray) -> np.ndarray:
    """In Hz, ascending."""
    n = len(M)
    poles = np.linalg.eigvals(
        np.block([[np.zeros((n, n)), np.eye(n)], [-np.linalg.solve(M, K), -np.linalg.solve(M, D)]])
    )
    return np.sort(np.abs(poles[poles.imag > 0])) / (2 * np.pi)


@dataclass(frozen=True)
class Outside:
    """q = joints, then motors, all link side; M, D, K about the equilibrium of held motors."""

    robot: ei.Robot

    @cached_property
    def chain(self) -> list[tuple[int, np.ndarray, ei.Joint]]:
        """Each joint with the number of its body and its place in the frame before it."""
        pairs = [(b, body, i, joint) for b, body in enumerate(self.robot.bodies) for i, joint in enumerate(body.joints)]
        return [(b, np.array(body.placement.xyz) * (i == 0), joint) for b, body, i, joint in pairs]

    @cached_property
    def driven(self) -> list[int]:
        return [i for i, (_, _, joint) in enumerate(self.chain) if joint.motor is not None]

    def frames(self, q: np.ndarray) -> list[np.ndarray]:
        """4 x 4 transform of each joint's moved frame."""
        T, frames = np.eye(4), []
        for (_, offset, joint), angle in zip(self.chain, q, strict=False):
            step, axis = np.eye(4), "xyz".index(str(joint.axis))
            i, j = (axis + 1) % 3, (axis + 2) % 3
            step[[i, i, j, j], [i, j, i, j]] = np.cos(angle), -np.sin(angle), np.sin(angle), np.cos(angle)
            step[:3, 3] = offset
            T = T @ step
            frames.append(T)
        return frames

    def jacobian(self, q: np.ndarray, last: int, local: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Linear and angular Jacobian (3, n_l) of a point behind joint `last`, and its frame's rotation."""
        frames = self.frames(q)
        point = frames[last][:3, :3] @ local + frames[last][:3, 3]
        Jv, Jw = np.zeros((3, len(self.chain))), np.zeros((3, len(self.chain)))
        for i in range(last + 1):
            axis = frames[i][:3, "xyz".index(str(self.chain[i][2].axis))]
            Jv[:, i], Jw[:, i] = np.cross(axis, point - frames[i][:3, 3]), axis
        return Jv, Jw, frames[last][:3, :3]

    def of_body(self, q: np.ndarray, body: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """The Jacobians of its centre of mass."""
        last = max(i for i, (b, _, _) in enumerate(self.chain) if b == body)
        return self.jacobian(q, last, np.array(self.robot.bodies[body].center_of_mass))

    def gradient(self, q: np.ndarray) -> np.ndarray:
        """d weight / d q in closed form."""
        rows = [body.mass * self.of_body(q, b)[0][2] for b, body in enumerate(self.robot.bodies)]
        return -self.robot.gravity[2] * np.sum(rows, axis=0)

    def matrices(self, angles: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """M, D, K (n, n) with joints before motors, and the joints (n_l,) at rest."""
        n_l, driven = len(self.chain), self.driven
        rest = np.zeros(n_l)
        rest[driven] = angles
        k, held = np.array([joint.spring.stiffness for _, _, joint in self.chain]), rest.copy()

        def hessian(q: np.ndarray) -> np.ndarray:
            h = 1e-5
            columns = [(self.gradient(q + h * e) - self.gradient(q - h * e)) / (2 * h) for e in np.eye(n_l)]
            return (np.array(columns) + np.array(columns).T) / 2

        for _ in range(8):
            rest = rest - np.linalg.solve(np.diag(k) + hessian(rest), k * (rest - held) + self.gradient(rest))
        n = n_l + len(driven)
        M, D, K = np.zeros((n, n)), np.zeros((n, n)), np.zeros((n, n))
        for b, body in enumerate(self.robot.bodies):
            Jv, Jw, R = self.of_body(rest, b)
            M[:n_l, :n_l] += body.mass * Jv.T @ Jv + Jw.T @ R @ body.inertia_matrix @ R.T @ Jw
        K[:n_l, :n_l] = hessian(rest)
        for i, (_, _, joint) in enumerate(self.chain):
            across = np.eye(n)[i]
            if joint.motor is not None:
                row, square = n_l + driven.index(i), joint.motor.ratio**2
                across[row], M[row, row], D[row, row] = -1.0, joint.motor.inertia * square, joint.motor.viscous * square
            K = K + k[i] * np.outer(across, across)
            D = D + joint.spring.damping * np.outer(across, across)
        return M, D, K, rest

    def motor_response(self, angles: np.ndarray) -> np.ndarray:
        """Acceleration of each motor per torque (F, n_u, n_u) on LINES."""
        M, D, K, rest = self.matrices(angles)
        s = 2j * np.pi * LINES[:, None, None]
        return (s**2 * np.linalg.inv(s**2 * M + s * D + K))[:, len(rest) :, len(rest) :]

    def tool(self, angles: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """With the motors held: compliance (6, 6), natural frequencies, G (F, 3, 3) on ASKED, axes of the base."""
        *matrices, rest = self.matrices(angles)
        n_l = len(rest)
        M, D, K = (each[:n_l, :n_l] for each in matrices)
        Jv, Jw, _ = self.jacobian(rest, n_l - 1, np.array(TOOL))
        J = np.vstack([Jv, Jw])
        s = 2j * np.pi * ASKED[:, None, None]
        G = Jv @ np.linalg.inv(s**2 * M + s * D + K) @ Jv.T
        return J @ np.linalg.solve(K, J.T), natural_frequencies(M, D, K), G
