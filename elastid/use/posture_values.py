r"""Compliance, natural frequencies, chatter limit and deflection of postures with locked motors, with intervals.

.. math:: C = J K^{-1} J^T, \qquad
          G(j\omega) = J\, (K - \omega^2 M + j \omega D)^{-1} J^T, \qquad
          a_{lim} = \frac{-1}{2 K_t \min_\omega \mathrm{Re}\, G_{nf}}

The lines of each posture include the peak and the most negative real part of each mode. G_nf = n^T G f: motion along
the normal n of the cut by a force along f. The default is the worst direction n = f, the eigenvector of the smallest
eigenvalue of Re G (Altintas, Manufacturing Automation, 2nd ed., 2012, eq. 4.20). Standard deviations are of first order
(`FittedModel.response_shifts`), at the line of the extremum, whose shift is of second order.
"""

from dataclasses import dataclass
from functools import cached_property
from itertools import starmap
from typing import TypeAlias

import numpy as np

from elastid.base.arrays import BoolArray, ComplexArray, FloatArray, laplace_variable
from elastid.base.kernels import is_compiled
from elastid.base.matrices import singular_values
from elastid.linear.fitted_model import deviation
from elastid.linear.modes import oscillations
from elastid.linear.response.kernel import Elimination, solved_products
from elastid.use.locked_postures import LockedEquations, LockedPostures


@dataclass(frozen=True)
class Cut:
    """Load (3,) on the tool, N, cutting coefficient K_t, N/m^2, and directions (3,) or None, in the base's axes.

    normal: of the cut surface, along which the chip thickness grows.  force: of the cutting force.
    """

    load: tuple[float, float, float] = (0.0, 0.0, -100.0)
    cutting_coefficient: float = 700e6
    normal: tuple[float, float, float] | None = None
    force: tuple[float, float, float] | None = None

    def __post_init__(self) -> None:
        directions = [direction for direction in (self.normal, self.force) if direction is not None]
        is_finite = np.all(np.isfinite([self.load, *directions]))
        if not is_finite or not all(map(np.any, directions)) or (self.force and not self.normal):
            text = "load, normal and force must be finite; normal and force must not be 0; force requires normal"
            raise ValueError(text)
        if not self.cutting_coefficient > 0:
            raise ValueError(f"cutting coefficient {self.cutting_coefficient:g} N/m^2; it must be positive")

    @property
    def directions(self) -> tuple[FloatArray, FloatArray] | None:
        """Unit vectors n and f (3,); None without a normal.  The default of f is n."""
        if self.normal is None:
            return None
        n, f = np.array(self.normal, float), np.array(self.force or self.normal, float)
        return n / np.linalg.norm(n), f / np.linalg.norm(f)


# Unit and meaning of the quantities of a posture.
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


# Values and standard deviations (Q,) of quantities by name.
Values: TypeAlias = dict[str, tuple[FloatArray, FloatArray]]


