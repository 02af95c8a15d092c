r"""Linearisation of an ElasticModel about a configuration, with exact derivatives to every parameter.

.. math:: M(q_0)\, \delta\ddot q + D\, \delta\dot q + K \delta q = B\, \delta u, \qquad
          K = \partial^2 (V + \lambda_0^T \varphi) / \partial q^2

Springs, gravity and the geometric stiffness of the constraints follow from one Hessian. Coriolis terms are quadratic in
the velocities and vanish. The operating point depends on the parameters, and with it the matrices A = M, D, K,

.. math:: \begin{bmatrix} K_{ff} & \Phi_f^T \\ \Phi_f & 0 \end{bmatrix}
          \begin{bmatrix} dq_f \\ d\lambda \end{bmatrix} = - \frac{\partial}{\partial \theta}
          \begin{bmatrix} \partial V / \partial q_f + \Phi_f^T \lambda \\ \varphi \end{bmatrix} d\theta,
          \qquad \frac{dA}{d\theta} = \frac{\partial A}{\partial \theta}
          + \frac{\partial A}{\partial q_f} \frac{dq_f}{d\theta}
          + \frac{\partial A}{\partial \lambda} \frac{d\lambda}{d\theta}

as well as C and T. f: free coordinates, all except the motors' coordinates. With linear springs, and with constrained
loops, the change of the operating point is neglected: it is a thousandth of the first term, and would add a rank-one
term per coordinate to each stiffness. It is included for nonlinear springs in the minimal formulation, and for free
geometry.

Constraints are eliminated by the motions Z that they allow at the operating point, dq = Z y: Z^T (.) Z for each matrix
and slope, Z^T B and C Z. Z depends on the parameters, Phi dZ = -dPhi Z; dZ is chosen such that the motors' rows of Z,
and therefore B, do not change.
"""

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache, cached_property, lru_cache
from typing import Any

import casadi as ca
import numpy as np

from elastid.base.arrays import FloatArray, IntArray, frozen
from elastid.base.errors import StudyError, check_theta
from elastid.linear.equilibrium import OperatingPoint, equilibrium, free_coordinates
from elastid.linear.linear_model import LinearModel, Slope, elements, project
from elastid.linear.presliding import RelaxingSpring, element_names, with_relaxing_springs
from elastid.model.elastic import ElasticModel
from elastid.model.evaluation import evaluate_rows
from elastid.model.formulation import EXACT, formulate
from elastid.model.loop_closure import RANK_TOLERANCE, motions, null_space
from elastid.model.spec import ModelSpec
from elastid.parameters import DELAY
from elastid.record import Configuration, Motion
from elastid.robot import Robot


@dataclass(frozen=True, eq=False)
class PointDerivatives:
    """Partial derivatives of statics, constraints and the triangles A of M, D, K at an operating point.

    partial(q, lambda_, theta) -> to theta: of statics (n_f, n_theta), phi (n_c, n_theta), vec Phi (n_c n_q, n_theta);
    to q_f: of A (.., n_f), vec Phi (n_c n_q, n_f); to lambda: of A (.., n_c).
    """

    model: ElasticModel
    partial: ca.Function

    def at(
        self, point: OperatingPoint, theta: FloatArray, K: FloatArray, Z: FloatArray
    ) -> tuple[FloatArray, FloatArray, FloatArray | None]:
        """Return dq_f (n_f, n_theta) and dA (.., n_theta) by the motion of the point, and dZ (n_theta, n_q, n).

        K (n_q, n_q), Z (n_q, n): stiffness and motions at the point; dZ is None without loops.
        StudyError for geometry whose change opens a loop.
        """
        model, free = self.model, free_coordinates(self.model)
        numbers = (point.q[None], point.lambda_[None], theta[None])
        statics, phi, Phi_theta, A_q, Phi_q, A_lambda = (block[0] for block in evaluate_rows(self.partial, *numbers))
        if not model.n_c:
            dq = -np.linalg.lstsq(K[np.ix_(free, free)], statics)[0]
            return dq, A_q @ dq, None
        Phi = model.constraint_jacobian(point.q, theta).full()
        inverse = np.linalg.pinv(Phi[:, free], rcond=RANK_TOLERANCE)
        Y = null_space(Phi[:, free])
        K_f = K[np.ix_(free, free)]
        back = -inverse @ phi
        # The joints must close every row of phi to 1e-6 of its gap.
        constraint_error = np.abs(Phi[:, free] @ back + phi).max(axis=0) > 1e-6 * np.abs(phi).max(initial=0.0)
        if constraint_error.any():
            names = ", ".join(name for name, is_open in zip(model.parameters, constraint_error, strict=True) if is_open)
            raise StudyError(
                "robot/loops",
                f"the loops of robot {model.robot.name} open if this value changes, for example an offset out of the "
                "plane of the linkage. Remove it from fit.parameters, or close the loop by a rod",
                names,
            )
        dq = back - Y @ np.linalg.lstsq(Y.T @ K_f @ Y, Y.T @ (statics + K_f @ back))[0]
        dlambda = -inverse.T @ (statics + K_f @ dq)
        dPhi = (Phi_theta + Phi_q @ dq).T.reshape(-1, model.n_q, model.n_c).transpose(0, 2, 1)
        dZ = np.zeros((len(dPhi), *Z.shape))
        dZ[:, free] = -inverse @ (dPhi @ Z)
        return dq, A_q @ dq + A_lambda @ dlambda, dZ


