r"""Linear models of a fitted robot with locked motors in many postures: equilibria, matrices and slopes as stacks.

.. math:: \frac{d(M, D, K, J)}{d\theta} = \frac{\partial(M, D, K, J)}{\partial \theta}
          - \frac{\partial(M, D, K, J)}{\partial q} K^{-1} \frac{\partial^2 V}{\partial q\, \partial \theta}

M, D, K (n, n): mass, damping and stiffness of the n motions N with locked motors, SI.  J (3, n): velocity of the frame.
V: potential energy of springs and gravity.  q (n_q,): coordinates.  theta: parameters.  lambda: forces of closed loops.

The second term belongs to operating points that follow the parameters (`Linearisation.follows`). CasADi builds the
equations once, with the fitted numbers as constants. Robots with loops are linearised posture by posture.
"""

from contextlib import suppress
from dataclasses import dataclass
from functools import cached_property

import casadi as ca
import numpy as np

from elastid.base.arrays import BoolArray, ComplexArray, FloatArray, IntArray
from elastid.base.errors import StudyError
from elastid.fit.posture import Family
from elastid.linear.equilibrium import CONVERGED_STEP, MAX_STEP, MIN_INERTIA, equilibrium, free_coordinates
from elastid.linear.linear_model import Slope
from elastid.linear.ports import locked_motor_motions
from elastid.model.evaluation import evaluate_rows
from elastid.model.kinematics import frame_poses
from elastid.parameters import DELAY
from elastid.record import Configuration


@dataclass(frozen=True, eq=False)
class LockedPostures:
    """Linear models of Q postures, from force to motion (3,) of a frame, in the axes of the base.

    M, D, K (Q, n, n), J (Q, 3, n).  Slopes by P parameters: triangles (Q, 3 n (n + 1) / 2, P), the lower triangles of
    M, D and K, and J_slopes (Q, 3, n, P).  stiffness (Q, n_s), deflection (Q, n_s, n): of springs.  position (Q, 3).
    """

    M: FloatArray
    D: FloatArray
    K: FloatArray
    J: FloatArray
    triangles: FloatArray
    J_slopes: FloatArray
    stiffness: FloatArray
    deflection: FloatArray
    position: FloatArray

    def motions(self, s: ComplexArray, forces: FloatArray) -> ComplexArray:
        """Return (s^2 M + s D + K)^-1 J^T F (Q, L, n, m) for forces F (Q or 1, 3, m) at s (Q or 1, L), rad/s."""
        s = s[:, :, None, None]
        Z = s**2 * self.M[:, None] + s * self.D[:, None] + self.K[:, None]
        return np.asarray(np.linalg.solve(Z, (self.J.mT @ forces).astype(complex)[:, None]), complex)

    def response_slopes(
        self, s: ComplexArray, a: FloatArray | ComplexArray, b: FloatArray | ComplexArray, x: ComplexArray,
        y: ComplexArray,
    ) -> ComplexArray:  # fmt: skip
        """Return slopes (Q, L, P) of a^T G b at s (Q, L), for directions a, b (Q, 3) with motions x, y (Q, L, n)."""
        of_J = sum(motion @ (d[:, :, None, None] * self.J_slopes).sum(axis=1) for motion, d in ((y, a), (x, b)))
        return np.asarray(of_J - self.slopes(s, x, y))

    def slopes(self, s: ComplexArray, left: ComplexArray, right: ComplexArray) -> ComplexArray:
        """Return left^T d(s^2 M + s D + K) right (Q, L, P) at s (Q or 1, L); left, right (Q, L, n)."""
        i, j = np.tril_indices(self.M.shape[1])
        products = left[..., i] * right[..., j] + (i != j) * (left[..., j] * right[..., i])
        weights = np.concatenate([s[..., None] ** 2 * products, s[..., None] * products, products], axis=2)
        return weights.real @ self.triangles + 1j * (weights.imag @ self.triangles)