@np.errstate(invalid="ignore")  # postures with fewer modes than others have NaN
def map_columns(
    equations: LockedEquations, lines_hz: FloatArray, curve_hz: FloatArray, cut: Cut, angles: FloatArray
) -> tuple[BoolArray, dict[str, FloatArray]]:
    """Return whether each of N postures has an equilibrium, and the columns of a map of the Q postures that have one.

    angles (N, n_u), rad or m.  curve_hz (L,): lines of the curves.  Quantities are (Q, 2): value and std.
    """
    q, has_rest = equations.rest(angles)
    if not has_rest.any():
        return has_rest, {}
    models, estimate = equations.at(angles[has_rest], q[has_rest]), equations.family.estimated
    poles, shapes, _ = oscillations(models.M, models.D, models.K)
    slopes_of_x = estimate.slopes[equations.dependent]
    freq_hz, zeta, shifts = np.abs(poles) / (2 * np.pi), -poles.real / np.abs(poles), estimate.axes @ slopes_of_x.T
    peak_hz, chatter_hz = _extremes(models, freq_hz, zeta, lines_hz, cut)
    static_hz = 1e-5 * np.nanmin(freq_hz, axis=1, initial=lines_hz[0])  # quasi-static
    s = laplace_variable(np.column_stack([static_hz, peak_hz, chatter_hz]))
    responses = _Responses(models, s, models.motions(s, np.eye(3)[None]), shifts)
    compliance, axes = responses.principal_compliances
    softest = axes[:, :, 0]
    values = responses.static_values(compliance[:, 0], softest, np.array(cut.load)) | responses.dynamic_values(cut)
    values |= _frequencies(models, poles, shapes, slopes_of_x, estimate.covariance)
    deflection = np.linalg.solve(models.K, models.J.mT @ softest[:, :, None])
    energy = (deflection.mT @ models.K @ deflection)[:, :, 0]
    fractions = models.stiffness * (models.deflection @ deflection)[:, :, 0] ** 2 / np.where(energy > 0, energy, np.inf)
    magnitude, magnitude_std = _curve(models, softest, curve_hz, shifts)
    return has_rest, {name: np.stack(value, axis=1) for name, value in values.items()} | {
        "angles": angles[has_rest], "axes": axes, "chatter_hz": chatter_hz, "compliance_fraction": fractions,
        "position": models.position, "magnitude": magnitude, "magnitude_std": magnitude_std,
    }  # fmt: skip


@dataclass(frozen=True, eq=False)
class _Responses:
    """Motions X (Q, 3, n, 3) of postures under unit forces at s (Q, 3): static, at the peak, at the chatter frequency.

    shifts (n_a, P): of the parameters by one standard deviation in each independent direction.
    """

    models: LockedPostures
    s: ComplexArray
    X: ComplexArray
    shifts: FloatArray

    @cached_property
    def H(self) -> ComplexArray:
        """Compliance (Q, 3, 3, 3) of the frame at the three lines."""
        return self.models.J[:, None] @ self.X

    def std(self, line: int, a: ComplexArray | FloatArray, b: ComplexArray | FloatArray) -> FloatArray:
        """Return standard deviations (Q,) of Re a^T G b at one of the three lines, for directions a, b (Q, 3)."""
        pair = ((self.X[:, line] @ direction[:, :, None]).mT for direction in (a, b))
        slopes = self.models.response_slopes(self.s[:, line, None], a, b, *pair)[:, 0]
        return np.asarray(np.linalg.norm(slopes.real @ self.shifts.T, axis=1))

    @property
    def principal_compliances(self) -> tuple[FloatArray, FloatArray]:
        """Static compliances (Q, 3), the softest first, and their directions as columns (Q, 3, 3)."""
        C = self.H[:, 0].real
        values, axes = np.linalg.eigh((C + C.mT) / 2)
        return values[..., ::-1], axes[..., ::-1]

    def static_values(self, compliance: FloatArray, softest: FloatArray, load: FloatArray) -> Values:
        """Return static compliances (softest direction (Q, 3), x, y, z) and the deflection under a load (3,)."""
        C = self.H[:, 0].real
        values = {"softest_compliance": (compliance, self.std(0, softest, softest))}
        for i, name in enumerate("xyz"):
            axis = np.broadcast_to(np.eye(3)[i], (len(C), 3))
            values[f"compliance_{name}"] = C[:, i, i], self.std(0, axis, axis)
        motion = C @ load
        deflection = np.linalg.norm(motion, axis=1)
        direction = motion / np.maximum(deflection, 1e-300)[:, None]
        values["deflection"] = deflection, self.std(0, direction, np.broadcast_to(load, (len(C), 3)))
        return values

    def dynamic_values(self, cut: Cut) -> Values:
        """Return the largest dynamic compliance and the limiting depth of cut."""
        U, sizes, Vh = np.linalg.svd(self.H[:, 1])
        peak = sizes[:, 0], self.std(1, U[:, :, 0].conj(), Vh[:, 0].conj())
        real = self.H[:, 2].real
        worst = np.linalg.eigh(real)[1][:, :, 0]
        n, f = (np.broadcast_to(direction, worst.shape) for direction in cut.directions or (worst, worst))
        min_real = np.einsum("qi,qij,qj->q", n, real, f)
        min_real = np.where(min_real < 0, min_real, np.nan)
        depth = -1 / (2 * cut.cutting_coefficient * min_real)
        depth_std = depth / -min_real * self.std(2, n, f)
        return {"dynamic_compliance": peak, "depth_of_cut": (np.where(min_real < 0, depth, np.inf), depth_std)}


