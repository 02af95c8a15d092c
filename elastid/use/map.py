r"""A map of the workspace: compliance, frequencies, chatter and deflection of many postures, with their intervals.

.. math:: C = J K^{-1} J^T, \qquad
          G(j\omega) = \sum_k \frac{J \phi_k\, \psi_k^T J^T}{j\omega - \lambda_k}, \qquad
          a_{lim} = \frac{-1}{2 K_t \min_\omega \mathrm{Re}\, G_{nf}}

G in modal form, one eigenvalue problem a posture for all lines; the lines of each posture include the peak and the most
negative real part of each mode. G_nf = n^T G f: motion along the normal n of the cut by a force along f; without
directions the worst of all, n = f the eigenvector of the smallest eigenvalue of Re G (Altintas, Manufacturing
Automation, 2nd ed., 2012, eq. 4.20). Standard deviations are of first order,

.. math:: dC = dJ\, K^{-1} J^T + (.)^T - J K^{-1} dK K^{-1} J^T, \quad
          dG = -X^T (s^2 dM + s\, dD + dK) X + \dots, \quad X = Z^{-1} J^T

at the line of the extremum, which moves in second order.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from elastid.base.arrays import BoolArray, ComplexArray, FloatArray, IntArray, frozen_value, labelled
from elastid.base.errors import StudyError
from elastid.base.statistics import QUANTILE_95
from elastid.fit.posture import Asked, Family
from elastid.fit.result import Result
from elastid.linear.equilibrium import equilibrium
from elastid.linear.fitted_model import known_axes
from elastid.linear.linear_model import Slope
from elastid.model.kinematics import frame_poses
from elastid.record import Configuration

CHUNK = 128  # postures at a time, so that their slopes stay in the cache


@dataclass(frozen=True)
class Cut:
    """Load (3,) on the tool in N, cutting coefficient K_t in N/m^2, directions (3,) in the base's axes or None.

    normal: of the cut surface, along which the chip gets thicker.  force: along which the cutting force acts.
    """

    load: tuple[float, float, float] = (0.0, 0.0, -100.0)
    cutting_coefficient: float = 700e6
    normal: tuple[float, float, float] | None = None
    force: tuple[float, float, float] | None = None

    def __post_init__(self) -> None:
        if not np.all(np.isfinite(self.load)):
            raise ValueError(f"the load {self.load} N is not finite; give three numbers, the force on the frame")
        if not self.cutting_coefficient > 0:
            raise ValueError(f"cutting coefficient {self.cutting_coefficient:g} N/m^2; it must be positive")
        for name in ("normal", "force"):
            if getattr(self, name) is not None and not np.any(getattr(self, name)):
                raise ValueError(f"{name} is the zero vector; give a direction in the axes of the base")

    @property
    def directions(self) -> tuple[FloatArray, FloatArray] | None:
        """n and f (3,) of unit length; the force acts along the normal unless it is given."""
        if self.normal is None:
            return None
        n, f = np.array(self.normal, float), np.array(self.force or self.normal, float)
        return n / np.linalg.norm(n), f / np.linalg.norm(f)


# Quantities of a posture: unit and meaning.
QUANTITIES: dict[str, tuple[str, str]] = {
    "softest_compliance": ("m/N", "static compliance in the softest direction"),
    "compliance_x": ("m/N", "static compliance along x of the base"),
    "compliance_y": ("m/N", "static compliance along y of the base"),
    "compliance_z": ("m/N", "static compliance along z of the base"),
    "deflection": ("m", "deflection of the frame under the load"),
    "frequency_1": ("Hz", "first natural frequency"),
    "frequency_2": ("Hz", "second natural frequency"),
    "frequency_3": ("Hz", "third natural frequency"),
    "dynamic_compliance": ("m/N", "largest dynamic compliance, of any direction and line"),
    "depth_of_cut": ("m", "limiting depth of cut; infinite where nothing chatters"),
}


@dataclass(frozen=True, eq=False)
class Linearised:
    """P postures with an equilibrium: matrices (P, n, n), J (P, 3, n) of the frame's origin in the axes of the base.

    slopes: dM, dD, dK (P, n_k, n, n) and dJ (P, n_k, 3, n) to the n_k numbers that x moves.  of_x (n_k, n_d): these per
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
    strain_c: FloatArray
    strain_b: FloatArray
    position: FloatArray
    of_x: FloatArray
    found: BoolArray

    @cached_property
    def _modal(self) -> tuple[ComplexArray, ComplexArray, ComplexArray, ComplexArray]:
        """Poles (P, 2n) in 1/s, shapes (P, n, 2n), how forces act on them (P, 2n, 3), and residues (P, 2n, 9) of G.

        By the eigenvectors of the state matrix; G = C V (s - Lambda)^-1 V^-1 B.
        """
        P, n = self.M.shape[:2]
        J, inverse = self.J, np.linalg.inv(self.M)
        A = np.zeros((P, 2 * n, 2 * n))
        A[:, :n, n:] = np.eye(n)
        A[:, n:, :n], A[:, n:, n:] = -inverse @ self.K, -inverse @ self.D
        poles, V = np.linalg.eig(A)
        poles, V = poles.astype(complex), V.astype(complex)
        B = np.concatenate([np.zeros((P, n, 3)), inverse @ J.transpose(0, 2, 1)], axis=1)
        acting = np.linalg.solve(V, B.astype(complex))
        seen = J @ V[:, :n]
        residues = (seen.transpose(0, 2, 1)[:, :, :, None] * acting[:, :, None, :]).reshape(P, 2 * n, 9)
        return poles, V[:, :n], acting, residues

    def frequency(self, i: int) -> tuple[FloatArray, FloatArray]:
        """Natural frequency (P,) of the i-th oscillating mode in Hz, and its standard deviation; NaN without one."""
        poles, shapes = self._modal[:2]
        size = np.where(poles.imag > 1e-6 * np.abs(poles), np.abs(poles), np.inf)
        if i >= size.shape[1]:
            return np.full(len(size), np.nan), np.full(len(size), np.nan)
        row, place = np.arange(len(size)), np.argsort(size, axis=1)[:, i]
        omega, s, shape = size[row, place], poles[row, place][:, None], shapes[row, :, place]
        norm = _form((2 * s[..., None] * self.M + self.D)[:, None], shape, shape)
        change = s**2 * _form(self.dM, shape, shape) + s * _form(self.dD, shape, shape)
        with np.errstate(invalid="ignore", divide="ignore"):
            moved = -(change + _form(self.dK, shape, shape)) / norm
            slope = (s.conj() * moved).real / np.abs(s) / (2 * np.pi)
            freq_hz = np.where(np.isfinite(omega), omega, np.nan) / (2 * np.pi)
            return freq_hz, np.linalg.norm(slope @ self.of_x, axis=1)

    def lines(self, lines_hz: FloatArray) -> FloatArray:
        """(P, F + 2n): the lines, and of each mode where it peaks and where its real part is most negative."""
        poles = self._modal[0]
        size = np.abs(poles)
        zeta = np.clip(-poles.real / np.maximum(size, 1e-300), 0.0, 1.0)
        natural = np.where(poles.imag > 0, size, 2 * np.pi * lines_hz[0]) / (2 * np.pi)
        extremes = np.concatenate(
            [natural * np.sqrt(np.maximum(1 - 2 * zeta**2, 1e-4)), natural * np.sqrt(1 + 2 * zeta)], axis=1
        )
        inside = np.clip(extremes, lines_hz[0], lines_hz[-1])
        return np.concatenate([np.broadcast_to(lines_hz, (len(inside), len(lines_hz))), inside], axis=1)

    def response(self, lines_hz: FloatArray) -> ComplexArray:
        """G (P, F, 3, 3) of postures on lines (P, F); solved directly where the modal form has lost digits."""
        s, (poles, *_, residues) = 2j * np.pi * lines_hz, self._modal
        G = np.asarray(((1 / (s[:, :, None] - poles[:, None])) @ residues).reshape(*s.shape, 3, 3))
        check = np.argmax(np.abs(G[:, :, 0, 0]), axis=1)
        row = np.arange(len(G))
        exact = self.solved(lines_hz[row, check])[1]
        lost = np.abs(exact - G[row, check]).max(axis=(1, 2)) > 1e-6 * np.abs(exact).max(axis=(1, 2))
        for p in np.flatnonzero(lost):
            Z = s[p, :, None, None] ** 2 * self.M[p] + s[p, :, None, None] * self.D[p] + self.K[p]
            J = self.J[p]
            G[p] = J @ np.linalg.solve(Z, np.broadcast_to(J.T.astype(complex), (len(Z), *J.T.shape)))
        return G

    def along(self, freq_hz: FloatArray, a: FloatArray) -> tuple[FloatArray, FloatArray]:
        """|a^T G a| (P, L) and its standard deviation, a (P, 3)."""
        s = np.broadcast_to(2j * np.pi * freq_hz, (len(a), len(freq_hz)))
        poles, shapes, acting, _ = self._modal
        along = np.einsum("pka,pa->pk", acting, a)
        u = (along[:, None] / (s[:, :, None] - poles[:, None])) @ shapes.transpose(0, 2, 1)
        pull = np.einsum("pa,pan->pn", a, self.J)
        G = np.einsum("pfn,pn->pf", u, pull)
        P, L, n = u.shape
        outer = np.ascontiguousarray((u[:, :, :, None] * u[:, :, None, :]).reshape(P, L, n * n).transpose(0, 2, 1))
        # Real matrices times real and imaginary parts beside one another.
        products = (part.reshape(P, -1, n * n) @ outer.view(float) for part in (self.dM, self.dD, self.dK))
        M, D, K = (product.view(complex) for product in products)
        turned = np.einsum("pkan,pa->pkn", self.dJ, a) @ u.transpose(0, 2, 1)
        slope = 2 * turned - (s[:, None] ** 2 * M + s[:, None] * D + K)
        size = np.maximum(np.abs(G), 1e-300)
        moved = (G.conj()[:, None] * slope).real / size[:, None]
        return size, np.linalg.norm(moved.transpose(0, 2, 1) @ self.of_x, axis=2)

    def solved(self, freq_hz: FloatArray) -> tuple[ComplexArray, ComplexArray]:
        """X = Z^-1 J^T (P, n, 3) and G (P, 3, 3), at one line (P,) of each posture, 0 for rest."""
        s = 2j * np.pi * freq_hz[:, None, None]
        J = self.J
        X = np.linalg.solve(s**2 * self.M + s * self.D + self.K, J.transpose(0, 2, 1).astype(complex))
        return np.asarray(X), np.asarray(J @ X)

    def std(self, freq_hz: FloatArray, a: ComplexArray | FloatArray, b: ComplexArray | FloatArray) -> FloatArray:
        """Std of Re a^T G b (P,) at one line (P,), a and b (P, 3)."""
        X, k = self.solved(freq_hz)[0], 2j * np.pi * freq_hz[:, None]
        u, v = ((X @ each[:, :, None])[:, :, 0] for each in (a, b))
        slope = -(k**2 * _form(self.dM, u, v) + k * _form(self.dD, u, v) + _form(self.dK, u, v))
        slope += _form(self.dJ, a, v) + _form(self.dJ, b, u)
        return np.asarray(np.linalg.norm(slope.real @ self.of_x, axis=1))


