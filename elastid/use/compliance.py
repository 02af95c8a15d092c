r"""Compliance, frequencies, chatter and deflection of many postures, each with its standard deviation.

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

from dataclasses import dataclass
from typing import Any

import numpy as np

from elastid.base.arrays import ComplexArray, FloatArray
from elastid.use.linearised import Linearised


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
class Answers:
    """Answers of P postures: values and std (P,) by quantity, softest direction (P, 3), springs' shares (P, n_s).

    axes (P, 3, 3): directions of the principal compliances as columns, the softest first.
    chatter_hz (P,): line of the most negative real part.
    magnitude, magnitude_std (P, L): |a^T G a| along the softest direction on the lines of a curve.
    """

    values: dict[str, FloatArray]
    std: dict[str, FloatArray]
    axes: FloatArray
    shares: FloatArray
    chatter_hz: FloatArray
    magnitude: FloatArray
    magnitude_std: FloatArray


def answers(robots: Linearised, lines_hz: FloatArray, curve_hz: FloatArray, cut: Cut) -> Answers:
    """All quantities of postures (P,) on lines (F,), and a curve on lines (L,), in the axes of the base."""
    dynamic, at_rest = _Dynamic.of(robots), np.zeros(len(robots.M))
    flexibility, C = (part.real for part in dynamic.solved(at_rest))
    principal, axes = np.linalg.eigh((C + C.transpose(0, 2, 1)) / 2)
    principal, axes = principal[:, ::-1], axes[:, :, ::-1]
    values: dict[str, FloatArray] = {"softest_compliance": principal[:, 0]}
    std: dict[str, FloatArray] = {"softest_compliance": dynamic.std(at_rest, axes[:, :, 0], axes[:, :, 0])}
    for i, name in enumerate("xyz"):
        unit = np.broadcast_to(np.eye(3)[i], (len(C), 3))
        values[f"compliance_{name}"], std[f"compliance_{name}"] = C[:, i, i], dynamic.std(at_rest, unit, unit)
    load = np.array(cut.load)
    moved = C @ load
    values["deflection"] = np.linalg.norm(moved, axis=1)
    along = moved / np.maximum(values["deflection"], 1e-300)[:, None]
    std["deflection"] = dynamic.std(at_rest, along, np.broadcast_to(load, along.shape))
    for i in range(3):
        values[f"frequency_{i + 1}"], std[f"frequency_{i + 1}"] = dynamic.frequency(i)
    lines = dynamic.lines(lines_hz)
    G = dynamic.response(lines)
    largest = np.sqrt(np.maximum(np.linalg.eigvalsh(G.conj().swapaxes(-1, -2) @ G)[..., -1], 0.0))
    peak = np.argmax(largest, axis=1)
    row = np.arange(len(G))
    values["dynamic_compliance"], peak_hz = largest[row, peak], lines[row, peak]
    U, _, Vh = np.linalg.svd(G[row, peak])
    std["dynamic_compliance"] = dynamic.std(peak_hz, U[:, :, 0].conj(), Vh[:, 0].conj())
    directions = cut.directions
    real = np.linalg.eigvalsh(G.real)[..., 0] if directions is None else _along(G.real, *directions)
    worst = np.argmin(real, axis=1)
    chatter_hz, least = lines[row, worst], real[row, worst]
    if directions is None:
        n = f = np.linalg.eigh(G.real[row, worst])[1][:, :, 0]
    else:
        n, f = (np.broadcast_to(direction, (len(G), 3)) for direction in directions)
    with np.errstate(divide="ignore"):
        values["depth_of_cut"] = np.where(least < 0, -1 / (2 * cut.cutting_coefficient * least), np.inf)
        size = np.where(least < 0, values["depth_of_cut"] / -least, np.nan)
    std["depth_of_cut"] = size * dynamic.std(chatter_hz, n, f)
    u = flexibility @ axes[:, :, :1]
    energy = robots.strain_c * (robots.strain_b @ u)[:, :, 0] ** 2
    shares = energy / np.maximum(principal[:, :1], 1e-300)
    curve = dynamic.along(curve_hz, axes[:, :, 0])
    return Answers(values, std, axes, shares, chatter_hz, *curve)


@dataclass(frozen=True, eq=False)
class _Dynamic:
    """Poles (P, 2n) in 1/s, shapes (P, n, 2n), how forces act on them (P, 2n, 3), and residues (P, 2n, 9) of G."""

    robots: Linearised
    poles: ComplexArray
    shapes: ComplexArray
    acting: ComplexArray
    residues: ComplexArray

    @classmethod
    def of(cls, robots: Linearised) -> _Dynamic:
        """Dynamics by the eigenvectors of the state matrix; G = C V (s - Lambda)^-1 V^-1 B."""
        P, n = robots.M.shape[:2]
        J = robots.J[:, :3]
        inverse = np.linalg.inv(robots.M)
        A = np.zeros((P, 2 * n, 2 * n))
        A[:, :n, n:] = np.eye(n)
        A[:, n:, :n], A[:, n:, n:] = -inverse @ robots.K, -inverse @ robots.D
        poles, V = np.linalg.eig(A)
        poles, V = poles.astype(complex), V.astype(complex)
        B = np.concatenate([np.zeros((P, n, 3)), inverse @ J.transpose(0, 2, 1)], axis=1)
        acting = np.linalg.solve(V, B.astype(complex))
        seen = J @ V[:, :n]
        residues = (seen.transpose(0, 2, 1)[:, :, :, None] * acting[:, :, None, :]).reshape(P, 2 * n, 9)
        return cls(robots, poles, V[:, :n], acting, residues)

    def _of_mode(self, i: int) -> tuple[FloatArray, ComplexArray, ComplexArray]:
        """Natural frequency (P,) of the i-th oscillating mode, its pole and shape; NaN where there are fewer."""
        size = np.where(self.poles.imag > 1e-6 * np.abs(self.poles), np.abs(self.poles), np.inf)
        if i >= size.shape[1]:
            none = np.full(len(size), np.nan)
            return none, none.astype(complex), np.zeros(self.shapes.shape[:2], complex)
        place = np.argsort(size, axis=1)[:, i]
        row = np.arange(len(size))
        freq_hz = np.where(np.isfinite(size[row, place]), size[row, place], np.nan) / (2 * np.pi)
        return freq_hz, self.poles[row, place], self.shapes[row, :, place]

    def frequency(self, i: int) -> tuple[FloatArray, FloatArray]:
        """Natural frequency (P,) of the i-th oscillating mode in Hz, and its standard deviation."""
        robots = self.robots
        freq_hz, pole, shape = self._of_mode(i)
        s = pole[:, None]
        norm = _form((2 * s[..., None] * robots.M + robots.D)[:, None], shape, shape)
        change = s**2 * _form(robots.dM, shape, shape) + s * _form(robots.dD, shape, shape)
        with np.errstate(invalid="ignore", divide="ignore"):
            moved = -(change + _form(robots.dK, shape, shape)) / norm
            slope = (s.conj() * moved).real / np.abs(s) / (2 * np.pi)
            return freq_hz, np.linalg.norm(slope @ robots.of_x, axis=1)

    def lines(self, lines_hz: FloatArray) -> FloatArray:
        """(P, F + 2n): the lines, and of each mode where it peaks and where its real part is most negative."""
        size = np.abs(self.poles)
        zeta = np.clip(-self.poles.real / np.maximum(size, 1e-300), 0.0, 1.0)
        natural = np.where(self.poles.imag > 0, size, 2 * np.pi * lines_hz[0]) / (2 * np.pi)
        extremes = np.concatenate(
            [natural * np.sqrt(np.maximum(1 - 2 * zeta**2, 1e-4)), natural * np.sqrt(1 + 2 * zeta)], axis=1
        )
        inside = np.clip(extremes, lines_hz[0], lines_hz[-1])
        return np.concatenate([np.broadcast_to(lines_hz, (len(inside), len(lines_hz))), inside], axis=1)

    def response(self, lines_hz: FloatArray) -> ComplexArray:
        """G (P, F, 3, 3) of postures on lines (P, F); solved directly where the modal form has lost digits."""
        s = 2j * np.pi * lines_hz
        G = np.asarray(((1 / (s[:, :, None] - self.poles[:, None])) @ self.residues).reshape(*s.shape, 3, 3))
        check = np.argmax(np.abs(G[:, :, 0, 0]), axis=1)
        row = np.arange(len(G))
        exact = self.solved(lines_hz[row, check])[1]
        lost = np.abs(exact - G[row, check]).max(axis=(1, 2)) > 1e-6 * np.abs(exact).max(axis=(1, 2))
        for p in np.flatnonzero(lost):
            Z = s[p, :, None, None] ** 2 * self.robots.M[p] + s[p, :, None, None] * self.robots.D[p] + self.robots.K[p]
            J = self.robots.J[p, :3]
            G[p] = J @ np.linalg.solve(Z, np.broadcast_to(J.T.astype(complex), (len(Z), *J.T.shape)))
        return G

    def along(self, freq_hz: FloatArray, a: FloatArray) -> tuple[FloatArray, FloatArray]:
        """|a^T G a| (P, L) and its standard deviation, a (P, 3)."""
        robots, s = self.robots, np.broadcast_to(2j * np.pi * freq_hz, (len(a), len(freq_hz)))
        acting = np.einsum("pka,pa->pk", self.acting, a)
        u = (acting[:, None] / (s[:, :, None] - self.poles[:, None])) @ self.shapes.transpose(0, 2, 1)
        pull = np.einsum("pa,pan->pn", a, robots.J[:, :3])
        G = np.einsum("pfn,pn->pf", u, pull)
        P, L, n = u.shape
        outer = np.ascontiguousarray((u[:, :, :, None] * u[:, :, None, :]).reshape(P, L, n * n).transpose(0, 2, 1))
        # Real matrices times real and imaginary parts beside one another.
        products = (part.reshape(P, -1, n * n) @ outer.view(float) for part in (robots.dM, robots.dD, robots.dK))
        M, D, K = (product.view(complex) for product in products)
        turned = np.einsum("pkan,pa->pkn", robots.dJ[:, :, :3], a) @ u.transpose(0, 2, 1)
        slope = 2 * turned - (s[:, None] ** 2 * M + s[:, None] * D + K)
        size = np.maximum(np.abs(G), 1e-300)
        moved = (G.conj()[:, None] * slope).real / size[:, None]
        return size, np.linalg.norm(moved.transpose(0, 2, 1) @ robots.of_x, axis=2)

    def solved(self, freq_hz: FloatArray) -> tuple[ComplexArray, ComplexArray]:
        """X = Z^-1 J^T (P, n, 3) and G (P, 3, 3), at one line (P,) of each posture, 0 for rest."""
        robots, s = self.robots, 2j * np.pi * freq_hz[:, None, None]
        J = robots.J[:, :3]
        X = np.linalg.solve(s**2 * robots.M + s * robots.D + robots.K, J.transpose(0, 2, 1).astype(complex))
        return np.asarray(X), np.asarray(J @ X)

    def std(self, freq_hz: FloatArray, a: ComplexArray | FloatArray, b: ComplexArray | FloatArray) -> FloatArray:
        """Std of Re a^T G b (P,) at one line (P,), a and b (P, 3)."""
        robots, X, k = self.robots, self.solved(freq_hz)[0], 2j * np.pi * freq_hz[:, None]
        u, v = ((X @ each[:, :, None])[:, :, 0] for each in (a, b))
        slope = -(k**2 * _form(robots.dM, u, v) + k * _form(robots.dD, u, v) + _form(robots.dK, u, v))
        slope += _form(robots.dJ[:, :, :3], a, v) + _form(robots.dJ[:, :, :3], b, u)
        return np.asarray(np.linalg.norm(slope.real @ robots.of_x, axis=1))


def _form(matrices: Any, a: ComplexArray | FloatArray, b: ComplexArray | FloatArray) -> ComplexArray:
    """a^T A b (P, n_k) of matrices (P, n_k, m, n), a (P, m), b (P, n)."""
    P, n_k = matrices.shape[:2]
    outer = (a[:, :, None] * b[:, None, :]).reshape(P, -1, 1)
    return np.asarray((matrices.reshape(P, n_k, -1) @ outer)[:, :, 0])


def _along(real: FloatArray, n: FloatArray, f: FloatArray) -> FloatArray:
    """n^T Re G f (P, F)."""
    return np.asarray(real.reshape(*real.shape[:2], 9) @ np.outer(n, f).ravel())