def _frequencies(
    models: LockedPostures, poles: ComplexArray, shapes: ComplexArray, slopes_of_x: FloatArray, covariance: FloatArray
) -> Values:
    """Return the first three natural frequencies; NaN if the robot has fewer coordinates."""
    lowest, phi = poles[:, :3], shapes[:, :, :3].mT
    norm = np.einsum("qmi,qmij,qmj->qm", phi, 2 * lowest[..., None, None] * models.M[:, None] + models.D[:, None], phi)
    slopes = -(lowest.conj() / norm / np.abs(lowest))[..., None] * models.slopes(lowest, phi, phi)
    rows, swings = np.full((3, 2, len(poles)), np.nan), ~np.isnan(lowest)
    rows[: lowest.shape[1], 0] = np.abs(lowest).T / (2 * np.pi)
    rows[: lowest.shape[1], 1].T[swings] = deviation((slopes.real @ slopes_of_x)[swings] / (2 * np.pi), covariance)
    return {f"frequency_{i}": (value, std) for i, (value, std) in enumerate(rows, start=1)}


def _curve(
    models: LockedPostures, direction: FloatArray, curve_hz: FloatArray, shifts: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return the magnitude (Q, L) of the dynamic compliance along a direction (Q, 3), and its standard deviation."""
    s = laplace_variable(curve_hz[None])
    x = models.motions(s, direction[:, :, None])[..., 0]
    G = (x @ models.J.mT @ direction[:, :, None])[..., 0]
    slopes = models.response_slopes(s, direction, direction, x, x)
    magnitude = np.maximum(np.abs(G), 1e-300)
    return magnitude, np.linalg.norm(((G.conj()[..., None] * slopes).real / magnitude[..., None]) @ shifts.T, axis=2)


def _extremes(
    models: LockedPostures, freq_hz: FloatArray, zeta: FloatArray, lines_hz: FloatArray, cut: Cut
) -> tuple[FloatArray, FloatArray]:
    """Return the lines (Q,) of the largest response and the most negative real part; freq_hz, zeta (Q, n): or NaN."""
    zeta = np.clip(zeta, 0.0, 1.0)
    # Peak and most negative real part of a single mode, over its natural frequency.
    extremes = [np.sqrt(np.maximum(1 - 2 * zeta**2, 1e-4)), np.sqrt(1 + 2 * zeta)]
    mode_lines = np.nan_to_num(np.hstack([freq_hz * factor for factor in extremes])).clip(lines_hz[0], lines_hz[-1])
    lines = np.hstack([np.broadcast_to(lines_hz, (len(mode_lines), len(lines_hz))), mode_lines])
    elimination = Elimination.of(np.any([A.any(axis=0) for A in (models.M, models.D, models.K)], axis=0))
    products, rows = elimination.products if is_compiled() else solved_products, np.arange(len(lines))
    matrices = zip(models.M, models.D, models.K, 2 * np.pi * lines, models.J.mT, models.J.mT, strict=True)
    G = np.array(list(starmap(products, matrices)))
    if cut.directions is None:  # c I - Re G is positive, with the largest eigenvalue c minus the smallest of Re G
        c = np.linalg.norm(G.real, axis=(2, 3))
        real = c - largest_gain((c[:, :, None, None] * np.eye(3) - G.real).astype(complex))
    else:
        real = cut.directions[0] @ G.real @ cut.directions[1]
    return lines[rows, np.argmax(largest_gain(G), axis=1)], lines[rows, np.argmin(real, axis=1)]


def largest_gain(G: ComplexArray) -> FloatArray:
    """Return the largest singular value (...) of matrices (..., n, n)."""
    return singular_values(G.reshape(-1, *G.shape[-2:]))[:, 0].reshape(G.shape[:-2])