def linearised(family: Family, angles: FloatArray) -> Iterator[Linearised]:
    """Linearisations of a family about angles (P, n_u), in pieces of at most CHUNK postures."""
    for first in range(0, len(angles), CHUNK):
        yield _about(family, angles[first : first + CHUNK])


def _about(family: Family, angles: FloatArray) -> Linearised:
    """Linearisations; no matrices where no posture has an equilibrium."""
    known, found, seat = family.estimated, np.zeros(len(angles), bool), slice(-6, -3)
    rows: list[list[FloatArray]] = [[] for _ in range(10)]
    q = []
    for i, own in enumerate(angles):
        configuration = Configuration("posture", own, family.asked.payload is not False)
        try:
            linear = family.at(configuration).whole
            point = equilibrium(family.model, family.theta, configuration)
        except StudyError:
            continue
        found[i] = True
        q.append(point.q[: len(family.robot.joints)])
        slopes = [linear.slopes.get(known.names[row], Slope()) for row in known.moved]
        matrices = (linear.M, linear.D, linear.K, linear.C[seat])
        parts = ((s.M, s.D, s.K, None if s.C is None else s.C[seat]) for s in slopes)
        of_theta = (
            np.array([np.zeros_like(matrix) if each is None else each for each in own])
            for matrix, *own in zip(matrices, *parts, strict=True)
        )
        c, b = (part.full() for part in family.model.strain(point.q, family.theta))
        for row, part in zip(rows, (*matrices, *of_theta, c[:, 0], b @ np.asarray(linear.Z)), strict=True):
            row.append(part)
    M, D, K, J, dM, dD, dK, dJ, strain_c, strain_b = map(np.array, rows)
    robot, of_x = family.model.robot_at(family.theta), known.slopes[known.moved] @ known_axes(known.covariance).T
    position = frame_poses(robot, np.array(q), family.frame).position if q else np.zeros((0, 3))
    return Linearised(M, D, K, J, dM, dD, dK, dJ, strain_c, strain_b, position, of_x, found)