def differentiate_point(
    model: ElasticModel, triangles: ca.SX, q: ca.SX, lambda_: ca.SX, theta: ca.SX
) -> PointDerivatives:
    """Differentiate the equilibrium, and the triangles of M, D, K as expressions of q, lambda_ and theta."""
    free = free_coordinates(model).tolist()
    Phi, phi = model.constraint_jacobian(q, theta), model.constraint(q, theta)
    statics = model.potential_gradient(q, theta) + Phi.T @ lambda_
    A, vec_Phi = ca.vec(triangles), ca.vec(Phi)
    slopes = [ca.jacobian(expression, theta) for expression in (statics[free], phi, vec_Phi)]
    slopes += [*(ca.jacobian(expression, q)[:, free] for expression in (A, vec_Phi)), ca.jacobian(A, lambda_)]
    return PointDerivatives(model, ca.Function("partial", [q, lambda_, theta], list(map(ca.densify, slopes))))


def _output_slopes(
    model: ElasticModel, q: FloatArray, theta: FloatArray, outputs: tuple[str, ...], dq: FloatArray
) -> dict[str, FloatArray]:
    """Return slopes of C and T (n_theta, n_y, n_q) of the outputs; none for motors and joints."""
    if all(location.startswith(("motor ", "joint ")) for location in outputs):
        return {}
    C_q, C_theta, T_q, T_theta = (block.full() for block in _readout_slopes(model, outputs)(q, theta))
    slopes = {"C": C_theta + C_q @ dq, "T": T_theta + T_q @ dq}
    return {
        letter: block.T.reshape(-1, model.n_q, len(outputs)).transpose(0, 2, 1) for letter, block in slopes.items()
    }  # fmt: skip


@lru_cache(maxsize=8)
def _readout_slopes(model: ElasticModel, outputs: tuple[str, ...]) -> ca.Function:
    """Build (q, theta) -> d vec C / dq_f, d vec C / d theta, and of T."""
    (q, theta), free = model.symbols("q", "theta"), free_coordinates(model)
    entries = [ca.vec(ca.densify(matrix)) for matrix in model.readout(q, theta, outputs)]
    slopes = [s for matrix in entries for s in (ca.jacobian(matrix, q)[:, free.tolist()], ca.jacobian(matrix, theta))]
    return ca.Function("readout_slopes", [q, theta], slopes)


