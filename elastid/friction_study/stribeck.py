r"""The static law through levels, by variable projection: its linear numbers are eliminated, the others searched for.

.. math:: \min_\eta \| P^\perp(\eta)\, W y \|^2, \quad c = (W \Phi)^+ W y

(Golub and Pereyra, SIAM J. Numer. Anal. 10, 1973.) W = 1 / std of each level.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from itertools import product

import numpy as np
from scipy.linalg import solve_triangular
from scipy.special import ndtri, stdtrit

from elastid.base.arrays import FloatArray
from elastid.base.errors import FitError
from elastid.base.statistics import chi_square_tail
from elastid.friction.static import Conditions, columns, slopes
from elastid.friction_study.least_squares import FALSE_ALARM, inverse_normal, minimise
from elastid.friction_study.levels import Levels
from elastid.robot.friction import EXPONENT_RANGE

# Decay of viscous friction over temperature from which a search starts, and the range of the search.
START_DECAY_K, DECAY_RANGE_K = 20.0, (1.0, 500.0)


@dataclass(frozen=True)
class Terms:
    """Numbers of a law: linear ones, nonlinear ones that are searched for, and held ones with their value."""

    linear: tuple[str, ...]
    searched: tuple[str, ...]
    held: Mapping[str, float]


@dataclass(frozen=True)
class CurveFit:
    """The linear numbers and eta by name, their covariance in the order linear + searched, cost (n,)^2 and its dof."""

    terms: Terms
    T_0: float
    values: Mapping[str, float]
    covariance: FloatArray
    cost: float
    dof: int
    hits: int
    starts: int

    @property
    def reach(self) -> float:
        """Half of a 95 % interval in stds: Student's t where the scatter of the levels gave these, else normal."""
        return float(stdtrit(self.dof, 0.975) if excess(self.cost, self.dof) > 1 else ndtri(0.975))

    @property
    def names(self) -> tuple[str, ...]:
        """In the order of the covariance."""
        return (*self.terms.linear, *self.terms.searched)

    def torque(self, conditions: Conditions) -> FloatArray:
        """s tau_f (n,) at conditions."""
        linear = np.array([self.values[name] for name in self.terms.linear])
        return np.asarray(columns(conditions, self.terms.linear, self.values, self.T_0) @ linear)

    def torque_std(self, conditions: Conditions) -> FloatArray:
        """Its std (n,), to first order."""
        J = derivative(conditions, self.terms, self.values, self.T_0)
        return np.asarray(np.sqrt(np.einsum("ni,ij,nj->n", J, self.covariance, J)))


def fit_curve(levels: Levels, terms: Terms) -> CurveFit:
    """The law nearest to the levels in units of their std; FitError for too few levels, or searches without an end."""
    n_numbers = len(terms.linear) + len(terms.searched)
    if levels.n_levels <= n_numbers:
        raise FitError(
            "friction/law",
            f"{levels.n_levels} levels for {n_numbers} numbers of its law "
            f"({', '.join((*terms.linear, *terms.searched))}); measure more speeds, or leave out parts of the law",
            f"friction of {levels.place}",
        )
    T_0 = reference_temperature(levels)
    search = _Search(levels, terms, T_0)
    ends = search.ends()
    if not ends:
        text = "no start of its Stribeck curve leads to an optimum; check its levels"
        raise FitError("friction/law", text, f"friction of {levels.place}")
    x, cost = min(ends, key=lambda end: end[1])
    dof = levels.n_levels - n_numbers
    hits = sum(other <= cost + 1e-3 * max(1.0, cost / dof) for _, other in ends)
    eta = search.eta(x)
    linear, _ = search.project(eta)
    values = dict(zip(terms.linear, linear.tolist(), strict=True)) | eta
    J = derivative(levels.conditions, terms, values, T_0) / levels.std[:, None]
    covariance = inverse_normal(J) * excess(cost, dof)
    return CurveFit(terms, T_0, values, covariance, cost, dof, hits, len(ends))


def excess(cost: float, dof: int) -> float:
    """Factor of the variance of levels by which they scatter more than stated; 1 where chance explains it."""
    return cost / dof if chi_square_tail(cost, dof) < FALSE_ALARM else 1.0