def answers(robots: Linearised, lines_hz: FloatArray, curve_hz: FloatArray, cut: Cut) -> dict[str, FloatArray]:
    """Quantities (P, 2), values and standard deviations, on lines (F,), and fields of a map that belong to postures.

    axes (P, 3, 3), share (P, n_s), chatter_hz (P,), magnitude and magnitude_std (P, L) on the lines of a curve.
    """
    at_rest, row = np.zeros(len(robots.M)), np.arange(len(robots.M))
    flexibility, C = (part.real for part in robots.solved(at_rest))
    principal, axes = np.linalg.eigh((C + C.transpose(0, 2, 1)) / 2)
    principal, axes = principal[:, ::-1], axes[:, :, ::-1]
    softest = axes[:, :, 0]
    found = {"softest_compliance": (principal[:, 0], robots.std(at_rest, softest, softest))}
    for i, name in enumerate("xyz"):
        unit = np.broadcast_to(np.eye(3)[i], (len(C), 3))
        found[f"compliance_{name}"] = C[:, i, i], robots.std(at_rest, unit, unit)
    load = np.array(cut.load)
    moved = C @ load
    deflection = np.linalg.norm(moved, axis=1)
    along = moved / np.maximum(deflection, 1e-300)[:, None]
    found["deflection"] = deflection, robots.std(at_rest, along, np.broadcast_to(load, along.shape))
    found |= {f"frequency_{i + 1}": robots.frequency(i) for i in range(3)}
    lines = robots.lines(lines_hz)
    G = robots.response(lines)
    largest = largest_gain(G)
    peak = np.argmax(largest, axis=1)
    U, _, Vh = np.linalg.svd(G[row, peak])
    found["dynamic_compliance"] = largest[row, peak], robots.std(lines[row, peak], U[:, :, 0].conj(), Vh[:, 0].conj())
    directions = cut.directions
    real = (
        np.linalg.eigvalsh(G.real)[..., 0]
        if directions is None
        else G.real.reshape(*lines.shape, 9) @ np.outer(*directions).ravel()
    )
    worst = np.argmin(real, axis=1)
    chatter_hz, least = lines[row, worst], real[row, worst]
    if directions is None:
        n = f = np.linalg.eigh(G.real[row, worst])[1][:, :, 0]
    else:
        n, f = (np.broadcast_to(direction, (len(G), 3)) for direction in directions)
    with np.errstate(divide="ignore"):
        depth = np.where(least < 0, -1 / (2 * cut.cutting_coefficient * least), np.inf)
        size = np.where(least < 0, depth / -least, np.nan)
    found["depth_of_cut"] = depth, size * robots.std(chatter_hz, n, f)
    u = flexibility @ axes[:, :, :1]
    energy = robots.strain_c * (robots.strain_b @ u)[:, :, 0] ** 2
    magnitude, magnitude_std = robots.along(curve_hz, softest)
    return {name: np.stack(each, axis=1) for name, each in found.items()} | {
        "axes": axes, "share": energy / np.maximum(principal[:, :1], 1e-300), "chatter_hz": chatter_hz,
        "magnitude": magnitude, "magnitude_std": magnitude_std,
    }  # fmt: skip