@dataclass(frozen=True, eq=False)
class Linearisation:
    """A model with its derivatives to theta, built once and evaluated in each configuration.

    matrices(q, lambda_, theta) -> lower triangles of M, D, K in columns (n_q (n_q + 1) / 2, 3), and their sparse
    Jacobian to theta (3 n_q (n_q + 1) / 2, n_theta).  point: None if the change of the operating point is neglected.
    recipe: arguments of `of_robot`, which are pickled instead of the functions. presliding: friction of motors; its
    numbers are in theta after the robot's numbers.
    """

    model: ElasticModel
    matrices: ca.Function
    point: PointDerivatives | None
    recipe: tuple[Robot, ModelSpec, tuple[str, ...]] | None = None
    presliding: tuple[RelaxingSpring, ...] = ()

    def __reduce__(self) -> "tuple[Callable[..., Linearisation], tuple[Any, ...]]":
        if self.recipe is not None:
            return _linearise, (*self.recipe, self.presliding)
        return Linearisation, (self.model, self.matrices, self.point, None, self.presliding)

    @property
    def parameters(self) -> tuple[str, ...]:
        """Names of theta: numbers of the robot, then of presliding friction."""
        return (*self.model.parameters, *element_names(self.presliding))

    @property
    def follows(self) -> bool:
        """True if the derivatives include the change of the operating point with the parameters."""
        return self.point is not None

    def is_affine_in(self, names: Collection[str]) -> bool:
        """Return True if M, D, K at a fixed operating point are jointly affine in these parameters: m, but not m c."""
        model = self.model
        theta = [ca.SX.sym(name) for name in model.parameters]
        q, lambda_ = model.symbols("q", "lambda")
        triangles = self.matrices(q, lambda_, ca.vertcat(*theta))[0]
        symbols = [symbol for name, symbol in zip(model.parameters, theta, strict=True) if name in names]
        return not symbols or not any(ca.which_depends(ca.vec(triangles), ca.vertcat(*symbols), 2))

    @classmethod
    def of(cls, model: ElasticModel, follows: bool = False) -> "Linearisation":
        """Differentiate a model.  follows: include the operating point, even if all springs are linear."""
        q, theta, lambda_ = model.symbols("q", "theta", "lambda")
        rows, columns = np.tril_indices(model.n_q)
        lower = (columns * model.n_q + rows).tolist()  # CasADi counts column by column
        matrices = (model.mass(q, theta), model.damping(q, theta), model.stiffness(q, lambda_, theta))
        triangles = ca.horzcat(*(ca.densify(matrix)[lower] for matrix in matrices))
        slopes = ca.jacobian(ca.vec(triangles), theta)
        moves = _moves_with_parameters(model) or (follows and model.n_c == 0)
        point = differentiate_point(model, triangles, q, lambda_, theta) if moves else None
        return cls(model, ca.Function("matrices", [q, lambda_, theta], [triangles, slopes]), point)

    @classmethod
    def of_robot(
        cls, robot: Robot, spec: ModelSpec = EXACT, geometry: Collection[str] = (),
        presliding: tuple[RelaxingSpring, ...] = (),
    ) -> "Linearisation":  # fmt: skip
        """Differentiate the equations of a robot, once per process; arguments and errors as `formulate`."""
        return _linearise(robot, spec, tuple(name for name in robot.on_demand if name in geometry), presliding)

    def at(
        self, configuration: Configuration, theta: FloatArray, outputs: Sequence[str], quantity: Motion,
        varied: Collection[str] | None = None,
    ) -> LinearModel:  # fmt: skip
        """Return the LinearModel about the equilibrium of a configuration, theta (n_theta,); errors as `linearise`.

        varied: names of parameters with slopes, by default all.
        """
        model = self.model
        check_theta(theta, self.parameters)
        theta, of_presliding = np.split(theta, [len(model.parameters)])
        names, theta_ref = (*model.parameters, DELAY), np.append(theta, 0.0)
        point, theta = equilibrium(model, theta, configuration), model.with_payload(theta, configuration.has_payload)
        triangles, numbers = evaluate_rows(self.matrices, point.q[None], point.lambda_[None], theta[None])
        M, D, K = (column[_scatter_indices(model.n_q)] for column in triangles[0].T)
        slopes = np.zeros(self.matrices.size_out(1))
        slopes[self._entries] = numbers[0].ravel("F")
        Z = motions(model, model.constraint_jacobian(point.q, theta).full())
        C, T = (np.ascontiguousarray(part.full()) for part in model.readout(point.q, theta, outputs))
        of_theta, dZ = {}, None
        if self.point is not None:
            dq, of_point, dZ = self.point.at(point, theta, K, Z)
            slopes, of_theta = slopes + of_point, _output_slopes(model, point.q, theta, tuple(outputs), dq)
        triangles_of_theta = slopes.T.reshape(len(model.parameters), 3, -1).swapaxes(0, 1)
        of_theta |= dict(zip("MDK", triangles_of_theta[:, :, _scatter_indices(model.n_q)], strict=True))
        absent = () if configuration.has_payload else model.of_payload
        varied = set(names if varied is None else varied).difference(absent)
        of_name = _slopes(model, {"M": M, "D": D, "K": K, "C": C, "T": T}, of_theta, Z, dZ, varied)
        locations = model.inputs, tuple(outputs), quantity
        M, D, K = (project(Z, matrix) for matrix in (M, D, K))
        B, C, T = Z.T @ model.B, C @ Z, T @ Z
        chain, sliding = elements(model.robot.chain), model.robot.sliding((*model.inputs, *outputs))
        channels = tuple(name for name in model.parameters if name in model.robot.channel_numbers)
        linear = LinearModel(
            configuration, names, theta_ref, M, D, K, of_name, B, C, *locations, T, chain, Z, channels, sliding=sliding
        )
        if not self.presliding:
            return linear
        shafts = B @ model.robot.mixing.T  # columns b of q_m = E q_a = b^T q
        driven = [shafts[:, model.robot.driven_names.index(spring.joint)] for spring in self.presliding]
        return with_relaxing_springs(linear, self.presliding, np.array(driven), of_presliding)

    @cached_property
    def _entries(self) -> tuple[IntArray, IntArray]:
        rows, columns = self.matrices.sparsity_out(1).get_triplet()
        return np.array(rows, np.int64), np.array(columns, np.int64)


