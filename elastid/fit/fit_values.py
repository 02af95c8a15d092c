"""FitValues: estimate, covariance and costs of a fit, and the numbers that follow from them."""

import math
from collections.abc import Iterator
from typing import Any

import numpy as np

from elastid.base.arrays import BoolArray, FloatArray, frozen_value, labelled
from elastid.base.errors import NamedValues, Note, UnknownNameError, did_you_mean, require_package
from elastid.base.names import match_names
from elastid.base.statistics import QUANTILE_95, correlation_of, exceeds_cost_limit
from elastid.fit.load_tests import StaticAgreement, ToolAgreement
from elastid.fit.problem.least_squares import LocalOptimum
from elastid.fit.result_rows import NO_NUMBERS, NO_PAIRS, NO_TABLE, Estimate, ModificationIndex, Presliding, RigidPart
from elastid.fit.spec import TYPICAL_MODEL_ERROR
from elastid.fit.status_terms import LARGE, Status
from elastid.linear.linear_model import LinearModel
from elastid.model.spec import ModelSpec
from elastid.parameters import Parameters
from elastid.robot import Robot

SINGLE_CAUSE_FRACTION = 0.95  # of the excess of V that a single cause must explain


@frozen_value
class FitValues:
    """Estimate x (n_x,), covariance (n_x, n_x) and costs of a fit; `Result` documents each field."""

    parameters: Parameters
    x: FloatArray = labelled("estimate as the variable of the solver (ln p where log)", "", "free_names")
    covariance: FloatArray = labelled("covariance of x", "", "free_names free_names")
    cost: float
    dof: int
    cost_expected: float
    status: Status
    message: str
    starts: tuple[LocalOptimum, ...] = labelled(rows=True)
    n_converged_starts: int
    at_bound: BoolArray = labelled("estimates at a bound", "", "free_names")
    singular_values: FloatArray = labelled("singular values of the Jacobian, columns scaled")
    criterion: str
    notes: tuple[Note, ...] = ()
    profile95: FloatArray = labelled(
        "95 % interval by profile likelihood", "SI", "free_names end", default_factory=NO_PAIRS
    )
    bootstrap95: FloatArray = labelled("95 % interval by bootstrap", "SI", "free_names end", default_factory=NO_PAIRS)
    configurations: tuple[str, ...] = ()
    information_fraction: FloatArray = labelled(
        "fraction of the information", "", "configurations free_names", default_factory=NO_TABLE
    )
    information_band_hz: FloatArray = labelled(
        "middle half of that information", "", "free_names end", default_factory=NO_PAIRS
    )
    cost_dof: float = math.nan
    model_error: float = 0.0
    indices: tuple[ModificationIndex, ...] = labelled(rows=True, default=())
    assumed_rigid: tuple[RigidPart, ...] = labelled(rows=True, default=())
    presliding: tuple[Presliding, ...] = labelled(rows=True, default=())
    verdicts: tuple[str, ...] = ()
    linear: tuple[LinearModel, ...] = labelled(entry="configuration.name", default=())
    averaging_fraction: FloatArray = labelled(
        "fraction of the variance that averages out", "", "free_names", default_factory=NO_NUMBERS
    )
    persistent_fraction: FloatArray = labelled(
        "fraction of the variance that no data reduce", "", "free_names", default_factory=NO_NUMBERS
    )
    robot: Robot | None = None
    equations: ModelSpec | None = None
    static: StaticAgreement | None = None
    tool: ToolAgreement | None = None

    def __post_init__(self) -> None:
        n_x = len(self.parameters.free)
        if self.x.shape != (n_x,) or self.covariance.shape != (n_x, n_x) or self.at_bound.shape != (n_x,):
            raise ValueError(f"a fit of {n_x} free parameters has x {self.x.shape}, covariance {self.covariance.shape}")

    @property
    def presliding_stiffness(self) -> dict[str, float]:
        """Presliding stiffness by motor, N m/rad (N/m), for motors with presliding friction."""
        return {friction.place: friction.stiffness for friction in self.presliding}

    @property
    def noise_is_known(self) -> bool:
        """True if noise was measured; otherwise there is no residual test."""
        return math.isfinite(self.cost_dof)

    @property
    def exceeds_noise(self) -> bool:
        """True if V exceeds the limit of noise alone (false-alarm rate 1/700)."""
        return self.noise_is_known and exceeds_cost_limit(self.cost, self.cost_expected, self.cost_dof)

    @property
    def is_within_declared(self) -> bool:
        """True if the residuals exceed the noise, but not 1.5 times noise and declared model error (above 1 %)."""
        return self.exceeds_noise and self.model_error > TYPICAL_MODEL_ERROR and self.error_ratio < LARGE

    @property
    def error_ratio(self) -> float:
        """Ratio of residuals to noise and model error, root mean square."""
        return math.sqrt(self.cost / max(self.dof, 1))

    @property
    def residual_ratio(self) -> float:
        """Ratio of residuals to noise, root mean square."""
        return math.sqrt(self.cost / max(self.cost_expected, 1e-300))

    @property
    def inflation_factor(self) -> float:
        """Factor by which residuals above the noise widen the intervals, at least 1."""
        return max(1.0, self.residual_ratio)

    @property
    def values(self) -> dict[str, float]:
        """The estimate by name, in SI."""
        return self.parameters.as_dict(self.x)

    @property
    def std(self) -> dict[str, float]:
        """Standard deviations of the free parameters in SI (first order for logarithmic ones)."""
        return self._in_si(self.std_of_x)

    @property
    def std_of_x(self) -> FloatArray:
        """Standard deviations of x (n_x,)."""
        return np.sqrt(np.diag(self.covariance))

    @property
    def has_tolerances(self) -> bool:
        """True if nuisance parameters, fixed values of the robot model with tolerances, were estimated."""
        return len(self.parameters.of_interest) < len(self.x)

    @property
    def std_noise(self) -> dict[str, float]:
        """Contribution of the measurement noise to `std`: the scatter of repeated measurements of one robot.

        Compare dates, or robots of one type, by this contribution: they share the errors of the robot model.
        """
        return self._contribution(self.averaging_fraction, 1.0)

    @property
    def std_prior(self) -> dict[str, float]:
        """Contribution of the robot model's tolerances to `std` that no amount of data reduces."""
        return self._contribution(self.persistent_fraction, 0.0)

    @property
    def std_systematic(self) -> dict[str, float]:
        """Remaining contribution: std^2 = std_noise^2 + std_prior^2 + std_systematic^2.

        Errors that repeated measurements share: the assumed model error, residuals above the noise, tolerances that
        more data narrow, errors of the friction compensation, and unexplained distortion.
        """
        return self._contribution(1 - self.averaging_fraction - self.persistent_fraction, 0.0)

    @property
    def std_contributions(self) -> dict[str, dict[str, float]]:
        """The contributions to `std` by name; none for an exact robot model."""
        names = ("std_noise", "std_prior", "std_systematic") if self.has_tolerances else ()
        return {name: getattr(self, name) for name in names}

    @property
    def std_with_base(self) -> dict[str, float]:
        """`std` of each parameter of interest in SI, including the bias by an unmodelled base of typical stiffness."""
        n = len(self.parameters.of_interest)
        bias_variance = sum((rigid_part.changes**2 for rigid_part in self.assumed_rigid), np.zeros(n))
        return self._in_si(np.sqrt(np.diag(self.covariance)[:n] + bias_variance))

    def _contribution(self, fraction: FloatArray, default: float) -> dict[str, float]:
        """Return the std, in SI by name, of a fraction (n_x,) of the variances, `default` if it is empty."""
        variance = np.diag(self.covariance)[: len(self.parameters.of_interest)]
        fractions = fraction[: len(variance)] if len(fraction) else np.full(len(variance), default)
        contribution = np.nan_to_num(variance, posinf=0.0) * fractions
        contribution[np.isinf(variance)] = np.inf if default else 0.0
        return self._in_si(np.sqrt(np.maximum(contribution, 0.0)))

    def _in_si(self, std: FloatArray) -> dict[str, float]:
        """Convert standard deviations (n,) of the first n variables of x to SI, by name (first order)."""
        free = zip(self.parameters.free, self.x, std, strict=False)
        return NamedValues("free parameter", {p.name: float(s * (np.exp(xi) if p.log else 1.0)) for p, xi, s in free})

    def interval(self, name: str) -> tuple[float, float]:
        """Return the 95 % interval of a free parameter in SI, by profile likelihood if computed, else symmetric in x.

        An interval that is symmetric in x = ln p has positive ends. Raises UnknownNameError, with the names of the free
        parameters, for all other names.
        """
        names = self.parameters.free_names
        if name not in names:
            reason = "is fixed or tied" if name in self.values else "is no parameter of this fit"
            raise UnknownNameError(f"{name} {reason}; {did_you_mean(name, names)}")
        i = names.index(name)
        if len(self.profile95) and not np.isnan(self.profile95[i]).any():
            return float(self.profile95[i, 0]), float(self.profile95[i, 1])
        half_width = QUANTILE_95 * math.sqrt(self.covariance[i, i])
        low, high = float(self.x[i]) - half_width, float(self.x[i]) + half_width
        with np.errstate(over="ignore"):
            return (float(np.exp(low)), float(np.exp(high))) if self.parameters.free[i].log else (low, high)

    def __len__(self) -> int:
        return len(self.keys())

    def __iter__(self) -> Iterator[str]:
        return iter(self.keys())

    def keys(self) -> tuple[str, ...]:
        """Return the names of the identified parameters of interest: a result maps them to estimates."""
        return tuple(p.name for p in self.parameters.of_interest)

    def __contains__(self, name: object) -> bool:
        """Return True for each name with an interval: parameters of interest and nuisance parameters."""
        return name in self.parameters.free_names

    def __getitem__(self, name: str) -> Any:
        """Return the estimate of a parameter, or a dictionary for a pattern (`k_*`); else raise UnknownNameError."""
        if name not in self and (names := match_names(name, self.keys())):
            return {key: self[key] for key in names}
        low, high = self.interval(name)
        return Estimate(name, self.values[name], self.std[name], low, high, self.parameters[name].unit)

    def to_dataframe(self) -> Any:
        """Return a `pandas.DataFrame` in SI: value, std and its three contributions, low, high, unit, free.

        std and the 95 % interval are NaN for fixed and tied parameters, contributions also for an exact robot model.
        ElastidError if pandas is not installed.
        """
        contributions = ("std_noise", "std_prior", "std_systematic")
        stds_of = {name: self.std_contributions.get(name, {}) for name in contributions} | {"std": self.std}
        rows: dict[str, list[Any]] = {}
        for p in self.parameters:
            is_free = p.name in self.parameters.free_names
            stds = [stds.get(p.name, math.nan) for stds in stds_of.values()]
            ends = self.interval(p.name) if is_free else (math.nan, math.nan)
            rows[p.name] = [self.values[p.name], *stds, *ends, p.unit, is_free]
        columns = ["value", *stds_of, "low", "high", "unit", "free"]
        return require_package("pandas", "notebook").DataFrame.from_dict(rows, orient="index", columns=columns)

    @property
    def has_single_cause(self) -> bool:
        """True if one cause explains the residuals beyond the noise."""
        return any(index.place == 1 and index.explained_fraction > SINGLE_CAUSE_FRACTION for index in self.indices)

    @property
    def correlation(self) -> FloatArray:
        """Correlation matrix (n_x, n_x); rows of unreachable parameters are NaN off the diagonal."""
        return correlation_of(self.covariance)