def derivative(conditions: Conditions, terms: Terms, values: Mapping[str, float], T_0: float) -> FloatArray:
    """d s tau_f / d numbers (n, n_linear + n_searched)."""
    linear = {name: values[name] for name in terms.linear}
    searched = slopes(conditions, linear, terms.searched, values, T_0)
    return np.hstack([columns(conditions, terms.linear, values, T_0), searched])


def reference_temperature(levels: Levels) -> float:
    """T_0: the mean of the temperatures, in degC; 0 where none is known."""
    known = levels.known_temperatures
    return float(known.mean()) if len(known) else 0.0


@dataclass(frozen=True)
class _Search:
    """The variables x: ln of each searched number; the Stribeck velocity over temperature by its ln at both ends."""

    levels: Levels
    terms: Terms
    T_0: float

    def eta(self, x: FloatArray) -> dict[str, float]:
        """The nonlinear numbers at x, held ones included."""
        eta = dict(self.terms.held) | dict(zip(self.terms.searched, np.exp(x).tolist(), strict=True))
        if "temperature.stribeck_velocity" in self.terms.searched:
            cold, hot = eta["stribeck_velocity"], eta["temperature.stribeck_velocity"]
            low, high = self._ends
            eta["temperature.stribeck_velocity"] = (hot - cold) / (high - low)
            eta["stribeck_velocity"] = cold - low * (hot - cold) / (high - low)
        return eta

    def project(self, eta: Mapping[str, float]) -> tuple[FloatArray, FloatArray]:
        """The best linear numbers at eta, and the residual."""
        W = 1 / self.levels.std
        Q, R = np.linalg.qr(W[:, None] * columns(self.levels.conditions, self.terms.linear, eta, self.T_0))
        y = W * self.levels.torque
        share = Q.T @ y
        diagonal = np.abs(np.diag(R))
        if diagonal.min() > 1e-12 * diagonal.max():
            linear = np.asarray(solve_triangular(R, share))
        else:
            linear = np.asarray(np.linalg.lstsq(R, share, rcond=None)[0])
        return linear, y - Q @ share

    def ends(self) -> list[tuple[FloatArray, float]]:
        """The ends of the searches from all starts, with their costs."""
        starts = list(self.starts())
        if not self.terms.searched:
            _, left = self.project(self.eta(starts[0]))
            return [(starts[0], float(left @ left))]
        optima = minimise(
            lambda x: self.project(self.eta(x))[1], starts,
            jac="3-point", bounds=self._bounds, x_scale=1.0, ftol=1e-12, xtol=1e-10,
        )  # fmt: skip
        return [(end.x, end.cost) for end in optima]

    def starts(self) -> Iterator[FloatArray]:
        """Stribeck velocities over the speeds, exponents, one decay."""
        speeds = np.log(self.levels.speed)
        velocities = speeds.min() + np.array((0.15, 0.35, 0.6)) * np.ptp(speeds)
        choices: dict[str, tuple[float, ...]] = {
            "stribeck_velocity": tuple(velocities),
            "exponent": tuple(np.log((1.0, 2.0))),
            "load.stribeck_velocity": tuple(velocities[1:]),
            "temperature.decay": (float(np.log(START_DECAY_K)),),
        }
        names = [name for name in self.terms.searched if name != "temperature.stribeck_velocity"]
        for values in product(*(choices[name] for name in names)):
            start = dict(zip(names, values, strict=True))
            start["temperature.stribeck_velocity"] = start.get("stribeck_velocity", 0.0)
            yield np.array([start[name] for name in self.terms.searched])

    @property
    def _bounds(self) -> tuple[FloatArray, FloatArray]:
        slow, fast = 0.05 * self.levels.speed.min(), 3.0 * self.levels.speed.max()
        ranges = {"exponent": EXPONENT_RANGE, "temperature.decay": DECAY_RANGE_K}
        ends = [ranges.get(name, (slow, fast)) for name in self.terms.searched]
        low, high = np.log(np.array(ends)).T
        return low, high

    @property
    def _ends(self) -> tuple[float, float]:
        known = self.levels.known_temperatures - self.T_0
        return float(known.min()), float(known.max())
