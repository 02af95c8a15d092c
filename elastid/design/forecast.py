r"""The forecast of a plan: standard deviations, correlations, undetermined directions, use of the robot's limits.

.. math:: cov(x) = A^{-1} \Big[ \tfrac12 \mathrm{Re} \sum_k J_k^H S_k J_k \Big] A^{-1}, \qquad A = \sum_q \sum_k A_{qk}

the covariance that the fit itself will state (`fit.covariance`) for the expected responses. The share
c^T A_qk c / c^T A c, c = A^-1 e_p, of the information about parameter p comes from line k of configuration q.
"""

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from elastid.base.arrays import FloatArray, frozen_value, labelled, quotient
from elastid.base.errors import Note, StudyError
from elastid.base.statistics import correlation_of
from elastid.base.units import translation_unit
from elastid.excitation.grids import line_count_refusal
from elastid.fit.combinations import conditional_covariance, correlated_combinations
from elastid.fit.problem.least_squares import as_real
from elastid.parameters import Parameters

if TYPE_CHECKING:
    from elastid.design.predicted_response import ExpectedResponse

# Limits of the notes about a plan. False-alarm rates: not measured, a forecast has no noise.
MIN_COMPONENT = 0.2  # of an undetermined direction, from which on a parameter is named
COULOMB_RATIO = 1 / 3  # to the rms torque: a multisine of peaks of three rms still slides


@frozen_value
class Forecast:
    """Expected uncertainty of the free parameters (n,), at their nominal values.

    nominal (n,) and units: SI.  log (n,): whether covariance is of ln p.  covariance (n, n): of the solver's variables,
    inf on the diagonal where a parameter is undetermined.  information_fraction (Q, F, n): sums to 1 for
    each parameter.  configurations: those that the fit uses.
    notes: to be read before the robot moves.  choice: how the configurations were chosen.  noise (n, n): the part of
    covariance with the numbers of the robot's file known; without rows where the file is exact.
    """

    parameters: tuple[str, ...] = labelled("parameter that the fit identifies")
    units: tuple[str, ...] = labelled("unit of the parameter", axes="parameters")
    nominal: FloatArray = labelled("value that is assumed", "SI", "parameters")
    log: tuple[bool, ...]
    covariance: FloatArray = labelled("expected covariance of x", "", "parameters parameters")
    configurations: tuple[str, ...]
    freq_hz: FloatArray = labelled("excited frequency")
    information_fraction: FloatArray = labelled(
        "fraction of the information about a parameter", "", "configurations freq_hz parameters"
    )
    notes: tuple[Note, ...]
    choice: str = ""
    variance_fractions: FloatArray = labelled(
        "fractions of the variance: noise, prior, systematic", "", "part parameters",
        default_factory=lambda: np.zeros((0, 0)),
    )  # fmt: skip

    @property
    def std(self) -> FloatArray:
        """Standard deviations (n,) in SI, first order for logarithmic parameters."""
        return np.sqrt(np.diag(self.covariance)) * np.where(self.log, np.abs(self.nominal), 1.0)

    @property
    def std_contributions(self) -> dict[str, FloatArray]:
        """Contributions (n,) to `std` by name, as in a `Result`; empty for an exact robot model."""
        names = ("std_noise", "std_prior", "std_systematic")
        return {name: self.std * np.sqrt(part) for name, part in zip(names, self.variance_fractions, strict=False)}

    @property
    def relative(self) -> FloatArray:
        """Standard deviations (n,) relative to the nominal values; NaN where that is zero."""
        with np.errstate(divide="ignore", invalid="ignore"):
            return np.where(self.nominal != 0, self.std / np.abs(self.nominal), np.nan)

    @property
    def correlation(self) -> FloatArray:
        """Correlations (n, n); NaN off the diagonal for undetermined parameters."""
        return correlation_of(self.covariance)

    def strongest(self, name: str) -> tuple[str, float]:
        """Return the most correlated parameter and the correlation; '' without one."""
        row = self.parameters.index(name)
        strength = np.nan_to_num(np.abs(self.correlation[row]))
        strength[row] = 0.0
        column = int(np.argmax(strength))
        if strength[column] == 0:
            return "", 0.0
        return self.parameters[column], float(self.correlation[row, column])


def forecast(expected: "Sequence[ExpectedResponse]", x: FloatArray, is_compensated: bool = False) -> Forecast:
    """Return the forecast for parameters near x (n_x,) from the expected responses of a plan, all on the same lines.

    is_compensated: friction will be, of the torques.
    Raises StudyError where the plan has fewer lines than there are unknowns, or its responses drown in noise.
    """
    parameters = expected[0].parameters
    free, freq_hz = parameters.of_interest, expected[0].response.freq_hz
    n = len(free)  # parameters of interest; in x they are followed by nuisance parameters, which have priors
    check_line_count(freq_hz, parameters)
    from elastid.design.predicted_response import expected_fit  # a page reads the values alone
    from elastid.fit.covariance import estimate_uncertainty

    fit = expected_fit(expected)
    if fit.n_residuals == 0:
        text = "no response exceeds its noise at any line. Raise excitation.torque_rms, or measure more periods"
        raise StudyError("excitation/power", text, "excitation")
    responses, weights = [e.response for e in expected], [e.weights for e in expected]
    uncertainty = estimate_uncertainty(fit, responses, weights, x, is_forecast=True, is_compensated=is_compensated)
    covariance = uncertainty.covariance
    rows = [as_real(J).reshape(len(x), -1).T for _, J in fit.blocks(x)]
    R = np.linalg.qr(np.vstack([*rows, np.diag(fit.parameters.prior_slopes)]), "r")
    power = np.stack(uncertainty.power)[..., :n]
    fraction = quotient(power, power.sum(axis=(0, 1)))
    names, units, log = (tuple(getattr(p, kind) for p in free) for kind in ("name", "unit", "log"))
    nominal = np.array([parameters.as_dict(x)[p.name] for p in free])
    configurations = tuple(e.response.configuration.name for e in expected)
    notes = tuple(_undetermined(_blind(np.asarray(R), parameters, x), names))
    by_noise = conditional_covariance(covariance, n)
    a, p = uncertainty.averaging_fraction[:n], uncertainty.persistent_fraction[:n]
    fractions = np.nan_to_num([a, p, np.maximum(1 - a - p, 0.0)])
    values = names, units, nominal, log, covariance[:n, :n], configurations, freq_hz, fraction
    by_source = fractions if n < len(x) else np.zeros((0, 0))
    return Forecast(*values, (*notes, *correlated_combinations(names, by_noise)), variance_fractions=by_source)


