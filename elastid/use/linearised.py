r"""The fitted robot about many postures at once: matrices of what can move, and their slopes to the parameters.

Serial robots, and loops of elastic rods, with linear springs: one CasADi function of q with the fitted numbers folded
in, Newton's method for all postures side by side; slopes about the equilibrium as it is. All others, and loops whose
lengths are uncertain: `Family.at`, posture by posture.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import casadi as ca
import numpy as np

from elastid.base.arrays import BoolArray, FloatArray, IntArray
from elastid.base.errors import StudyError
from elastid.fit.posture import Family
from elastid.linear.equilibrium import LIMITS, equilibrium, free_coordinates
from elastid.linear.fitted_model import known_axes
from elastid.linear.linear_model import Slope
from elastid.linear.posture_model import PostureModel
from elastid.model.closed_posture import are_closed, followed
from elastid.model.kinematics import frame_poses
from elastid.record import Configuration
from elastid.robot import FRAME_AXES

CHUNK = 128  # postures at a time, so that their slopes stay in the cache


@dataclass(frozen=True, eq=False)
class Linearised:
    """P postures with an equilibrium: matrices (P, n, n), J (P, 6, n) of the frame in the axes of the base.

    slopes: dM, dD, dK (P, n_k, n, n) and dJ (P, n_k, 6, n) to the n_k numbers that x moves.  of_x (n_k, n_d): these per
    standard deviation of x along each independent direction.  found (P_asked,): which postures have an equilibrium.
    position (P, 3): of the frame.  strain_c (P, n_s), strain_b (P, n_s, n): energy of the springs.
    """

    M: FloatArray
    D: FloatArray
    K: FloatArray
    J: FloatArray
    dM: FloatArray
    dD: FloatArray
    dK: FloatArray
    dJ: FloatArray
    of_x: FloatArray
    found: BoolArray
    position: FloatArray
    strain_c: FloatArray
    strain_b: FloatArray


@dataclass(frozen=True, eq=False)
class ManyPostures:
    """A family about any number of postures, of motors that are held."""

    family: Family

    def at(self, angles: FloatArray) -> Iterator[Linearised]:
        """Linearisations of angles (P, n_u), in pieces of at most CHUNK postures; no matrices where none is found."""
        for first in range(0, len(angles), CHUNK):
            piece = angles[first : first + CHUNK]
            yield self._serial(piece) if self.is_serial else self._each(piece)

    @property
    def is_serial(self) -> bool:
        """True where one function serves all postures: the equilibrium moves little with the parameters."""
        robot, names = self.family.robot, self.family.estimated.names
        if robot.loops and any(names[row] in robot.geometry for row in self._moved[0]):
            return False  # a length moves the joints that the loops carry along
        linear = all(joint.spring is None or joint.spring.is_linear for joint in robot.joints)
        return self.family.model.n_c == 0 and linear and not any(box.is_in_series for box in robot.gearboxes)

    @cached_property
    def _moved(self) -> tuple[Any, FloatArray]:
        """Rows of theta that x moves, and of_x (n_k, n_d)."""
        known = self.family.estimated
        moves = np.any(known.slopes, axis=1)
        return np.flatnonzero(moves), known.slopes[moves] @ known_axes(known.covariance).T

    @cached_property
    def _functions(self) -> tuple[ca.Function, ca.Function]:
        """q -> gradient and Hessian of the potential; and all matrices with slopes to the numbers that x moves."""
        model, rows = self.family.model, self._moved[0]
        carries = self.family.asked.payload is not False
        numbers = model.carried(self.family.theta, carries)
        q = ca.SX.sym("q", model.n_q)
        rows = [row for row in rows if row < len(numbers)]
        symbols = ca.SX.sym("p", len(rows))
        theta = ca.SX(ca.DM(numbers))
        for place, row in enumerate(rows):
            absent = not carries and model.parameters[row] in model.of_payload
            theta[int(row)] = 0.0 if absent else symbols[place]
        K = model.stiffness(q, ca.SX(0, 1), theta)
        J = ca.densify(model.frame_velocity(q, theta))[self._frame_rows, :]
        matrices = ca.vertcat(*map(ca.vec, (model.mass(q, theta), model.damping(q, theta), K, J)))
        outputs = [matrices, ca.jacobian(matrices, symbols), *model.strain(q, theta)]
        here = ca.DM(numbers[rows])

        def at_estimate(name: str, parts: Sequence[ca.SX]) -> ca.Function:
            known = (ca.vec(ca.densify(ca.substitute(part, symbols, here))) for part in parts)
            return ca.Function(name, [q], [*known], {"cse": True})

        balance = at_estimate("balance", (model.potential_gradient(q, theta), K))
        return balance, at_estimate("linearised", outputs)

    @property
    def _frame_rows(self) -> list[int]:
        names = [frame.name for frame in self.family.robot.frames]
        first = len(FRAME_AXES) * names.index(self.family.frame)
        return list(range(first, first + len(FRAME_AXES)))

    def _serial(self, angles: FloatArray) -> Linearised:
        model, (balance, linearised) = self.family.model, self._functions
        free, n = free_coordinates(model), model.n_q
        if not free.size:
            self.family.at(Configuration("posture", angles[0]))  # which says why
        robot = model.robot_at(self.family.theta)
        rigid = followed(robot, angles)
        q = np.zeros((len(angles), model.n_q))
        q[:, : rigid.shape[1]] = rigid
        for motor, column in zip(model.inputs, angles.T, strict=True):
            q[:, model.index(motor)] = column
        open_ = np.arange(len(q))
        for _ in range(LIMITS.steps):
            gradient, K = _mapped(balance, q[open_])
            step = -np.linalg.solve(K.reshape(-1, n, n)[:, free[:, None], free], gradient[:, free, None])[:, :, 0]
            largest = np.abs(step).max(axis=1, initial=0.0)
            q[np.ix_(open_, free)] += step * np.minimum(1.0, LIMITS.step / np.maximum(largest, 1e-300))[:, None]
            open_ = open_[largest > 1e-9]  # convergence is quadratic: the next step is below rounding
            if not open_.size:
                break
        stacked, slopes, c, b = _mapped(linearised, q)
        slopes = slopes.reshape(len(q), -1, stacked.shape[1])
        M, D, K, J = (part[:, 0] for part in self._matrices(stacked[:, None], free))
        dM, dD, dK, dJ = self._matrices(slopes, free)
        stable = np.linalg.eigvalsh(K)[:, 0] > 0
        deflected = np.abs(q[:, : rigid.shape[1]] - rigid).max(axis=1)
        found = stable & ~np.isin(np.arange(len(q)), open_) & (deflected < LIMITS.deflection) & are_closed(robot, rigid)
        position, turned = self._poses(q)
        J, dJ = turned @ J, turned[:, None] @ dJ
        of_x = self._moved[1][: slopes.shape[1]]
        b = b.reshape(len(q), n, -1).transpose(0, 2, 1)[:, :, free]
        M, D, K, J, dM, dD, dK, dJ = (array[found] for array in (M, D, K, J, dM, dD, dK, dJ))
        return Linearised(M, D, K, J, dM, dD, dK, dJ, of_x, found, position[found], c[found], b[found])

    def _matrices(self, stacked: FloatArray, free: IntArray) -> list[FloatArray]:
        """M, D, K (P, k, n, n) and J (P, k, 6, n) of what can move, from the columns (P, k, ...) of all."""
        n = self.family.model.n_q
        parts = np.split(stacked, [n * n, 2 * n * n, 3 * n * n], axis=2)
        square = [part.reshape(*stacked.shape[:2], n, n)[:, :, free[:, None], free] for part in parts[:3]]
        return [*square, parts[3].reshape(*stacked.shape[:2], n, 6).swapaxes(2, 3)[..., free]]

    def _poses(self, q: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Position (P, 3) of the frame at q (P, n_q), and turns (P, 6, 6) from its own axes to those of the base."""
        family = self.family
        poses = frame_poses(family.model.robot_at(family.theta), q[:, : len(family.robot.joints)], family.frame)
        return poses.position, np.asarray(np.kron(np.eye(2), poses.rotation), float)

    def _each(self, angles: FloatArray) -> Linearised:
        """Posture by posture, where loops close or tangents follow the load."""
        family, found = self.family, np.zeros(len(angles), bool)
        kept: list[tuple[FloatArray, ...]] = []
        for i, own in enumerate(angles):
            configuration = Configuration("posture", own, family.asked.payload is not False)
            try:
                model = family.at(configuration)
                point = equilibrium(family.model, family.theta, configuration)
            except StudyError:
                continue
            found[i] = True
            (place,), (R,) = self._poses(point.q[None])
            c, b = (part.full() for part in family.model.strain(point.q, family.theta))
            A = model.matrices(family.estimated.x)
            slopes = [*self._slopes(model)]
            moves = np.asarray(model.linear.Z) @ model.moving
            matrices = A.M, A.D, A.K, R @ A.J, *slopes[:3], R @ slopes[3]
            kept.append((*matrices, place, c[:, 0], b @ moves))
        stacked = zip(*kept, strict=True) if kept else [()] * 11
        M, D, K, J, dM, dD, dK, dJ, position, c, b = (np.array(part) for part in stacked)
        return Linearised(M, D, K, J, dM, dD, dK, dJ, self._moved[1], found, position, c, b)

    def _slopes(self, model: PostureModel) -> Iterator[FloatArray]:
        """dM, dD, dK (n_k, n, n) and dJ (n_k, 6, n), own axes, of a model."""
        linear, N = model.linear, model.moving
        slopes = [linear.slopes.get(linear.parameters[row], Slope()) for row in self._moved[0]]
        none, no_place = np.zeros((linear.n, linear.n)), np.zeros_like(linear.C)
        for letter in "MDK":
            parts = [getattr(slope, letter) for slope in slopes]
            yield np.array([N.T @ (none if part is None else part) @ N for part in parts])
        yield np.array([model.ports.at_frame @ (no_place if s.C is None else s.C) @ N for s in slopes])


def _mapped(function: ca.Function, q: FloatArray) -> list[FloatArray]:
    """Outputs (P, size) of q (P, n)."""
    outputs = function.map(len(q))(q.T)
    return [each.full().T for each in (outputs if isinstance(outputs, tuple) else (outputs,))]
