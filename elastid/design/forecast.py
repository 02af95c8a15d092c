r"""Forecast of a plan: standard deviations, correlations and unidentifiable directions of the parameters.

.. math:: cov(x) = A^{-1} \Big[ \tfrac12 \mathrm{Re} \sum_k J_k^H S_k J_k \Big] A^{-1}, \qquad A = \sum_q \sum_k A_{qk}

This covariance of the fit (`fit.covariance`) is evaluated for the expected responses. A fraction c^T A_qk c / c^T A c,
c = A^-1 e_p, of the information about parameter p comes from line k of configuration q.
"""

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from elastid.base.arrays import FloatArray, frozen_value, labelled, quotient
from elastid.base.errors import Note, StudyError
from elastid.base.statistics import correlation_of
from elastid.excitation.grids import line_count_refusal
from elastid.fit.combinations import conditional_covariance, correlated_combinations
from elastid.fit.problem.least_squares import as_real
from elastid.parameters import Parameters

if TYPE_CHECKING:
    from elastid.design.predicted_response import ExpectedResponse

# Limits of notes; they have no false-alarm rate, because a forecast has no noise.
MIN_COMPONENT = 0.2  # least component of an unidentifiable direction whose parameter is named
COULOMB_RATIO = 1 / 3  # largest Coulomb friction over the rms torque: a multisine has peaks of three rms


@frozen_value
class Forecast:
    """Expected uncertainty of the free parameters (n,), at their nominal values (SI).

    covariance (n, n): of the solver's variables, ln p where log (n,) is True; inf on the diagonal of an unidentifiable
    parameter.  information_fraction (Q, F, n): sums to 1 for each parameter.  configurations: those of the fit.
    choice: sentence on the selection of configurations.  variance_fractions (3, n): empty for an exact robot model.
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
        """Standard deviations (n,) over the nominal values; NaN for a value of 0."""
        with np.errstate(divide="ignore", invalid="ignore"):
            return np.where(self.nominal != 0, self.std / np.abs(self.nominal), np.nan)

    @property
    def correlation(self) -> FloatArray:
        """Correlations (n, n); NaN off the diagonal for unidentifiable parameters."""
        return correlation_of(self.covariance)

    def strongest(self, name: str) -> tuple[str, float]:
        """Return the most correlated parameter and its correlation; '' without one."""
        row = self.parameters.index(name)
        strength = np.nan_to_num(np.abs(self.correlation[row]))
        strength[row] = 0.0
        column = int(np.argmax(strength))
        if strength[column] == 0:
            return "", 0.0
        return self.parameters[column], float(self.correlation[row, column])


def forecast(expected: "Sequence[ExpectedResponse]", x: FloatArray, is_compensated: bool = False) -> Forecast:
    """Forecast the uncertainty of parameters near x (n_x,) from the expected responses of a plan on common lines.

    is_compensated: the estimator will compensate friction.
    Raises StudyError if the plan has fewer lines than unknowns, or no response exceeds its noise.
    """
    parameters = expected[0].parameters
    free, freq_hz = parameters.of_interest, expected[0].response.freq_hz
    n = len(free)  # nuisance parameters, which have priors, follow in x
    check_line_count(freq_hz, parameters)
    from elastid.design.predicted_response import expected_fit  # pages use this file without the model
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
    notes = tuple(_unidentifiable_notes(_unidentifiable_directions(np.asarray(R), parameters, x), names))
    by_noise = conditional_covariance(covariance, n)
    a, p = uncertainty.averaging_fraction[:n], uncertainty.persistent_fraction[:n]
    fractions = np.nan_to_num([a, p, np.maximum(1 - a - p, 0.0)])
    notes = (*notes, *correlated_combinations(names, by_noise))
    values = names, units, nominal, log, covariance[:n, :n], configurations, freq_hz, fraction, notes
    return Forecast(*values, variance_fractions=fractions if n < len(x) else np.zeros((0, 0)))


def check_line_count(freq_hz: FloatArray, parameters: Parameters) -> None:
    """Raise StudyError for a grid with fewer lines than unknowns; the message states a sufficient period."""
    if refusal := line_count_refusal(len(freq_hz), len(parameters.of_interest), "unknowns"):
        raise StudyError("excitation/power", f"{refusal}, or fix some of fit.parameters", "excitation")


def _unidentifiable_directions(R: FloatArray, parameters: Parameters, x: FloatArray) -> FloatArray:
    """Return directions (n_b, n) of relative changes whose effect on the expected responses is below the noise.

    R (n_x, n_x): square root of the information.  The n parameters of interest span the directions; nuisance
    parameters, which have priors, adapt to each direction.
    """
    of_interest = parameters.of_interest
    n = len(of_interest)
    R = np.asarray(np.linalg.qr(np.roll(R, -n, axis=1), "r"))[-n:, -n:]
    ranges = [p.upper - p.lower for p in of_interest]
    linear = [r if np.isfinite(r) else abs(value) or 1.0 for r, value in zip(ranges, x[:n], strict=True)]
    _, singular_values, Vt = np.linalg.svd(R * np.where([p.log for p in of_interest], 1.0, linear))
    return Vt[singular_values < 1]


def _unidentifiable_notes(directions: FloatArray, names: Sequence[str]) -> list[Note]:
    """Return a note for each unidentifiable direction (n_b, n)."""
    notes = []
    for direction in directions:
        members = [i for i in np.argsort(-np.abs(direction), kind="stable") if abs(direction[i]) > MIN_COMPONENT]
        terms = " ".join(f"{direction[i] * np.sign(direction[members[0]]):+.2f} {names[i]}" for i in members)
        subject = names[members[0]] if len(members) == 1 else f"the combination {terms} (relative changes)"
        cure = "Fix or tie one parameter, or measure an output that depends on it"
        notes.append(Note("fit/not-identifiable", f"this plan does not identify {subject}. {cure}"))
    return notes