def check_line_count(freq_hz: FloatArray, parameters: Parameters) -> None:
    """Raise StudyError for a grid with fewer lines than unknowns; the message states a sufficient period."""
    if refusal := line_count_refusal(len(freq_hz), len(parameters.of_interest), "unknowns"):
        raise StudyError("excitation/power", f"{refusal}, or fix some of fit.parameters", "excitation")


def _blind(R: FloatArray, parameters: Parameters, x: FloatArray) -> FloatArray:
    """Return directions (n_b, n) of relative changes that move the expected responses by less than their noise.

    They are of the n parameters of interest: nuisance parameters have priors, and move with each direction.
    """
    of_interest = parameters.of_interest
    n = len(of_interest)
    R = np.asarray(np.linalg.qr(np.roll(R, -n, axis=1), "r"))[-n:, -n:]
    ranges = [p.upper - p.lower for p in of_interest]
    linear = [r if np.isfinite(r) else abs(value) or 1.0 for r, value in zip(ranges, x[:n], strict=True)]
    _, singular_values, Vt = np.linalg.svd(R * np.where([p.log for p in of_interest], 1.0, linear))
    return Vt[singular_values < 1]


def _undetermined(blind: FloatArray, names: Sequence[str]) -> list[Note]:
    """Return a note for each undetermined direction (n_b, n)."""
    notes = []
    for direction in blind:
        members = [i for i in np.argsort(-np.abs(direction), kind="stable") if abs(direction[i]) > MIN_COMPONENT]
        terms = " ".join(f"{direction[i] * np.sign(direction[members[0]]):+.2f} {names[i]}" for i in members)
        unknown = names[members[0]] if len(members) == 1 else f"the combination {terms} (relative changes)"
        text = (
            f"this plan does not identify {unknown}. Fix or tie one parameter, or measure an output that depends on it"
        )
        notes.append(Note("fit/not-identifiable", text))
    return notes


# `turning back`: how far a motor's speed falls below that of a carrier of constant velocity, which is the limit, in the
# measured periods.  The last three are of injected references, which robots check as well.
QUANTITIES = (
    *("torque", "position", "velocity", "acceleration", "turning back"),
    *("reference position", "reference velocity", "reference acceleration"),
)
UNITS = ("N*m", "rad", "rad/s", "rad/s^2", "rad/s", "rad", "rad/s", "rad/s^2")


@frozen_value
class LimitUse:
    """Largest values, and the limits: peak, limit (Q, 8, n_u) for QUANTITIES, infinite where none.

    peak: as rehearsed, of runs far from all limits as expected by the linear response.
    position: about the configuration, to either side, its limit the room to the nearer end.  factor (Q, n_u): by which
    the amplitudes of the study were multiplied.  notes: one for every configuration that was scaled down.  sliding:
    inputs that translate, in N and m.
    """

    configurations: tuple[str, ...]
    inputs: tuple[str, ...]
    peak: FloatArray = labelled("largest value, link side", "", "configurations quantity inputs")
    limit: FloatArray = labelled("limit, infinite where there is none", "", "configurations quantity inputs")
    factor: FloatArray = labelled("factor on the amplitudes that the study gives", "", "configurations inputs")
    margin: float
    notes: tuple[Note, ...] = ()
    sliding: tuple[str, ...] = ()

    @property
    def used(self) -> FloatArray:
        """Part of each limit that is used (Q, 8, n_u)."""
        return self.peak / self.limit

    @property
    def closest(self) -> str:
        """A sentence about the limit of which most is used."""
        if not np.isfinite(self.limit).any():
            return "no limits are given"
        q, kind, i = np.unravel_index(np.argmax(self.used), self.used.shape)
        return (
            f"closest limit: {QUANTITIES[kind]} of {self.inputs[i]} in configuration {self.configurations[q]}, "
            f"{self.peak[q, kind, i]:.4g} of {self.limit[q, kind, i]:.4g} "
            f"{unit_of(int(kind), self.inputs[i] in self.sliding)} ({100 * self.used[q, kind, i]:.0f} %)"
        )

    @property
    def by_quantity(self) -> str:
        """Largest part of a limit of each quantity that is limited, in words."""
        used, is_limited = self.used.max(axis=(0, 2)), np.any(np.isfinite(self.limit), axis=(0, 2))
        return ", ".join(f"{QUANTITIES[i]} {used[i]:.0%}" for i in np.flatnonzero(is_limited))


def unit_of(kind: int, slides: bool) -> str:
    """Return the SI unit of one of QUANTITIES, of a motor whose joint turns or slides."""
    return translation_unit(UNITS[kind]) if slides else UNITS[kind]