@dataclass(frozen=True, eq=False)
class LockedEquations:
    """Equations of a fitted robot with locked motors and its own numbers.  family: its inputs are forces of a frame."""

    family: Family

    @cached_property
    def dependent(self) -> IntArray:
        """Places (P,) in theta of the parameters that the fit moves."""
        model, estimated = self.family.model, self.family.estimated
        absent = (DELAY, *(model.of_payload if self.family.request.payload is False else ()))
        return np.array([row for row in estimated.dependent if estimated.names[row] not in absent], np.int64)

    @cached_property
    def _statics(self) -> ca.Function:
        """Function q -> dV/dq and K of the free coordinates, and M."""
        model, (q, lambda_, theta) = self.family.model, self._symbols
        free = free_coordinates(model).tolist()
        gradient, K = model.potential_gradient(q, theta)[free], model.stiffness(q, lambda_, theta)[free, free]
        return self._with_numbers({"gradient": gradient, "K": K, "M": model.mass(q, theta)})

    @cached_property
    def _linearised_elements(self) -> ca.Function:
        """Function q -> m elements (lower triangles of M, D and K, then vec J) with slopes, and the springs' numbers.

        by_theta (m, P), by_q (m, n_free): slopes of the elements.  gradient_by_theta (n_free, P): slopes of dV/dq.
        """
        model, (q, lambda_, theta) = self.family.model, self._symbols
        dependent, free = self.dependent.tolist(), free_coordinates(model).tolist()
        N = ca.sparsify(ca.DM(locked_motor_motions(model.B)))
        rows, columns = np.tril_indices(N.shape[1])
        lower = (columns * N.shape[1] + rows).tolist()  # CasADi counts column by column
        matrices = model.mass(q, theta), model.damping(q, theta), model.stiffness(q, lambda_, theta)
        J = model.readout(q, theta, [f"frame {self.family.frame} {axis}" for axis in "xyz"])[0] @ N
        elements = ca.vertcat(*(ca.densify(N.T @ A @ N)[lower] for A in matrices), ca.vec(ca.densify(J)))
        c, b = model.strain(q, theta)
        expressions = {
            "elements": elements,
            "by_theta": ca.jacobian(elements, theta)[:, dependent],
            "by_q": ca.jacobian(elements, q)[:, free],
            "gradient_by_theta": ca.jacobian(model.potential_gradient(q, theta)[free], theta)[:, dependent],
            "stiffness": c,
            "deflection": b @ N,
        }
        return self._with_numbers(expressions)

    @cached_property
    def _symbols(self) -> list[ca.SX]:
        return self.family.model.symbols("q", "lambda", "theta")

    def _with_numbers(self, expressions: dict[str, ca.SX]) -> ca.Function:
        """Return q -> dense expressions of `_symbols`, with theta of the fit and without lambda."""
        q, family, outputs = self._symbols[0], self.family, [*expressions.values()]
        numbers = ca.DM(family.model.with_payload(family.theta, family.request.payload is not False))
        values = ca.Function("of", self._symbols, outputs)(q, ca.DM(0, 1), numbers)
        return ca.Function("at", [q], [*map(ca.densify, values)], ["q"], [*expressions], {"cse": True})

    def _configuration(self, angles: FloatArray) -> Configuration:
        return Configuration("posture", angles, self.family.request.payload is not False)

    def rest(self, angles: FloatArray) -> tuple[FloatArray, BoolArray]:
        """Return the equilibrium q (N, n_q) with motors at angles (N, n_u), and whether it exists (N,)."""
        # Newton's method solves all postures together; if one does not converge, `equilibrium` solves each of them.
        model, free = self.family.model, free_coordinates(self.family.model)
        q, has_rest = np.zeros((len(angles), model.n_q)), np.zeros(len(angles), bool)
        with suppress(np.linalg.LinAlgError), np.errstate(invalid="ignore", over="ignore"):
            q[:, : model.robot.n_l] = model.robot.joint_positions(angles)
            q[:, [model.index(motor) for motor in model.inputs]] = angles
            rigid, step = q.copy(), np.ones((len(angles), len(free), 1))
            for _ in range(0 if model.n_c else 10):  # each step doubles the digits
                gradient, K, M = evaluate_rows(self._statics, q)
                step[:] = -np.linalg.solve(K, gradient)
                q[:, free] += step[:, :, 0]
                if np.abs(step).max(initial=0.0) <= CONVERGED_STEP and np.abs(q - rigid).max(initial=0.0) <= MAX_STEP:
                    # LinAlgError for a posture that is unstable or without inertia.
                    np.linalg.cholesky(K), np.linalg.cholesky(M * (1 - MIN_INERTIA * np.eye(model.n_q)))
                    has_rest[:] = True
                    break
        for i in np.flatnonzero(~has_rest):
            with suppress(StudyError):
                q[i] = equilibrium(model, self.family.theta, self._configuration(angles[i])).q
                has_rest[i] = True
        return q, has_rest

    def at(self, angles: FloatArray, q: FloatArray) -> LockedPostures:
        """Return the models linearised at equilibria q (Q, n_q) with motors at angles (Q, n_u)."""
        model, follows = self.family.model, self.family.linearisation.follows
        poses = frame_poses(model.robot_at(self.family.theta), q[:, : model.robot.n_l], self.family.frame)
        if model.n_c or not locked_motor_motions(model.B).size:
            fields = *zip(*map(self._linearised, angles, q), strict=True), poses.position
            return LockedPostures(*map(np.array, fields))
        function = self._linearised_elements
        rows = dict(zip(function.name_out(), evaluate_rows(function, q), strict=True))
        elements, slopes, c, b = (rows[name] for name in ("elements", "by_theta", "stiffness", "deflection"))
        if follows:
            _, K_free, _ = evaluate_rows(self._statics, q)
            slopes = slopes - rows["by_q"] @ np.linalg.solve(K_free, rows["gradient_by_theta"])
        n, n_t = b.shape[2], elements.shape[1] - 3 * b.shape[2]
        (i, j), A = np.tril_indices(n), np.zeros((3, len(q), n, n))
        A[..., i, j] = A[..., j, i] = elements[:, :n_t, 0].reshape(len(q), 3, -1).swapaxes(0, 1)
        J = poses.rotation @ elements[:, n_t:, 0].reshape(len(q), n, 3).mT
        # A model that does not follow its parameters is affine in them: no length is free, and J is constant.
        J_slopes = np.einsum("qij,qnjp->qinp", poses.rotation, follows * slopes[:, n_t:].reshape(len(q), n, 3, -1))
        M, D, K = A
        return LockedPostures(M, D, K, J, slopes[:, :n_t], J_slopes, c[:, :, 0], b, poses.position)

    def _linearised(self, angles: FloatArray, q: FloatArray) -> tuple[FloatArray, ...]:
        """Return the fields of `LockedPostures` except the position, for one posture of a robot with loops."""
        family, linear = self.family, self.family.at(self._configuration(angles)).linear
        slopes = [linear.slopes.get(family.estimated.names[row], Slope()) for row in self.dependent]

        def stacked(letter: str) -> FloatArray:
            matrices, zero = [getattr(slope, letter) for slope in slopes], np.zeros_like(getattr(linear, letter))
            return np.stack([zero if matrix is None else matrix for matrix in matrices], axis=-1)

        triangles = np.concatenate([stacked(letter)[np.tril_indices(linear.n)] for letter in "MDK"])
        c, b = (matrix.full() for matrix in family.model.strain(q, family.theta))
        return linear.M, linear.D, linear.K, linear.C, triangles, stacked("C"), c[:, 0], b @ linear.Z