def largest_gain(G: ComplexArray) -> FloatArray:
    """Largest singular value (...) of matrices (..., n, n)."""
    squares = np.linalg.eigvalsh(np.swapaxes(G, -1, -2).conj() @ G)[..., -1]
    return np.asarray(np.sqrt(np.maximum(squares, 0.0)))


def _form(matrices: Any, a: ComplexArray | FloatArray, b: ComplexArray | FloatArray) -> ComplexArray:
    """a^T A b (P, n_k) of matrices (P, n_k, m, n), a (P, m), b (P, n)."""
    P, n_k = matrices.shape[:2]
    outer = (a[:, :, None] * b[:, None, :]).reshape(P, -1, 1)
    return np.asarray((matrices.reshape(P, n_k, -1) @ outer)[:, :, 0])


LINES, CURVE_LINES = 300, 120


@frozen_value
class Quantity:
    """One number of every posture, SI, with its standard deviation and 95 % interval.

    A positive quantity has an interval that is symmetric in its logarithm.
    """

    name: str
    text: str
    unit: str
    value: FloatArray = labelled("value", "{unit}", "posture")
    std: FloatArray = labelled("standard deviation", "{unit}", "posture")

    @property
    def relative_std(self) -> FloatArray:
        """std over value (Q,)."""
        with np.errstate(invalid="ignore", divide="ignore"):
            return np.asarray(self.std / self.value)

    @property
    def interval(self) -> tuple[FloatArray, FloatArray]:
        """Ends (Q,) of the 95 % intervals."""
        with np.errstate(over="ignore", invalid="ignore"):
            reach = np.exp(QUANTILE_95 * self.relative_std)
            return np.asarray(self.value / reach), np.asarray(self.value * reach)