def _moves_with_parameters(model: ElasticModel) -> bool:
    """Return True if geometry is free, a stiffness depends on the deflection, or springs are in series."""
    robot = model.robot
    is_nonlinear = any(joint.spring is not None and not joint.spring.is_linear for joint in robot.joints)
    return bool(model.geometry) or (
        model.n_c == 0 and (is_nonlinear or any(box.is_in_series for box in robot.gearboxes))
    )


@lru_cache(maxsize=4)
def _linearise(
    robot: Robot, spec: ModelSpec, geometry: tuple[str, ...], presliding: tuple[RelaxingSpring, ...] = ()
) -> Linearisation:
    plain = _linearise(robot, spec, geometry) if presliding else Linearisation.of(formulate(robot, spec, geometry))
    return replace(plain, recipe=(robot, spec, geometry), presliding=presliding)


def linearise(
    model: ElasticModel, configuration: Configuration, theta: FloatArray, outputs: Sequence[str], quantity: Motion
) -> LinearModel:
    """Return the LinearModel of one configuration; for several, build `Linearisation.of(model)` once.

    theta (n_theta,): model.parameters in SI, without the delay, which LinearModel adds at the end.
    outputs: locations such as `motor 1`, `joint 1`, `body arm z`, `frame tool x`.  quantity: of the outputs.
    ValueError unless theta has one value per parameter, UnknownNameError for an unknown quantity, StudyError without
    equilibrium, for an unknown location, or for a coordinate without inertia.
    """
    return Linearisation.of(model).at(configuration, theta, outputs, quantity)


@cache
def _scatter_indices(n: int) -> IntArray:
    """Return the index of each entry of a symmetric (n, n) matrix in its lower triangle."""
    indices = np.zeros((n, n), np.int64)
    rows, columns = np.tril_indices(n)
    indices[rows, columns] = indices[columns, rows] = np.arange(rows.size)
    return indices


def _slopes(
    model: ElasticModel, matrices: Mapping[str, FloatArray], of_theta: Mapping[str, FloatArray], Z: FloatArray,
    dZ: FloatArray | None, names: Collection[str],
) -> dict[str, Slope]:  # fmt: skip
    """Return the slopes of Z^T (M, D, K) Z, C Z and T Z by name of the parameters with an effect.

    matrices: M, D, K (n_q, n_q) and C, T (n_y, n_q) in all coordinates; of_theta, dZ (n_theta, ...): derivatives.
    """
    is_free = len(Z) == Z.shape[1]  # no coordinate is fixed: Z is the identity matrix
    terms = {letter: term if is_free else term @ Z for letter, term in of_theta.items()}
    if dZ is not None:
        terms |= {letter: terms.get(letter, 0.0) + (1 + (letter in "MDK")) * (A @ dZ) for letter, A in matrices.items()}
    for letter in () if is_free else "MDK":
        product = Z.T @ terms[letter]
        terms[letter] = (product + product.transpose(0, 2, 1)) / 2
    terms = {letter: frozen(term) for letter, term in terms.items()}  # of which slopes are slices, not copies
    enters = {letter: np.any(term, axis=(1, 2)) for letter, term in terms.items()}
    return {
        name: Slope(**slopes)
        for p, name in enumerate(model.parameters)
        if name in names and (slopes := {letter: term[p] for letter, term in terms.items() if enters[letter][p]})
    }
