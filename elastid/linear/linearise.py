r"""ElasticModel about a configuration -> LinearModel, with exact derivatives to every parameter.

.. math:: M(q_0)\, \delta\ddot q + D\, \delta\dot q + K \delta q = B\, \delta u, \qquad
          K = \partial^2 (V + \lambda_0^T \varphi) / \partial q^2

Springs, gravity and, with multipliers, the geometric stiffness come from one Hessian. Coriolis terms are quadratic in
the velocities and leave nothing. The operating point moves with the parameters,

.. math:: \frac{dK}{d\theta} = \frac{\partial K}{\partial \theta} + \frac{\partial K}{\partial q} \frac{dq_0}{d\theta}

and so for M, C (`operating_point_slopes`). Where all springs are linear the second term is left out: it is a thousandth
of the first and would give each stiffness as many rank-one terms as there are coordinates. So it is where multipliers
close loops; the minimal formulation, with rods cut, follows. Where coordinates of the geometry are parameters nothing
is left out.

Constraints are eliminated by the motions Z that they allow at the operating point, dq = Z y: Z^T (.) Z of each matrix
and slope, Z^T B and C Z. No later stage sees a constraint.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass
from functools import cache, cached_property, lru_cache

import casadi as ca
import numpy as np

from elastid.base.arrays import FloatArray, IntArray
from elastid.base.errors import check_theta
from elastid.linear.equilibrium import equilibrium
from elastid.linear.linear_model import DELAY, LinearModel, Slope, elements
from elastid.linear.operating_point_slopes import PointDerivatives, differentiate_point, total
from elastid.model.elastic import ElasticModel
from elastid.model.formulation import EXACT, formulate
from elastid.model.loop_closure import motions
from elastid.model.spec import ModelSpec
from elastid.record import Configuration, Motion
from elastid.robot import Robot


@dataclass(frozen=True, eq=False)
class Linearisation:
    """A model with its derivatives to theta, built once and evaluated at each configuration.

    matrices(q, lambda_, theta) -> lower triangles of M, D, K side by side (n_q (n_q + 1) / 2, 3), and their Jacobian to
    theta, (3 n_q (n_q + 1) / 2, n_theta), sparse.  point: None where the operating point is held.
    """

    model: ElasticModel
    matrices: ca.Function
    point: PointDerivatives | None

    @property
    def follows(self) -> bool:
        """True if the derivatives follow the operating point, which moves with the parameters."""
        return self.point is not None

    @cached_property
    def without_slopes(self) -> Linearisation:
        """The same without derivatives, in a fraction of the time."""
        q, lambda_, theta = self.matrices.sx_in()
        triangles, slopes = self.matrices(q, lambda_, theta)
        return Linearisation(
            self.model, ca.Function("matrices", [q, lambda_, theta], [triangles, ca.SX(*slopes.shape)]), None
        )

    def is_affine_in(self, names: Collection[str]) -> bool:
        """True if M, D, K about a held operating point are affine in these parameters together, as in m but not m c."""
        model = self.model
        theta = [ca.SX.sym(name) for name in model.parameters]
        q, lambda_ = ca.SX.sym("q", model.n_q), ca.SX.sym("lambda", model.n_c)
        triangles = self.matrices(q, lambda_, ca.vertcat(*theta))[0]
        moved = [symbol for name, symbol in zip(model.parameters, theta, strict=True) if name in names]
        return not moved or not any(ca.which_depends(ca.vec(triangles), ca.vertcat(*moved), 2))

    @classmethod
    def of(cls, model: ElasticModel, follows: bool = False) -> Linearisation:
        """Differentiate a model; follows: the operating point, too, even where all springs are linear."""
        q, theta = ca.SX.sym("q", model.n_q), ca.SX.sym("theta", len(model.parameters))
        lambda_ = ca.SX.sym("lambda", model.n_c)
        rows, columns = np.tril_indices(model.n_q)
        lower = (columns * model.n_q + rows).tolist()  # CasADi counts column by column
        matrices = (model.mass(q, theta), model.damping(q, theta), model.stiffness(q, lambda_, theta))
        triangles = ca.horzcat(*(ca.densify(matrix)[lower] for matrix in matrices))
        slopes = ca.jacobian(ca.vec(triangles), theta)
        moves = _moves_with_parameters(model) or (follows and model.n_c == 0)
        point = differentiate_point(model, triangles, q, lambda_, theta) if moves else None
        return cls(model, ca.Function("matrices", [q, lambda_, theta], [triangles, slopes]), point)

    @classmethod
    def of_robot(cls, robot: Robot, spec: ModelSpec = EXACT, geometry: Collection[str] = ()) -> Linearisation:
        """A robot's equations, differentiated, built once in a process; arguments and errors as `formulate`."""
        return _linearised(robot, spec, tuple(name for name in robot.on_demand if name in geometry))

    def at(
        self, configuration: Configuration, theta: FloatArray, outputs: Sequence[str], quantity: Motion
    ) -> LinearModel:
        """The LinearModel about the equilibrium of a configuration; arguments and errors as `linearise`."""
        model = self.model
        check_theta(theta, model.parameters)
        point = equilibrium(model, theta, configuration)
        triangles, jacobian = self.matrices(point.q, point.lambda_, theta)
        M, D, K = (column[_places(model.n_q)] for column in triangles.full().T)
        # With its zeros; the numbers of a sparse one alone leave CasADi sooner.
        slopes = np.zeros(jacobian.shape)
        slopes[self._entries] = jacobian.nonzeros()
        Z = motions(model, model.constraint_jacobian(point.q, theta).full())
        C, T = model.output_jacobian(point.q, outputs, theta), model.gravity_jacobian(point.q, outputs)
        if self.point is None:
            of_name = _slopes(model, slopes, Z)
        else:
            moved = self.point.at(point, theta, K, Z, tuple(outputs))
            held = _slopes(model, slopes + moved.triangles, Z)
            of_name = total(held, moved, {"M": M, "D": D, "K": K, "C": C, "T": T}, Z)
        return LinearModel(
            configuration=configuration,
            parameters=(*model.parameters, DELAY),
            theta_ref=np.append(theta, 0.0),
            M=_projected(Z, M),
            D=_projected(Z, D),
            K=_projected(Z, K),
            slopes=of_name,
            B=Z.T @ model.B,
            C=C @ Z,
            inputs=model.inputs,
            outputs=tuple(outputs),
            quantity=quantity,
            chain=elements(model.robot.chain),
            T=T @ Z,
            Z=Z,
            gains=tuple(name for name in model.parameters if name in model.robot.gains),
            sliding=model.robot.sliding((*model.inputs, *outputs)),
        )

    @cached_property
    def _entries(self) -> tuple[IntArray, IntArray]:
        """Rows and columns of the Jacobian that are not zero for every theta."""
        rows, columns = self.matrices.sparsity_out(1).get_triplet()
        return np.array(rows, np.int64), np.array(columns, np.int64)