@frozen_value
class WorkspaceMap:
    """Quantities of Q postures with an equilibrium, the motors held, in the axes of the base.

    angles (Q, n_u): of the driven joints `joints`.  asked (Q,): number of each among the postures asked for; those
    without an equilibrium are `refused`.  sliding: of each joint, True where it slides.  position (Q, 3): of the frame.
    axes (Q, 3, 3): directions of the principal static compliances, columns, the softest first.  springs, share (Q,
    n_s): part of each spring in the compliance of the softest direction.
    curve_hz (L,): of `magnitude`.
    """

    name: str
    frame: str
    joints: tuple[str, ...]
    angles: FloatArray = labelled("angle of the driven joints", "rad, m", "posture joints")
    asked: IntArray = labelled("number of the posture among those asked for", "", "posture")
    refused: tuple[int, ...] = labelled("postures without an equilibrium")
    position: FloatArray = labelled("origin of the frame", "m", "posture axis")
    axes: FloatArray = labelled("directions of principal compliances, the softest first", "", "posture axis rank")
    springs: tuple[str, ...]
    share: FloatArray = labelled("part of each spring in the softest compliance", "", "posture springs")
    chatter_hz: FloatArray = labelled("line of the most negative real part", "", "posture")
    curve_hz: FloatArray = labelled("lines of the curves")
    magnitude: FloatArray = labelled("dynamic compliance along the softest direction", "m/N", "posture curve_hz")
    magnitude_std: FloatArray = labelled("its standard deviation", "m/N", "posture curve_hz")
    quantities: tuple[Quantity, ...] = labelled(entry="name")
    load: tuple[float, float, float] = (0.0, 0.0, 0.0)
    cutting_coefficient: float = 0.0
    is_path: bool = False
    sliding: tuple[bool, ...] = ()

    def __getitem__(self, name: str) -> Quantity:
        """A quantity by its name."""
        return {each.name: each for each in self.quantities}[name]

    def __len__(self) -> int:
        return len(self.angles)

    @property
    def softest(self) -> IntArray:
        """Numbers (Q,) of the postures, the softest first."""
        return np.argsort(-self["softest_compliance"].value, kind="stable")

    @property
    def limiting_springs(self) -> tuple[str, ...]:
        """The spring with the largest part in the softest direction of each posture."""
        return tuple(self.springs[i] for i in np.argmax(self.share, axis=1)) if self.springs else ("",) * len(self)


