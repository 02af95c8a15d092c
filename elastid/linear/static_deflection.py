r"""Static deflection of frames under constant forces and torques.

.. math:: \partial V / \partial q_f + \Phi_f^T \lambda = J_f^T F, \qquad \varphi = 0, \qquad
          y = p(q_{loaded}) - p(q_{unloaded}), \qquad
          \frac{dz}{d\theta} = -\begin{bmatrix} K & \Phi_f^T \\ \Phi_f & 0 \end{bmatrix}^{-1}
          \frac{\partial}{\partial \theta} \begin{bmatrix} \partial V / \partial q_f + \Phi_f^T \lambda - J_f^T F \\
          \varphi \end{bmatrix}, \quad z = (q_f, \lambda)

Newton's method solves all configurations and loads at once, exact for gravity, nonlinear springs and closed loops. To
first order y = J K^-1 J^T F, K: tangent stiffness under the load. Forces and torques have constant directions in the
axes of the base.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import casadi as ca
import numpy as np

from elastid.base.arrays import FloatArray, IntArray
from elastid.base.errors import StudyError, did_you_mean
from elastid.linear.equilibrium import MAX_STEP, MAX_STEPS, ROUNDING_GAP, equilibrium, free_coordinates
from elastid.model.elastic import ElasticModel
from elastid.model.evaluation import evaluate_rows
from elastid.model.frame_tree import position, rotation, tree, turns
from elastid.record import Configuration

_MIN_FRACTION = 1e-3  # of a step, below which it is accepted without decrease, as at the kink of a gap


@dataclass(frozen=True, eq=False)
class Load:
    """Force and torque (3,) at the origin of a frame, N and N m, and the measured frame, in the axes of the base.

    directions (n, 3): of the measurements at the frame `read_at`.
    """

    configuration: Configuration
    frame: str
    force: FloatArray
    torque: FloatArray
    read_at: str
    directions: FloatArray


@dataclass(frozen=True, eq=False)
class LoadedRobot:
    """A robot under L loads, with the equilibria without load as start values.

    z (2 L, n_z): free coordinates and multipliers, first for unloaded, then for loaded configurations.
    locked (2 L, n_q): coordinates with the motors at their angles.  wrench (2 L, 6 n_f): 0 without load.
    dependent (n_p,): indices of parameters with derivatives.  statics(z, locked, theta, wrench) -> residual forces
    (n_z,) and their slopes to z.  slopes(...) -> slopes of the forces to the parameters, positions of all frames (3
    n_f,), and their slopes to z and to the parameters.
    """

    model: ElasticModel
    loads: tuple[Load, ...]
    frames: tuple[str, ...]
    dependent: IntArray
    z: FloatArray
    locked: FloatArray
    wrench: FloatArray
    statics: ca.Function
    slopes: ca.Function

    @classmethod
    def of(
        cls, model: ElasticModel, loads: Sequence[Load], theta: Sequence[FloatArray], dependent: Sequence[str]
    ) -> "LoadedRobot":
        """Build the loaded robot, with theta (n_theta,) of each load; StudyError without an equilibrium."""
        frame_names = [frame.name for frame in model.robot.frames]
        frames = tuple(dict.fromkeys(name for load in loads for name in (load.frame, load.read_at)))
        for name in frames:
            if name not in frame_names:
                raise StudyError(
                    "robot/unknown-name",
                    f"robot {model.robot.name} has no frame {name}; {did_you_mean(name, frame_names)}",
                )
        free = free_coordinates(model)
        indices = np.array([i for i, name in enumerate(model.parameters) if name in dependent], np.int64)
        points = [equilibrium(model, t, load.configuration) for t, load in zip(theta, loads, strict=True)]
        z = np.array([np.append(point.q[free], point.lambda_) for point in points])
        q_locked = np.array([point.q for point in points])
        wrench = np.zeros((len(loads), len(frames), 6))
        for i, load in enumerate(loads):
            wrench[i, frames.index(load.frame)] = np.append(load.force, load.torque)
        wrenches = np.concatenate([np.zeros_like(wrench), wrench]).reshape(2 * len(loads), -1)
        functions = _functions(model, frames, tuple(indices.tolist()))
        return cls(
            model, tuple(loads), frames, indices, np.tile(z, (2, 1)), np.tile(q_locked, (2, 1)), wrenches, *functions
        )

    def deflections(self, theta: Sequence[FloatArray]) -> tuple[list[FloatArray], list[FloatArray]]:
        """Return the deflections (n,), m, and their slopes (n, n_p) of each load, at theta (n_theta,) of each load.

        LinAlgError without an equilibrium.
        """
        pairs = zip(theta, self.loads, strict=True)
        with_payload = [self.model.with_payload(t, load.configuration.has_payload) for t, load in pairs]
        numbers = np.tile(np.array(with_payload), (2, 1))
        z, K = self._equilibria(numbers)
        by_theta, p, p_z, p_theta = self._at(self.slopes, z, numbers)
        slopes = p_theta - p_z @ self._solve(K, by_theta)
        L, indices = len(self.loads), [3 * self.frames.index(load.read_at) for load in self.loads]
        values, of_theta = [], []
        for i, (load, at) in enumerate(zip(self.loads, indices, strict=True)):
            rows = slice(at, at + 3)
            values.append(load.directions @ (p[L + i, rows, 0] - p[i, rows, 0]))
            of_theta.append(load.directions @ (slopes[L + i, rows] - slopes[i, rows]))
        return values, of_theta

    def _equilibria(self, theta: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Solve for the equilibria z (2 L, n_z) at theta (2 L, n_theta). Also return the slopes (2 L, n_z, n_z)."""
        z = self.z.copy()
        r, K = self._at(self.statics, z, theta)
        for _ in range(MAX_STEPS):
            step = -self._solve(K, r)[:, :, 0]
            largest = np.abs(step[:, : step.shape[1] - self.model.n_c]).max(axis=1, initial=0.0)
            if not np.isfinite(step).all():
                break
            if largest.max() < ROUNDING_GAP:  # convergence is quadratic
                return z + step, K
            fraction = np.minimum(1.0, MAX_STEP / np.maximum(largest, 1e-300))
            size = _size(r, K)
            while True:
                z_new = z + fraction[:, None] * step
                r, K = self._at(self.statics, z_new, theta)
                worse = (_size(r, K) > (1 - fraction / 10) * size) & (size > 1e-9) & (fraction > _MIN_FRACTION)
                if not worse.any():
                    break
                fraction = np.where(worse, fraction / 2, fraction)
            z = z_new
        raise np.linalg.LinAlgError("a robot finds no rest under its loads")

    def _at(self, function: ca.Function, z: FloatArray, theta: FloatArray) -> tuple[FloatArray, ...]:
        return evaluate_rows(function, z, self.locked, theta, self.wrench)

    def _solve(self, K: FloatArray, right: FloatArray) -> FloatArray:
        """Return K^-1 right; for redundant constraints, with the smallest multipliers."""
        if not self.model.n_c:
            return np.asarray(np.linalg.solve(K, right), dtype=float)
        return np.linalg.pinv(K, rcond=1e-12, hermitian=False) @ right


