r"""Motion-induced bias of the best linear approximation, since the measurement moves the robot out of its posture.

For the equations R(z) = B u of z = (q, lambda, q', q''), including phi(q) = 0 and the outputs, and a Gaussian motion
z_0 + e_1 + e_2 about the operating point, with e_1 proportional to the torque, and R', R'' at that point,

.. math:: L\, \delta X = - \big( \mathrm{E}[R'(z_0 + e_1)] - R' \big) X
          - \sum_{\pm k} R''\big[ e_2(\omega \pm \omega_k),\, e_1(\mp \omega_k) \big] - R''[\bar e_2, X], \qquad
          L\, e_2 = - \tfrac12 R''[e_1, e_1]

is the change of X = L^-1 B, the best linear approximation to second order in the motion. The first term is the
statistical linearisation: mean mass matrix, mean stiffness by gravity and loops, and the product of changing posture
and acceleration. The other terms are of the same size: products of e_1 and e_2, the motion at sums and differences of
lines. Only the sum of all terms is independent of the choice of coordinates and formulation. e_2 includes the feedback
of the controllers; without known feedback the motors do not move at these frequencies. The mean of the motors is
measured, because a controller without integral part has an offset by the mean torque of e_2.

The change is zero without motion and for linear equations. It is proportional to the square of the motion; neglected
terms of fourth order are smaller by this square in rad^2.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import Any

import casadi as ca
import numpy as np

from elastid.base.arrays import ComplexArray, FloatArray, IntArray, interpolate
from elastid.base.matrices import inverse
from elastid.linear.equilibrium import equilibrium, free_coordinates
from elastid.linear.linear_model import LinearModel
from elastid.linear.response.transfer import change_by_angles
from elastid.model.elastic import ElasticModel
from elastid.model.evaluation import evaluate_rows
from elastid.model.loop_closure import RANK_TOLERANCE
from elastid.response import MotorMotion, Response
from elastid.robot.robot import split_location

MAX_LINES, _MIN_LINES = 48, 8  # largest number of lines of motion and response, and number in the first estimate
NEGLIGIBLE = 0.1  # norm of the bias over all elements, in standard deviations, below which it is neglected
_LINES_ERROR = 30.0  # relative error of the bias on m lines is about this over m^2; its computation time grows as m^2
# Shift of the mean over the mean square of the motion, above which it is an offset of the encoder or of stated angles.
_MAX_SHIFT = 30.0


def estimate_motion_bias(
    model: ElasticModel, linear: LinearModel, theta: FloatArray, response: Response
) -> ComplexArray | None:
    """Estimate dG (F, n_y, n_u) that the motion adds to the response of a model about its equilibrium.

    linear: of `model` in a configuration.  theta (n_theta,): ends with the delay.  Motors without measurement do not
    move.  StudyError as `equilibrium`.
    None if the motion is unknown, the bias is negligible, or the equations are not finite along the motion (a gas
    spring at its end).  Negligible: no parameter of a fit shifts by more than this number of standard deviations.
    """
    motion, noise, freq_hz = response.motion, response.uncertainty, response.freq_hz
    if motion is None or not motion.power.any():
        return None
    expansion, max_lines = _expand(model, linear, theta), MAX_LINES
    measured = np.flatnonzero(np.isin(model.inputs, motion.motors))
    at = [motion.motors.index(model.inputs[i]) for i in measured]
    mean = _mean(expansion, motion, linear.configuration.angles, measured, at)
    inputs = [model.inputs.index(index) for index in linear.driven]
    if linear.controller is not None:
        inputs = [model.inputs.index(index) for index in linear.controller.motors]

    def of_motion(lines_hz: FloatArray, max_lines: int) -> ComplexArray:
        """Return dG (F, n_y, n_u) at lines_hz (F,) for a motion of at most max_lines lines."""
        omega = 2 * np.pi * lines_hz
        bias = _MotionBias.of(expansion, motion, measured, at, mean, max_lines)
        nodes = omega[np.unique(np.linspace(0, len(omega) - 1, max_lines).astype(np.int64))]
        changes = interpolate(omega, nodes, np.stack([bias.change(node) for node in nodes]))
        return change_by_angles(linear, theta, lines_hz, expansion.response_change(omega, changes)[:, :, inputs])

    if noise is not None:
        subset = np.unique(np.linspace(0, response.n_lines - 1, _MIN_LINES).astype(np.int64))
        rough = of_motion(freq_hz[subset], _MIN_LINES)
        with np.errstate(divide="ignore", invalid="ignore"):
            power_ratios = np.where(noise.variance[subset] > 0, np.abs(rough) ** 2 / noise.variance[subset], np.inf)
        size = np.sqrt(2 * float(np.sum(power_ratios)) * response.n_lines / len(subset))
        if size < NEGLIGIBLE:
            return None
        max_lines = int(min(max_lines, np.ceil(np.sqrt(_LINES_ERROR * size / NEGLIGIBLE))))
    effect = of_motion(freq_hz, max(max_lines, _MIN_LINES))
    return effect if np.isfinite(effect).all() else None


@dataclass(frozen=True, eq=False)
class _Expansion:
    """Expansion of R about an operating point in n unknowns x: all q, then the independent lambda.

    J (n + n_y, n_z), curvature (n_z, n + n_y, n_z): first and second derivative of the equations, then of the outputs.
    jacobian(z (K, n_z)): J (K, n + n_y, n_z) at other points.  B (n, n_u).  free: unknowns without the motors'
    coordinates.  orders (n_y,): 1 for outputs that are rates, 2 for accelerations.
    """

    n_q: int
    n: int
    J: FloatArray
    curvature: FloatArray
    jacobian: Callable[[FloatArray], FloatArray]
    B: FloatArray
    free: IntArray
    orders: IntArray

    def z(self, omega: float) -> ComplexArray:
        """Return the matrix (n_z, n) from the unknowns x to z at a frequency."""
        rates = np.eye(self.n_q, self.n)
        return np.asarray(np.vstack([np.eye(self.n), 1j * omega * rates, -(omega**2) * rates]), np.complex128)

    def L(self, omega: Any) -> ComplexArray:
        """Return the dynamic stiffness (n, n) with its constraints; (K, n, n) at K frequencies."""
        return self._in_front_of_x(self.J[: self.n], omega)

    def _in_front_of_x(self, J: FloatArray, omega: Any) -> ComplexArray:
        """Return J z (..., n_r, n) for rows J (n_r, n_z) and the matrix z at frequencies omega (...,)."""
        n, n_q, s = self.n, self.n_q, 1j * np.asarray(omega)[..., None, None]
        of_x = J[:, :n] + 0 * s
        of_x[..., :n_q] += s * J[:, n : n + n_q] + s**2 * J[:, n + n_q :]
        return of_x

    def X(self, omega: Any) -> ComplexArray:
        """Return L^-1 B (..., n, n_u)."""
        return np.asarray(np.linalg.solve(self.L(omega), self.B), np.complex128)

    def response_change(self, omega: FloatArray, change: ComplexArray) -> ComplexArray:
        """Return the change of the outputs as positions (F, n_y, n_u) by a change (F, n + n_y, n) of all equations."""
        X, of_equations, of_outputs = self.X(omega), change[:, : self.n], change[:, self.n :]
        dX = -np.linalg.solve(self.L(omega) + of_equations, of_equations @ X)
        of_motion = self._in_front_of_x(self.J[self.n :], omega) @ dX + of_outputs @ (X + dX)
        return of_motion / (1j * omega[:, None, None]) ** self.orders[:, None]

    def locked_inverse(self, omega: Any) -> ComplexArray:
        """Return L^-1 (..., n, n) with locked motors."""
        L = self.L(omega)
        inverse, free = np.zeros_like(L), (..., self.free[:, None], self.free)
        try:
            inverse[free] = np.linalg.inv(L[free])
        except np.linalg.LinAlgError:  # at 0 Hz, for a joint without stiffness
            inverse[free] = np.linalg.pinv(L[free])
        return inverse


@dataclass(frozen=True, eq=False)
class _MotionBias:
    """An expansion with the motion about its operating point.

    omega (2 K,): of both signs.  curvature_terms (2 K, m, n + n_y, n_z): R''[., e_1] of m independent motions at each
    frequency.  mean (n + n_y, n_z): E[R'] - R' plus R'' times the shift of the mean.  feedback (3, n_u, n_u) or None.
    """

    expansion: _Expansion
    omega: FloatArray
    curvature_terms: ComplexArray
    mean: FloatArray
    feedback: FloatArray | None

    @classmethod
    def of(
        cls, expansion: _Expansion, motion: MotorMotion, measured: IntArray, at: list[int], mean: FloatArray,
        max_lines: int,
    ) -> "_MotionBias":  # fmt: skip
        """Compute the terms of a motion on at most max_lines lines.  measured (n_m,): indices of its motors."""
        bins = motion.grouped(max_lines)
        sums, centres = bins.power[:, at][:, :, at], 2 * np.pi * bins.freq_hz
        W = _amplitudes(expansion, centres, sums, measured) / np.sqrt(2)  # of each sign of the frequency
        two_sided = np.concatenate([W, W.conj()])
        feedback = None
        if motion.feedback is not None and len(measured) == expansion.B.shape[1]:
            feedback = motion.feedback[:, at][:, :, at]
        curvature = np.tensordot(two_sided, expansion.curvature, axes=1)
        return cls(expansion, np.concatenate([centres, -centres]), curvature, mean, feedback)

    def change(self, omega: float) -> ComplexArray:
        """Return the change (n + n_y, n) of the coefficients of x in equations and outputs at omega."""
        e, omega_2, (rows, unknowns, equations, partners) = self.expansion, omega + self.omega, self._curvature_blocks
        (_, K, n_r, m, n_k), s = equations.shape, 1j * omega_2[:, None]
        # R''[., e_1] for each unknown: of its value, rate and acceleration.
        torque = -np.tensordot([1.0, 1j * omega, -(omega**2)], equations, axes=1).reshape(K, n_r, m * n_k)
        x = self._inverse(omega_2, rows[rows < e.n])[:, unknowns] @ torque
        weighted = (s ** np.arange(3))[:, None] @ partners
        total = (self.mean @ e.z(omega)).astype(np.complex128)
        total[np.ix_(rows, unknowns)] += np.sum(
            weighted.reshape(K, len(rows), n_k * m) @ x.reshape(K, n_k * m, n_k), axis=0
        )
        return total

    @cached_property
    def _curvature_blocks(self) -> tuple[IntArray, IntArray, ComplexArray, ComplexArray]:
        """Rows and unknowns (n_k,) with curvature, and R''[., e_1] restricted to them by order of derivative.

        Third, of the equations (3, 2 K, n_rows, m, n_k); last, of equations and outputs at the frequencies of opposite
        sign (2 K, 3, n_rows n_k m).
        """
        e, curvature = self.expansion, self.expansion.curvature != 0
        rows, curved = np.flatnonzero(curvature.any(axis=(0, 2))), curvature.any(axis=(1, 2))
        of_order = [np.arange(e.n), e.n + np.arange(e.n_q), e.n + e.n_q + np.arange(e.n_q)]
        unknowns = np.flatnonzero(np.any([np.pad(curved[z], (0, e.n - len(z))) for z in of_order], axis=0))
        K, m = self.curvature_terms.shape[:2]
        blocks = np.zeros((3, K, m, len(rows), len(unknowns)), complex)
        for block, columns in zip(blocks, of_order, strict=True):
            moving = unknowns < len(columns)
            block[..., moving] = self.curvature_terms[:, :, rows][..., columns[unknowns[moving]]]
        equations = np.ascontiguousarray(blocks[:, :, :, rows < e.n].transpose(0, 1, 3, 2, 4))
        partners = np.ascontiguousarray(blocks.conj().transpose(1, 0, 3, 4, 2))
        return rows, unknowns, equations, partners.reshape(K, 3, len(rows) * len(unknowns) * m)

    @cached_property
    def _controlled_stiffness(self) -> FloatArray:
        """Coefficients (4, n n) of 1 / s, 1, s and s^2 in the dynamic stiffness with feedback."""
        e, terms = self.expansion, np.zeros((4, self.expansion.n, self.expansion.n))
        if self.feedback is not None:
            terms[:3] = e.B @ self.feedback @ e.B.T
        for term, J in zip(terms[1:], np.split(e.J[: e.n], [e.n, e.n + e.n_q], axis=1), strict=True):
            term[:, : J.shape[1]] += J
        return terms.reshape(4, -1)

    def _inverse(self, omega: FloatArray, rows: IntArray) -> ComplexArray:
        """Return the columns `rows` (2 K, n, n_r) of the inverse of the dynamic stiffness with feedback."""
        e, is_static = self.expansion, np.abs(omega) < 1e-6 * np.abs(self.omega).max()
        if self.feedback is None:
            return e.locked_inverse(omega)[:, :, rows]
        s = 1j * np.where(is_static, 1.0, omega)[:, None]
        L = np.hstack([1 / s, np.ones_like(s), s, s**2]) @ self._controlled_stiffness
        controlled = inverse(L.reshape(-1, e.n, e.n))[:, :, rows]
        if is_static.any():
            controlled[is_static] = e.locked_inverse(0.0)[:, rows]
        return controlled


def _amplitudes(expansion: _Expansion, omega: FloatArray, power: ComplexArray, measured: IntArray) -> ComplexArray:
    """Return W (K, m, n_z), amplitudes of z for motor angles of mean square `power` (K, m, m)."""
    values, vectors = np.linalg.eigh(power)
    X, s = expansion.X(omega), 1j * omega[:, None, None]
    per_angle = X @ np.linalg.inv(expansion.B.T @ X)[:, :, measured]
    x = per_angle @ (vectors * np.sqrt(np.maximum(values, 0.0))[:, None, :])
    v = s * x[:, : expansion.n_q]
    return np.concatenate([x, v, s * v], axis=1).swapaxes(1, 2)


def _mean(
    expansion: _Expansion, motion: MotorMotion, angles: FloatArray, measured: IntArray, at: list[int]
) -> FloatArray:
    """Return E[R'(z_0 + e)] - R' + R''[E[e_2]] (n + n_y, n_z) for Gaussian e and motors at their mean angles."""
    amplitudes = _amplitudes(expansion, 2 * np.pi * motion.freq_hz, motion.power[:, at][:, :, at], measured)
    rows = amplitudes.reshape(-1, amplitudes.shape[2])
    covariance = (rows.T @ rows.conj()).real
    shift = np.zeros_like(angles)
    shift[measured] = motion.mean[at] - angles[measured]
    shift = np.where(np.abs(shift) < _MAX_SHIFT * np.sum(motion.rms**2), shift, 0.0)  # also for NaN
    # E[R'(z_0 + e)] - R' by second differences along the principal axes of the motion.
    values, vectors = np.linalg.eigh(covariance)
    significant = values > 1e-18 * values[-1]
    e = (vectors[:, significant] * np.sqrt(values[significant])).T
    slope = np.sum(expansion.jacobian(np.vstack([e, -e])) - expansion.J, axis=0) / 2
    n, x = expansion.n, expansion.B @ shift
    torque = np.einsum("arb,ab->r", expansion.curvature[:, :n], covariance) / 2 + expansion.L(0.0).real @ x
    of_mean = np.tensordot(x - expansion.locked_inverse(0.0).real @ torque, expansion.curvature[:n], axes=1)
    return np.asarray(slope + of_mean)


def _expand(model: ElasticModel, linear: LinearModel, theta: FloatArray) -> _Expansion:
    """Expand R of a model about its equilibrium, with its outputs and controlled motors."""
    point = equilibrium(model, theta[:-1], linear.configuration)
    numbers = model.with_payload(theta[:-1], linear.configuration.has_payload)
    outputs = linear.outputs if linear.controller is None else (*linear.outputs, *linear.controller.motors)
    n_q, n_c, n_y = model.n_q, model.n_c, len(outputs)
    # For redundant constraints only independent combinations have multipliers.
    U = np.zeros((n_c, 0))
    if n_c:
        vectors, size, _ = np.linalg.svd(model.constraint_jacobian(point.q, numbers).full())
        U = vectors[:, : int(np.sum(size > RANK_TOLERANCE * size.max()))]
    r, n = U.shape[1], n_q + U.shape[1]
    columns = np.zeros((3 * n_q + n_c, 2 * n_q + n))
    columns[:n_q, :n_q], columns[n_q : n_q + n_c, n_q:n], columns[n_q + n_c :, n:] = np.eye(n_q), U, np.eye(2 * n_q)
    rows = np.zeros((n + n_y, n_q + n_c + n_y))
    rows[:n_q, :n_q], rows[n_q:n, n_q : n_q + n_c], rows[n:, n_q + n_c :] = np.eye(n_q), U.T, np.eye(n_y)
    z = np.concatenate([point.q, point.lambda_, np.zeros(2 * n_q)])
    slope = _jacobian_of(model, outputs)

    def jacobian(distances: FloatArray) -> FloatArray:
        theta = np.broadcast_to(numbers, (len(distances), len(numbers)))
        return rows @ evaluate_rows(slope, z + distances @ columns.T, theta)[0] @ columns

    # Central differences in rad or m; equations are quadratic in the rates and linear in the others.
    steps = np.diag(np.where(np.arange(2 * n_q + n) < n_q, 1e-5, 1.0))
    J, ahead, behind = np.split(jacobian(np.vstack([0 * steps[:1], steps, -steps])), [1, 1 + len(steps)])
    curvature = (ahead - behind) / (2 * np.diag(steps)[:, None, None])
    B = np.vstack([model.B, np.zeros((r, model.n_u))])
    free = np.concatenate([free_coordinates(model), np.arange(n_q, n)])
    orders = np.array([2 if is_point(location) else 1 for location in outputs])
    return _Expansion(n_q, n, J[0], curvature, jacobian, B, free, orders)


@lru_cache(maxsize=8)
def _jacobian_of(model: ElasticModel, outputs: tuple[str, ...]) -> ca.Function:
    """Build (z, theta) -> slope (n_q + n_c + n_y, 3 n_q + n_c) of M q'' + f + Phi^T lambda, phi and the outputs."""
    q, v, a, lambda_, theta = model.symbols("q", "v", "a", "lambda", "theta")
    forces = model.mass(q, theta) @ a + model.force(q, v, theta) + model.constraint_jacobian(q, theta).T @ lambda_
    rates = model.readout(q, theta, outputs)[0] @ v
    outputs_of = [
        _acceleration(model, place, q, v, a, theta) if is_point(place) else rates[i] for i, place in enumerate(outputs)
    ]
    z = ca.vertcat(q, lambda_, v, a)
    R = ca.vertcat(forces, model.constraint(q, theta), *outputs_of)
    return ca.Function("slope", [z, theta], [ca.densify(ca.jacobian(R, z))], {"cse": True})


def is_point(location: str) -> bool:
    """Return True for the translation of a frame along an axis: `frame tool x`, `accelerometer tool x`."""
    kind, _, axis = split_location(location)
    return kind == "accelerometer" or (kind == "frame" and axis in ("x", "y", "z"))


def _acceleration(model: ElasticModel, location: str, q: ca.SX, v: ca.SX, a: ca.SX, theta: ca.SX) -> ca.SX:
    """Return the acceleration v' + omega x v along an axis of a frame; for accelerometers minus gravity."""
    kind, name, axis = split_location(location)
    f, i = [frame.name for frame in model.robot.frames].index(name), "xyz".index(axis)
    J = model.frame_velocity(q, theta)[6 * f : 6 * f + 6, :]
    velocity, turning = J[:3, :] @ v, J[3:, :] @ v
    along = J[:3, :] @ a + ca.jtimes(velocity, q, v) + ca.cross(turning, velocity)
    gravity = model.frame_gravity(q, theta)[3 * f + i] if kind == "accelerometer" else 0
    return along[i] - gravity