def map_workspace(
    fitted: Result | Family,
    angles: FloatArray,
    cut: Cut | None = None,
    *,
    frame: str | None = None,
    lines_hz: FloatArray | None = None,
    name: str = "",
    is_path: bool = False,
) -> WorkspaceMap:
    """The map of postures (Q, n_u) of a fitted robot; StudyError where none of them has an equilibrium.

    fitted: or its family in the axes of the base, built before.  frame: by default `tool`, else the last one.
    lines_hz (F,): by default LINES of them over the modes.
    """
    cut = cut or Cut()
    family = fitted if isinstance(fitted, Family) else fitted.family(Asked(frame=frame, axes="world"))
    lines = default_lines(family, angles) if lines_hz is None else np.asarray(lines_hz, float)
    curve = np.geomspace(lines[0], lines[-1], CURVE_LINES)
    pieces, of_pieces = [], []
    for robots in linearised(family, angles):
        of_pieces.append(robots.found)
        if robots.found.any():
            pieces.append(answers(robots, lines, curve, cut) | {"position": robots.position})
    found = np.concatenate(of_pieces)
    if not found.any():
        raise StudyError(
            "robot/no-rest",
            f"robot {family.robot.name} finds no rest in any of the {len(angles)} postures; they may be outside the "
            "reach of its loops, or its springs too soft for its weight",
        )
    each = {name: np.concatenate([piece[name] for piece in pieces]) for name in pieces[0]}
    quantities = tuple(Quantity(key, text, unit, *each.pop(key).T) for key, (unit, text) in QUANTITIES.items())
    driven = family.robot.driven
    return WorkspaceMap(
        name=name or family.robot.name, frame=family.frame, joints=tuple(joint.name for joint in driven),
        angles=angles[found], asked=np.flatnonzero(found), refused=tuple(np.flatnonzero(~found).tolist()),
        springs=family.model.springs, curve_hz=curve, quantities=quantities, load=cut.load,
        cutting_coefficient=cut.cutting_coefficient, is_path=is_path, sliding=tuple(joint.slides for joint in driven),
        **each,
    )  # fmt: skip


def default_lines(family: Family, angles: FloatArray) -> FloatArray:
    """LINES lines (F,) from half the first natural frequency of some postures to twice their sixth, or last."""
    some = next(linearised(family, angles[:: max(1, len(angles) // 20)][:20]))
    if not len(some.M):
        return np.geomspace(1.0, 100.0, LINES)
    squares = np.linalg.eigvals(np.linalg.solve(some.M, some.K)).real
    freq_hz = np.sort(np.sqrt(np.maximum(squares, 1e-6)), axis=1) / (2 * np.pi)
    return np.geomspace(freq_hz[:, 0].min() / 2, 2 * freq_hz[:, : min(6, freq_hz.shape[1])].max(), LINES)