def _size(r: FloatArray, K: FloatArray) -> FloatArray:
    """Return the largest residual force (L,) over the stiffness of its row, approximately a deflection."""
    return np.asarray(np.abs(r[:, :, 0] / np.maximum(np.abs(K).max(axis=2), 1e-300)).max(axis=1, initial=0.0))


@lru_cache(maxsize=8)
def _functions(
    model: ElasticModel, frames: tuple[str, ...], dependent: tuple[int, ...]
) -> tuple[ca.Function, ca.Function]:
    """Build `LoadedRobot.statics` and `LoadedRobot.slopes`."""
    free = free_coordinates(model).tolist()
    z, q_locked = ca.SX.sym("z", len(free) + model.n_c), ca.SX.sym("held", model.n_q)
    (theta,), wrench = model.symbols("theta"), ca.SX.sym("wrench", 6 * len(frames))
    q, lambda_ = ca.SX(q_locked), z[len(free) :]
    q[free] = z[: len(free)]
    by_name = dict(zip(model.parameters, ca.vertsplit(theta), strict=True))
    layout = tree(model.robot, {name: symbol for name, symbol in by_name.items() if name in model.robot.geometry})
    joint_turns, names = turns(layout, q[: model.robot.n_l]), [frame.name for frame in model.robot.frames]
    forces = model.potential_gradient(q, theta) + (model.constraint_jacobian(q, theta).T @ lambda_ if model.n_c else 0)
    rates = model.frame_velocity(q, theta)
    points = []
    for i, name in enumerate(frames):
        index = names.index(name)
        seat = layout.named[index]
        points.append(position(layout, joint_turns, seat))
        R = rotation(layout, joint_turns, seat)
        J = rates[6 * index : 6 * index + 6, :]
        forces -= J[:3, :].T @ (R.T @ wrench[6 * i : 6 * i + 3]) + J[3:, :].T @ (R.T @ wrench[6 * i + 3 : 6 * i + 6])
    h, p, varied = ca.vertcat(forces[free], model.constraint(q, theta)), ca.vertcat(*points), theta[list(dependent)]
    slopes = [ca.jacobian(h, varied), p, ca.jacobian(p, z), ca.jacobian(p, varied)]
    arguments, options = [z, q_locked, theta, wrench], {"cse": True}
    statics = ca.Function("statics", arguments, [ca.densify(term) for term in (h, ca.jacobian(h, z))], options)
    return statics, ca.Function("slopes", arguments, [ca.densify(term) for term in slopes], options)
