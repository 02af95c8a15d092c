r"""Slopes of the matrices at the operating point, which itself moves with the parameters.

.. math:: \begin{bmatrix} K_{ff} & \Phi_f^T \\ \Phi_f & 0 \end{bmatrix}
          \begin{bmatrix} dq_f \\ d\lambda \end{bmatrix} = - \frac{\partial}{\partial \theta}
          \begin{bmatrix} \partial V / \partial q_f + \Phi_f^T \lambda \\ \varphi \end{bmatrix} d\theta,
          \qquad \frac{dA}{d\theta} = \frac{\partial A}{\partial \theta}
          + \frac{\partial A}{\partial q_f} \frac{dq_f}{d\theta}
          + \frac{\partial A}{\partial \lambda} \frac{d\lambda}{d\theta}

f: the free coordinates, all but the motors', which are held. The motions that the loops allow turn with them,
Phi dZ = -dPhi Z; of all dZ that do, which differ by a change of the coordinates y, the one that leaves the motors'
rows of Z, and with them B, alone. So the derivatives are exact, whatever the parameter is.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import lru_cache

import casadi as ca
import numpy as np

from elastid.base.arrays import FloatArray
from elastid.base.errors import StudyError
from elastid.linear.equilibrium import OperatingPoint, free_coordinates
from elastid.linear.linear_model import Slope
from elastid.model.elastic import ElasticModel
from elastid.model.loop_closure import RANK_TOLERANCE, null_space


@dataclass(frozen=True, eq=False)
class PointSlopes:
    """triangles (3 n (n + 1) / 2, n_theta): added to the slopes of M, D, K by the point's motion.

    By name, for parameters that have any: Z (n_q, n) of the motions allowed, C and T (n_y, n_q) of the outputs.
    """

    triangles: FloatArray
    Z: Mapping[str, FloatArray] = field(default_factory=dict)
    C: Mapping[str, FloatArray] = field(default_factory=dict)
    T: Mapping[str, FloatArray] = field(default_factory=dict)


@dataclass(frozen=True, eq=False)
class PointDerivatives:
    """shift(q, lambda_, theta) -> the partial derivatives of the equation above, A the triangles of M, D, K, and Phi.

    of_theta: of statics (n_f, n_theta), phi (n_c, n_theta), vec Phi (n_c n_q, n_theta).  of_q: of A (.., n_f), vec Phi
    (n_c n_q, n_f).  of_lambda: of A (.., n_c).
    """

    model: ElasticModel
    of_theta: ca.Function
    of_q: ca.Function
    of_lambda: ca.Function

    def at(
        self, point: OperatingPoint, theta: FloatArray, K: FloatArray, Z: FloatArray, outputs: tuple[str, ...]
    ) -> PointSlopes:
        """The motion at an equilibrium, whose stiffness is K (n_q, n_q) and whose motions are Z (n_q, n).

        StudyError for a coordinate of the geometry with which no joint can keep the loops closed.
        """
        model, free, arguments = self.model, free_coordinates(self.model), (point.q, point.lambda_, theta)
        statics, phi, Phi_theta = (part.full() for part in self.of_theta(*arguments))
        A_q, Phi_q = (part.full() for part in self.of_q(*arguments))
        if not model.n_c:
            dq = -np.linalg.lstsq(K[np.ix_(free, free)], statics)[0]
            return PointSlopes(A_q @ dq, **_reading(model, point.q, theta, outputs, dq))
        Phi = model.constraint_jacobian(point.q, theta).full()
        inverse, Y = np.linalg.pinv(Phi[:, free], rcond=RANK_TOLERANCE), null_space(Phi[:, free])
        K_f = K[np.ix_(free, free)]
        back = -inverse @ phi
        # Every row of phi must be closed again by the joints, to 1e-6 of the gap that opens if none of them follows.
        opened = np.abs(Phi[:, free] @ back + phi).max(axis=0) > 1e-6 * np.abs(phi).max(initial=0.0)
        if opened.any():
            names = ", ".join(name for name, is_open in zip(model.parameters, opened, strict=True) if is_open)
            raise StudyError(
                f"{names}: no motion of the joints keeps the loops of robot {model.robot.name} closed when it changes "
                "(an offset out of the plane of a planar linkage, for one); leave it out of fit.parameters, or close "
                "that loop by a rod"
            )
        dq = back - Y @ np.linalg.lstsq(Y.T @ K_f @ Y, Y.T @ (statics + K_f @ back))[0]
        dlambda = -inverse.T @ (statics + K_f @ dq)
        turned = (Phi_theta + Phi_q @ dq).T.reshape(-1, model.n_q, model.n_c).transpose(0, 2, 1)
        motions = {}
        for name, dPhi in zip(model.parameters, turned, strict=True):
            if np.any(dPhi):
                motions[name] = np.zeros_like(Z)
                motions[name][free] = -inverse @ (dPhi @ Z)
        triangles = A_q @ dq + self.of_lambda(*arguments).full() @ dlambda
        return PointSlopes(triangles, motions, **_reading(model, point.q, theta, outputs, dq))


def differentiate_point(
    model: ElasticModel, triangles: ca.SX, q: ca.SX, lambda_: ca.SX, theta: ca.SX
) -> PointDerivatives:
    """Differentiate the equilibrium, and the triangles of M, D, K as expressions of q, lambda_ and theta."""
    free = free_coordinates(model).tolist()
    Phi, phi = model.constraint_jacobian(q, theta), model.constraint(q, theta)
    statics = model.potential_gradient(q, theta) + (Phi.T @ lambda_ if model.n_c else 0)
    arguments, stacked = [q, lambda_, theta], ca.vec(triangles)
    held = (statics[free], phi, ca.vec(Phi))
    return PointDerivatives(
        model,
        ca.Function("of_theta", arguments, [ca.jacobian(part, theta) for part in held]),
        ca.Function("of_q", arguments, [ca.jacobian(part, q)[:, free] for part in (stacked, ca.vec(Phi))]),
        ca.Function("of_lambda", arguments, [ca.jacobian(stacked, lambda_)]),
    )


def total(
    slopes: Mapping[str, Slope], moved: PointSlopes, matrices: Mapping[str, FloatArray], Z: FloatArray
) -> dict[str, Slope]:
    """Slopes of Z^T (M, D, K) Z, of C Z and T Z: those with Z, C and T held, plus those of their own motion.

    matrices: M, D, K (n_q, n_q) and C, T (n_y, n_q) in all coordinates.
    """
    totals = dict(slopes)
    for name in dict.fromkeys((*moved.Z, *moved.C, *moved.T)):
        dZ = moved.Z.get(name, np.zeros_like(Z))
        held = totals.get(name, Slope())
        turned = {letter: dZ.T @ matrices[letter] @ Z for letter in "MDK"}
        parts = {letter: _sum(getattr(held, letter), part + part.T) for letter, part in turned.items()}
        for letter, own in (("C", moved.C), ("T", moved.T)):
            parts[letter] = _sum(own[name] @ Z if name in own else None, matrices[letter] @ dZ)
        totals[name] = replace(held, **parts)
    return totals


def _sum(first: FloatArray | None, second: FloatArray) -> FloatArray | None:
    """None where both are zero."""
    if not np.any(second):
        return first
    return second if first is None else first + second


def _reading(
    model: ElasticModel, q: FloatArray, theta: FloatArray, outputs: tuple[str, ...], dq: FloatArray
) -> dict[str, dict[str, FloatArray]]:
    """Slopes of C and T (n_y, n_q) of the outputs, by name; those that are not zero."""
    if all(place.startswith(("motor ", "joint ")) for place in outputs):
        return {}
    C_q, C_theta, T_q, T_theta = (part.full() for part in _readout_slopes(model, outputs)(q, theta))
    return {
        letter: {
            name: column.reshape(model.n_q, len(outputs)).T
            for name, column in zip(model.parameters, slopes.T, strict=True)
            if np.any(column)
        }
        for letter, slopes in (("C", C_theta + C_q @ dq), ("T", T_theta + T_q @ dq))
    }


@lru_cache(maxsize=8)
def _readout_slopes(model: ElasticModel, outputs: tuple[str, ...]) -> ca.Function:
    """(q, theta) -> d vec C / dq_f, d vec C / d theta, and of T."""
    q, theta, free = ca.SX.sym("q", model.n_q), ca.SX.sym("theta", len(model.parameters)), free_coordinates(model)
    parts = [ca.vec(ca.densify(part)) for part in _readout(model, q, theta, outputs)]
    slopes = [s for part in parts for s in (ca.jacobian(part, q)[:, free.tolist()], ca.jacobian(part, theta))]
    return ca.Function("readout_slopes", [q, theta], slopes)


def _readout(model: ElasticModel, q: ca.SX, theta: ca.SX, locations: tuple[str, ...]) -> tuple[ca.SX, ca.SX]:
    """C and T (n_y, n_q) of `ElasticModel.output_jacobian` and `gravity_jacobian` at q (n_q,), as expressions."""
    rows = ca.vertsplit(ca.vertcat(model.angular_velocity(q), model.frame_velocity(q, theta)))
    rates = dict(zip(model.rates, rows, strict=True))
    names = [frame.name for frame in model.robot.frames]
    gravity = model.frame_gravity(q)
    C, T = [], []
    for place in locations:
        kind, _, rest = place.partition(" ")
        still = ca.SX(1, model.n_q)
        if kind in ("motor", "joint"):
            still[model.index(place)] = 1
            C.append(still)
            T.append(ca.SX(1, model.n_q))
            continue
        name, axis = rest.rsplit(" ", 1)
        C.append(rates["frame" if kind == "accelerometer" else kind, name, axis])
        if kind != "accelerometer":
            T.append(still)
            continue
        turning = ca.vertcat(*(rates["frame", name, f"r{letter}"] for letter in "xyz"))
        g = gravity[3 * names.index(name) : 3 * names.index(name) + 3]
        T.append(-(ca.skew(g) @ turning)["xyz".index(axis), :])
    return ca.vertcat(*C), ca.vertcat(*T)