def _moves_with_parameters(model: ElasticModel) -> bool:
    """True if the geometry is among the parameters, a tangent depends on deflection, or springs are in series."""
    robot = model.robot
    bent = any(joint.spring is not None and not joint.spring.is_linear for joint in robot.joints)
    return bool(model.geometry) or (model.n_c == 0 and (bent or any(box.is_in_series for box in robot.gearboxes)))


@lru_cache(maxsize=4)
def _linearised(robot: Robot, spec: ModelSpec, geometry: tuple[str, ...]) -> Linearisation:
    return Linearisation.of(formulate(robot, spec, geometry))


def linearise(
    model: ElasticModel, configuration: Configuration, theta: FloatArray, outputs: Sequence[str], quantity: Motion
) -> LinearModel:
    """The LinearModel of one configuration; for several, build `Linearisation.of(model)` once.

    theta (n_theta,): model.parameters in SI, without the delay, which LinearModel adds at the end.
    outputs: places such as `motor 1`, `joint 1`, `body arm z`, `frame tool x`.  quantity: measured there.
    ValueError where theta is not one number for each parameter, UnknownNameError for an unknown quantity,
    StudyError where the configuration has no equilibrium, a place is unknown or a coordinate has no inertia.
    """
    return Linearisation.of(model).at(configuration, theta, outputs, quantity)


@cache
def _places(n: int) -> IntArray:
    """Places of the entries of a symmetric (n, n) among those of its lower triangle."""
    places = np.zeros((n, n), np.int64)
    rows, columns = np.tril_indices(n)
    places[rows, columns] = places[columns, rows] = np.arange(rows.size)
    return places


def _projected(Z: FloatArray, matrix: FloatArray) -> FloatArray:
    """Z^T matrix Z, symmetric to the last bit."""
    if len(Z) == Z.shape[1]:
        return matrix  # no constraint: Z is the unit matrix
    product = Z.T @ matrix @ Z
    return (product + product.T) / 2


def _slopes(model: ElasticModel, jacobian: FloatArray, Z: FloatArray) -> dict[str, Slope]:
    """Slopes by name of the parameters that enter; jacobian (3 n (n + 1) / 2, n_theta)."""
    triangles, places = jacobian.T.reshape(len(model.parameters), 3, -1), _places(model.n_q)
    enters = np.any(triangles, axis=2)
    slopes = {}
    for p in np.flatnonzero(np.any(enters, axis=1)):
        parts = zip(triangles[p], enters[p], strict=True)
        slopes[model.parameters[p]] = Slope(*(_projected(Z, part[places]) if moves else None for part, moves in parts))
    return slopes
