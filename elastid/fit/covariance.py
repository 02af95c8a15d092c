r"""Covariance of the estimate, combined from six contributions.

Around the optimum the estimate follows the data, dx = A^-1 sum_k g_k, with A = J^T J and g_k = J_k^T r_k the pull of
line k. Each variance is the largest of the first three contributions, plus the other three:

.. math:: \text{noise: } A^{-1} \Big[ \tfrac12 \mathrm{Re} \sum_k J_k^H S_k J_k \Big] A^{-1}, \qquad
          \text{residuals: } \mathrm{var}\, x_i = \tau \tfrac{N}{N - n_x} \sum_k (A^{-1} g_k)_i^2, \qquad
          \text{model error: } A^{-1} \Big[ \tfrac{s}{2} \mathrm{Re} \sum_o h_o h_o^H \Big] A^{-1}

- noise (`noise_covariance`): S_k is the measured covariance in whitened residuals, correlations between elements
  included. With inverse-variance weights and uncorrelated elements this is A^-1 (Cramer-Rao). A covariance of few
  lines, each measured few times, is itself uncertain: the variance is widened to Student's quantile (`noise_dof`).
  Priors, and systematic errors of given size (`problem.systematic_errors`), are nuisance parameters within A.
- residuals (`sandwich_variance`): a sandwich estimate of noise and model error. The pulls of one frequency, in all
  elements and configurations, are added before they are squared, since a wrong model errs in all of them together.
  tau >= 1 is the correlation length of the residuals over neighbouring lines.
- blocks (`robust_covariance`): if V exceeds the noise, the model is in error, and the parameters absorb a different
  part of the error in each configuration and band. The variance is at least the scatter over blocks and, from three
  configurations on, the jackknife variance (conservative).
- model error (`model_error_covariance`): the error alpha |G| that the study declares or the residuals show. Such an
  error is the same on neighbouring lines and in all configurations; it counts as one random factor for each element
  and octave, with pull h_o. s <= 1 limits it to the power that V leaves room for: 0 for alpha = 0, small if the
  residuals are far below alpha |G|.
- ratios (`gear_ratios`): gear ratios that differ between angles.
- friction (`friction_variance`): errors of the friction compensation, equal in all configurations.

Without declared model error and with an exact model noise and residuals agree, and 95 % intervals contain the true
values 95 to 97 % of the time. An error that the parameters absorb equally in all configurations does not show; only
the declared model error covers it.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from elastid.base.arrays import BoolArray, ComplexArray, FloatArray, frozen_value, quotient
from elastid.base.execution import Execution
from elastid.base.statistics import exceeds_cost_limit, small_sample_factors
from elastid.fit.gear_ratios import RatioScatter, scatter_of_ratios
from elastid.fit.problem.frf_residuals import ElasticFit, chunked, map_chunks
from elastid.fit.problem.systematic_errors import find_factors
from elastid.fit.problem.weights import Weights
from elastid.fit.robust_covariance import (
    LineSums,
    block_variance,
    correlation_length,
    disagreement,
    jackknife_variance,
    sum_lines,
    triangle,
)
from elastid.fit.solve.solvers import DAMPING_UNITS
from elastid.parameters import Parameter, Parameters
from elastid.response import UNEXPLAINED, Response


def information(
    power: Sequence[FloatArray], freq_hz: Sequence[FloatArray], load_power: FloatArray
) -> tuple[FloatArray, FloatArray]:
    r"""Return the fraction (Q, n_x) of each configuration, and the band (n_x, 2) of the middle half of the information.

    .. math:: s_{ci} = \frac{[A^{-1} A_c A^{-1}]_{ii}}{[A^{-1}]_{ii}}, \qquad A = \sum_c A_c

    power: for each configuration, contributions [A^-1 A_k A^-1]_ii (F, n_x) of its lines freq_hz (F,) to the variances.
    load_power (n_x,): contribution of load tests, whose fraction is the remainder.
    """
    sums = [np.sum(lines, axis=0) for lines in power]
    total = np.sum(sums, axis=0)
    total[total == 0] = np.nan
    frequencies = np.concatenate(freq_hz)
    order = np.argsort(frequencies, kind="stable")
    rising = np.cumsum(np.concatenate(power)[order], axis=0) / total
    indices = np.array([np.searchsorted(column, (0.25, 0.75)) for column in np.nan_to_num(rising.T, nan=1.0)])
    band = frequencies[order][np.minimum(indices, len(frequencies) - 1)]
    return np.array([lines / (total + load_power) for lines in sums]), band


def noise_dof(power: Sequence[FloatArray], dof: Sequence[float], load_power: FloatArray) -> FloatArray:
    """Return the real degrees of freedom (n_x,) of each variance by the measured noise (Satterthwaite 1946).

    2 (sum p_k)^2 / sum (p_k^2 / nu), with the contribution p_k of each independent line; load tests have exact noise.
    power, load_power: as in `information`.  dof: complex degrees of freedom nu of each configuration.
    """
    total, spread = load_power, np.zeros(len(load_power))
    for lines, nu in zip(power, dof, strict=True):
        total, spread = total + lines.sum(axis=0), spread + np.sum(lines**2, axis=0) / nu
    return quotient(2 * total**2, spread, np.inf)


@frozen_value
class Uncertainty:
    """Covariance (n_x, n_x) of the estimate x, with the numbers that explain its size.

    covariance: infinite variances for unidentifiable parameters.  singular_values: of J with columns of unit length.
    unidentifiable (n_x,): True for parameters in a direction without information.
    expected_cost: V by the noise alone.  cost_dof: 2 / cost_dof is the relative variance of V / expected_cost; NaN if
    no noise was measured.  costs (Q,): V of each configuration.  power: for each configuration, the contributions
    (F, n_x) of its lines to the variances.
    information_fraction (Q, n_x): fraction of the information by configuration.  information_band_hz (n_x, 2):
    frequency band of the middle half of the information.
    disagreement: T of the blocks, 1 for a correct model (`robust_covariance`).  shift (n_x,): std by the blocks,
    relative to the std by measured noise, gear ratios and declared model error.
    averaging_fraction, persistent_fraction (n_x,): fractions of the variance that average out over repeated
    measurements, and that no amount of data reduces.  ratios: scatter of the gear ratios.
    """

    covariance: FloatArray
    singular_values: FloatArray
    unidentifiable: BoolArray
    expected_cost: float
    cost_dof: float
    information_fraction: FloatArray
    information_band_hz: FloatArray
    disagreement: float
    shift: FloatArray
    averaging_fraction: FloatArray
    persistent_fraction: FloatArray
    costs: FloatArray
    power: tuple[FloatArray, ...]
    ratios: RatioScatter


# Factor of the amount of data that counts as unlimited: it reduces the std by noise to a hundredth.
UNLIMITED_DATA = 1e4


def estimate_uncertainty(
    fit: ElasticFit, responses: Sequence[Response], weights: Sequence[Weights], x: FloatArray,
    execution: Execution | None = None, is_forecast: bool = False, is_compensated: bool = False,
) -> Uncertainty:  # fmt: skip
    """Estimate the covariance of x (n_x,), the optimum of `fit`.

    is_forecast: expected covariance, for responses without noise.  is_compensated: friction was subtracted from the
    torques.  Load tests have the covariance that their file states.
    """
    sums = sum_up(fit, responses, weights, x, execution or Execution())
    line_sums, H, unidentifiable = sums.line_sums, sums.H, sums.unidentifiable
    noise, expected_cost, cost_dof = noise_covariance(sums)
    cost = expected_cost if is_forecast else sums.cost
    is_excess = exceeds_cost_limit(cost, expected_cost, cost_dof)
    correlated_lines = max((response.correlated_lines for response in responses), default=1.0)
    # With a model error that the ratios do not explain, the std of each ratio is at least its tolerance.
    has_model_error = float(any(weight.model_error > 0 for weight in weights))
    V = math.nan if is_forecast else cost
    ratios = scatter_of_ratios(line_sums, H, V, expected_cost, correlated_lines, is_excess, has_model_error)
    nuisance = [i for i, parameter in enumerate(fit.parameters.free) if parameter.is_nuisance]
    by_prior, persistent = prior_variance(sums, nuisance)
    averaging = np.maximum(np.diag(noise) - by_prior, 0.0)
    power = tuple(sums_q.power for sums_q in line_sums)
    dof = noise_dof(power, [sums_q.noise_dof for sums_q in line_sums], sums.load_power)
    dof = dof / np.maximum(quotient(averaging, np.diag(noise), 1.0), 1e-6) ** 2
    blocks = block_variance([sums_q.blocks for sums_q in line_sums], H)
    contributions = Contributions(
        noise=noise, widening=small_sample_factors(dof), residuals=sandwich_variance(sums),
        blocks=np.maximum(blocks, jackknife_variance(line_sums, H)) if is_excess else np.zeros(len(x)),
        model_error=model_error_covariance(sums, cost, expected_cost, cost_dof), ratios=ratios.covariance,
        friction=friction_variance(fit.parameters, responses, is_compensated),
    )  # fmt: skip
    covariance = contributions.covariance(H)
    unbiased_variance = contributions.random + np.diag(contributions.model_error)
    random_fraction = contributions.random_fraction(covariance, is_excess) / contributions.random
    covariance[unidentifiable] = covariance[:, unidentifiable] = np.nan
    covariance[unidentifiable, unidentifiable] = np.inf
    fraction, band_hz = information(power, [sums_q.freq_hz for sums_q in line_sums], sums.load_power)
    return Uncertainty(
        covariance=covariance, singular_values=sums.singular_values, unidentifiable=unidentifiable,
        expected_cost=expected_cost, cost_dof=cost_dof, information_fraction=fraction, information_band_hz=band_hz,
        disagreement=disagreement([sums_q.disagreement for sums_q in line_sums], len(H)),
        shift=np.where(unidentifiable, 0.0, np.sqrt(blocks / unbiased_variance)),
        averaging_fraction=averaging * random_fraction,
        persistent_fraction=(np.minimum(persistent, by_prior) + np.diag(contributions.ratios)) * random_fraction,
        costs=np.array([sums_q.cost for sums_q in line_sums]), power=power, ratios=ratios,
    )  # fmt: skip


@dataclass(frozen=True, eq=False)
class Contributions:
    """Contributions to the covariance of x, before they are combined; for their equations see the module.

    noise, model_error, ratios: covariances (n_x, n_x).  residuals, blocks, friction: variances (n_x,).  widening
    (n_x,): factor on standard deviations by the noise, because the noise covariance is an estimate.
    """

    noise: FloatArray
    widening: FloatArray
    residuals: FloatArray
    blocks: FloatArray
    model_error: FloatArray
    ratios: FloatArray
    friction: FloatArray

    def covariance(self, H: FloatArray) -> FloatArray:
        """Combine: the largest of noise, residuals and blocks, plus model error, ratios and friction.

        Correlations are those of the noise, or of A^-1 = H^T H if a parameter has no noise.
        """
        noise = self.noise * np.outer(self.widening, self.widening)
        C = noise if np.all(np.diag(noise) > 0) else H.T @ H
        std = np.sqrt(np.maximum.reduce([np.diag(noise), self.residuals, self.blocks]))
        scale = quotient(std, np.sqrt(np.diag(C)))
        return C * np.outer(scale, scale) + self.model_error + self.ratios + np.diag(self.friction)

    @property
    def random(self) -> FloatArray:
        """Variance (n_x,) by noise, ratios and friction, not widened."""
        return np.maximum(np.diag(self.noise + self.ratios) + self.friction, 1e-300)

    def random_fraction(self, covariance: FloatArray, is_excess: bool) -> FloatArray:
        """Return the fraction (n_x,) of the variance that noise, ratios and friction explain.

        Residuals above the noise, and the model error, are equal in repeated measurements.
        """
        by_noise = np.diag(self.noise) * self.widening**2 + np.diag(self.ratios) + self.friction
        explained = by_noise if is_excess else np.diag(covariance - self.model_error)
        return np.minimum(explained / np.maximum(np.diag(covariance), 1e-300), 1.0)


@dataclass(frozen=True, eq=False)
class Sums:
    """Sums of all configurations in the variables z of `sum_lines`, x = H^T z, and the rows beside the responses.

    H (n, n_x): without the columns of shared factors.  prior_J (n_p, n): rows 1 / s of the priors, 0 without one.
    static_J (m, n), static_r (m,): rows and residuals of load tests.  model_error_pulls: sums of
    `LineSums.model_error_pull`.  n_residuals: real residuals of responses and load tests.  dof: n_residuals plus priors
    minus parameters.
    """

    line_sums: tuple[LineSums, ...]
    H: FloatArray
    singular_values: FloatArray
    unidentifiable: BoolArray
    prior_J: FloatArray
    static_J: FloatArray
    static_r: FloatArray
    model_error_pulls: Mapping[tuple[str, str, int], ComplexArray]
    n_residuals: int
    dof: int

    @property
    def cost(self) -> float:
        """V of responses and load tests."""
        return float(np.array([sums_q.cost for sums_q in self.line_sums]).sum() + self.static_r @ self.static_r)

    @property
    def load_power(self) -> FloatArray:
        """Contribution (n_x,) of load tests to the variances, as `LineSums.power`."""
        return np.asarray(np.sum((self.static_J @ self.H) ** 2, axis=0))


def sum_up(
    fit: ElasticFit, responses: Sequence[Response], weights: Sequence[Weights], x: FloatArray, home: Execution
) -> Sums:
    """Return the sums at x (n_x,), the optimum of `fit`."""
    factors, n_x = find_factors(responses), len(x)
    bare = replace(fit, frfs=(), loads=None)  # without configurations: other processes receive them chunk by chunk
    static_r, static_J = fit.static(x)
    static_J = np.pad(static_J, ((0, 0), (0, len(factors))))  # no factor of the responses moves load tests
    prior_J = np.diag(np.concatenate([fit.parameters.prior_slopes, np.ones(len(factors))]))
    configurations = list(zip(fit.frfs, responses, weights, strict=True))
    R = np.vstack([prior_J, static_J])
    for block in home.with_affinity(
        partial(triangle, bare, x, factors), chunked(configurations)
    ):  # R of the stacked J = Q R
        R = np.asarray(np.linalg.qr(np.vstack([R, block]), mode="r"))
    H, singular_values, unidentifiable = inverse_information(R)
    line_sums, pulls = list[LineSums](), dict[tuple[str, str, int], ComplexArray]()
    for sums in map_chunks(partial(sum_lines, bare, x, factors, H), configurations, home):
        pulls |= {key: pulls.get(key, 0.0) + pull for key, pull in sums.model_error_pull.items()}
        line_sums.append(replace(sums, model_error_pull={}))
    arrays = H[:, :n_x], singular_values, unidentifiable[:n_x], prior_J @ H.T, static_J @ H.T, static_r
    return Sums(tuple(line_sums), *arrays, pulls, fit.n_residuals, fit.problem.dof)


def noise_covariance(sums: Sums) -> tuple[FloatArray, float, float]:
    """Return the covariance (n_x, n_x) of x by measured noise and priors, the expected V, and cost_dof.

    Configurations without measured noise have the noise of their residuals.
    """
    line_sums = sums.line_sums
    meat = sums.prior_J.T @ sums.prior_J + sums.static_J.T @ sums.static_J
    power = float(np.count_nonzero(np.any(sums.prior_J, axis=1)) + len(sums.static_J))
    variance, spread = sum(sums_q.cost for sums_q in line_sums) / max(sums.dof, 1), 2 * power
    for sums_q in line_sums:
        if sums_q.noise is None:
            meat, power = meat + variance * sums_q.rows.T @ sums_q.rows, power + variance * sums_q.n_residuals
            spread += 2 * variance**2 * sums_q.n_residuals
        else:
            meat, power = meat + sums_q.noise, power + sums_q.noise_power
            spread += sums_q.noise_spread
    has_noise = any(sums_q.noise is not None for sums_q in line_sums)
    cost_dof = 2 * power**2 / max(spread, 1e-300) if has_noise else math.nan
    return sums.H.T @ meat @ sums.H, power - float(np.trace(meat)), cost_dof


def sandwich_variance(sums: Sums) -> FloatArray:
    """Return the sandwich variances (n_x,) of x by the residuals, pulls added over configurations at each frequency."""
    line_sums = sums.line_sums
    freq_hz, index = np.unique(np.concatenate([sums_q.freq_hz for sums_q in line_sums]), return_inverse=True)
    pulls = np.zeros((len(freq_hz), len(sums.H)))
    np.add.at(pulls, index, np.concatenate([sums_q.pull for sums_q in line_sums], axis=1).T)
    changes = np.vstack([pulls, sums.static_J * sums.static_r[:, None]]) @ sums.H
    length = correlation_length(
        [sums_q.autocovariance for sums_q in line_sums], sum(sums_q.n_residuals for sums_q in line_sums)
    )
    return np.asarray(length * sums.n_residuals / max(sums.dof, 1) * np.sum(changes**2, axis=0))


def friction_variance(parameters: Parameters, responses: Sequence[Response], is_compensated: bool) -> FloatArray:
    """Return variances (n_x,) of x by errors of the friction compensation and by distortion that no friction explains.

    Relaxing springs of the motors model most of the unexplained distortion.
    """
    has_springs = any(parameter.name.startswith("relaxation_") for parameter in parameters)
    distortion = (RELAXATION_ERROR if has_springs else 1.0) * unexplained_error(parameters, responses)
    return compensation_error(parameters) ** 2 * is_compensated + distortion**2


def model_error_covariance(sums: Sums, cost: float, expected_cost: float, cost_dof: float) -> FloatArray:
    """Return the covariance (n_x, n_x) of x by the model error: one random factor for each element and octave, times s.

    s: the fraction of its power for which V leaves room above the noise and two standard deviations of V.
    """
    shifts = np.stack([*sums.model_error_pulls.values()]) @ sums.H
    power = sum(sums_q.model_error_power for sums_q in sums.line_sums)
    dof = sums.dof if math.isnan(cost_dof) else cost_dof
    margin = cost - expected_cost + 2 * expected_cost * math.sqrt(2 / max(dof, 1.0))
    return (min(max(margin / power, 0.0), 1.0) if power else 0.0) * 0.5 * (shifts.conj().T @ shifts).real


def prior_variance(sums: Sums, nuisance: Sequence[int]) -> tuple[FloatArray, FloatArray]:
    r"""Return variances (n_x,) of x by the tolerances of nuisance parameters, with the present and with unlimited data.

    .. math:: C_\infty = (s A_{data} + P)^{-1} = H^T (s (I - Q) + Q)^{-1} H, \qquad Q = H P H^T, \quad A^{-1} = H^T H

    s = UNLIMITED_DATA.  nuisance: columns of parameters with tolerances; P: their priors. Tolerances scatter from one
    robot model to the next, not between repeated measurements.
    """
    J = sums.prior_J[list(nuisance)]  # in the variables of H, so that Q = J^T J
    q, V = np.linalg.eigh(J.T @ J)
    persistent = np.sum((V.T @ sums.H) ** 2 / (UNLIMITED_DATA * np.maximum(1 - q, 0.0) + q)[:, None], axis=0)
    return np.sum((J @ sums.H) ** 2, axis=0), np.asarray(persistent)


# Relative std of a stiffness, a damping and a viscous friction by the compensation of friction or of gear effects.
# Amplitudes are estimated to 0.5 to 1 % (`nonlinear.variable_projection`); k was within 0.05 %, d within 0.5 %
# (scripts/studies/results.csv).
STIFFNESS_ERROR, FRICTION_ERROR = 2e-4, 1e-2
DAMPING_ERROR = 10 * STIFFNESS_ERROR
# Ratio of the errors by unexplained distortion with and without relaxing springs of motors.
RELAXATION_ERROR = 0.1


def compensation_error(parameters: Parameters) -> FloatArray:
    """Return the std (n_x,) of k, d and friction parameters in x by compensated friction or gear effects."""

    def of(parameter: Parameter) -> float:
        if parameter.is_nuisance or not parameter.log:
            return 0.0
        if parameter.unit in DAMPING_UNITS:
            return FRICTION_ERROR if parameter.stands_for.startswith("f") else DAMPING_ERROR
        return STIFFNESS_ERROR if parameter.unit in ("N*m/rad", "N/m") else 0.0

    return np.array([of(parameter) for parameter in parameters.free])


def unexplained_error(parameters: Parameters, responses: Sequence[Response]) -> FloatArray:
    r"""Return the standard deviation (n_x,) of k and d if no motor's friction explains the measured distortion.

    .. math:: \frac{\delta k}{k} = \sqrt{\frac{2 / \pi}{1 - 2 / \pi}}\;
              \mathrm{median} \frac{\sqrt{M\, (C_{total} - C_{noise})}}{|G|}

    A nonlinearity also changes the best linear approximation, equally in all M realisations and without scatter. The
    factor is the ratio of this change to the distortion of one realisation, for the sign of a Gaussian velocity with
    all lines excited. The error of d and of friction parameters is twice as large.
    """
    relative = [0.0]
    for G in responses:
        if G.total is not None and G.noise is not None and any(note.code == UNEXPLAINED for note in G.notes):
            distortion = (G.total.dof + 1) * np.maximum(G.total.variance - G.noise.variance, 0.0)
            relative.append(float(np.median(np.sqrt(distortion) / np.maximum(np.abs(G.G), 1e-300))))
    error = np.sqrt(2 / (np.pi - 2)) * max(relative)
    of_unit = dict.fromkeys(DAMPING_UNITS, 2.0) | {"N*m/rad": 1.0, "N/m": 1.0}
    return np.array([error * of_unit.get(p.unit, 0.0) * (p.log and not p.is_nuisance) for p in parameters.free])


def inverse_information(R: FloatArray) -> tuple[FloatArray, FloatArray, BoolArray]:
    """Return H (n, n_x), A^-1 = H^T H, singular values, and the parameters that are not identifiable; A = R^T R.

    R (n_x, n_x) instead of A, whose condition number is the square. A direction is identifiable if its scaled singular
    value is above 1e-8 of the largest; a parameter is not if its component in another direction exceeds 1e-3.
    """
    length = np.linalg.norm(R, axis=0)
    length[length == 0] = 1.0
    _, singular_values, Vt = np.linalg.svd(R / length)
    is_reached = singular_values > 1e-8 * max(singular_values[0], 1e-300)
    H = (Vt[is_reached] / singular_values[is_reached, None]) / length
    return H, singular_values, np.any(np.abs(Vt[~is_reached]) > 1e-3, axis=0)
