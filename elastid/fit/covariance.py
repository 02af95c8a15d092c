r"""Covariance of the estimate by measured noise, residuals, configurations that disagree and declared model error.

Around the optimum the estimate follows the data, dx = A^-1 sum_k g_k, with A = J^T J and g_k = J_k^T r_k the pull of
line k. Each variance is the largest of the first three estimates, plus the last:

.. math:: \text{noise: } A^{-1} \Big[ \tfrac12 \mathrm{Re} \sum_k J_k^H S_k J_k \Big] A^{-1}, \qquad
          \text{residuals: } \mathrm{var}\, x_i = \tau \tfrac{N}{N - n_x} \sum_k (A^{-1} g_k)_i^2, \qquad
          \text{floor: } A^{-1} \Big[ \tfrac{s}{2} \mathrm{Re} \sum_o h_o h_o^H \Big] A^{-1}

- noise: S_k is the measured covariance in whitened residuals, correlations between elements included. With
  inverse-variance weights and uncorrelated elements this is A^-1 (Cramer-Rao). Of few lines, each measured few times,
  it is itself uncertain: widened to Student's quantile (`noise_dof`).
- residuals: noise and model error. The pulls of one frequency, in all elements and configurations, are summed up before
  they are squared, since a wrong model errs in all of them together. tau >= 1 is the correlation length of the
  residuals over neighbouring lines.
- configurations, blocks: where V exceeds what the noise explains, the model is in error, and the parameters absorb a
  different part of it in each configuration and band: the variance is at least that of the blocks, and from three
  configurations on at least that of their jackknife (conservative).
- systematic errors of given size (`problem.systematic_errors`) are further unknowns c with a prior.
- ratios of gears that differ from angle to angle (`gear_ratios`).
- friction taken out of the torques (`taken_out_error`): what its shapes and levels leave in every configuration alike.
- floor: the model error alpha |G| that the study declares or the residuals show. Such an error is the same on
  neighbouring lines and in all configurations; it counts as one random factor for each element and octave, with pull
  h_o. s <= 1 limits it to the power that V leaves room for: 0 for alpha = 0, small where the residuals are far below
  the floor.

The share of the variance of x_i that the weighted residuals of configuration c, or of one line, contribute is

.. math:: s_{ci} = \frac{[A^{-1} A_c A^{-1}]_{ii}}{[A^{-1}]_{ii}}, \qquad A = \sum_c A_c, \quad \sum_c s_{ci} = 1

Without a floor and with an exact model noise and residuals agree and 95 % intervals hold the truth 95 to 97 % of the
time. A model error that the parameters absorb equally in all configurations does not show; only the floor covers it.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from elastid.base.arrays import BoolArray, ComplexArray, FloatArray, frozen_value, quotient
from elastid.base.execution import Execution
from elastid.base.statistics import small_sample_factors
from elastid.fit.gear_ratios import RatioScatter, scatter_of_ratios
from elastid.fit.problem.frf_residuals import ElasticFit, chunked, each_at_home
from elastid.fit.problem.systematic_errors import find_factors
from elastid.fit.problem.weights import Weights
from elastid.fit.result import is_in_error
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


def information_shares(
    power: Sequence[FloatArray], freq_hz: Sequence[FloatArray], by_loads: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Share (Q, n_x) of each configuration, and the band (n_x, 2) of the middle half of the responses' information.

    power: [A^-1 A_k A^-1]_ii (F, n_x) of the lines freq_hz (F,) of each.  by_loads (n_x,): the same of load
    tests, whose share is the rest.
    """
    sums = [np.sum(lines, axis=0) for lines in power]
    total = np.sum(sums, axis=0)
    total[total == 0] = np.nan
    every = np.concatenate(freq_hz)
    order = np.argsort(every, kind="stable")
    rising = np.cumsum(np.concatenate(power)[order], axis=0) / total
    columns = np.nan_to_num(rising.T, nan=1.0)
    places = np.array([np.searchsorted(column, (0.25, 0.75)) for column in columns])
    band = every[order][np.minimum(places, len(every) - 1)]
    return np.array([part / (total + by_loads) for part in sums]), band


def noise_dof(power: Sequence[FloatArray], dof: Sequence[float], by_loads: FloatArray) -> FloatArray:
    """Real degrees of freedom (n_x,) behind each variance by the measured noise, whose lines scatter independently.

    By Satterthwaite's rule, the elements of a line taken as one: errors whitened, a line of p_k of the variance with
    nu complex degrees of freedom leaves 2 (sum p_k)^2 / sum (p_k^2 / nu); by_loads, of load tests, has all.
    power, by_loads: of `information_shares`.  dof: nu of each configuration.
    """
    total, spread = by_loads, np.zeros(len(by_loads))
    for lines, nu in zip(power, dof, strict=True):
        total, spread = total + lines.sum(axis=0), spread + np.sum(lines**2, axis=0) / nu
    return quotient(2 * total**2, spread, np.inf)


@frozen_value
class Uncertainty:
    """covariance (n_x, n_x) of x, inf where unreached; singular_values of J with columns scaled to unit length.

    unreached (n_x,): parameters in a direction that the data do not reach.  expected_cost: V by the noise alone;
    cost_dof: 2 / cost_dof is the relative variance of V over it, both having scatter; NaN where no noise was measured.
    costs (Q,): V of each configuration; power: of each, what its lines contribute to the variances (F, n_x).
    information_fraction (Q, n_x): of each configuration; information_band_hz (n_x, 2): the middle half of it.
    disagreement: T of the blocks, 1 for a true model (`blocks`).  shift (n_x,): the deviation by the blocks over that
    by measured noise, ratios of gears and declared floor alone.
    averaging_fraction (n_x,): of the variance: averages out over repeated measurements, 1 without tolerances and
    model error.
    persistent_fraction (n_x,): of the variance, by errors of the robot model that no data reduce, else 0.  ratios: of
    the gears.
    """

    covariance: FloatArray
    singular_values: FloatArray
    unreached: BoolArray
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


# Times the data of a measurement that counts as one without end: noise a hundredth.
ENDLESS = 1e4


def estimate_uncertainty(
    fit: ElasticFit, responses: Sequence[Response], weights: Sequence[Weights], x: FloatArray,
    execution: Execution | None = None, is_forecast: bool = False, is_taken_out: bool = False,
) -> Uncertainty:  # fmt: skip
    """Covariance of x (n_x,), the optimum of `fit`. is_forecast: expected covariance for responses without noise.

    Readings of load tests have the covariance that is stated.  is_taken_out: friction of motors is, of the torques.
    """
    sums = sum_up(fit, responses, weights, x, execution or Execution())
    parts, half, unreached = sums.parts, sums.half, sums.unreached
    noise, expected_cost, cost_dof = noise_covariance(sums)
    costs = np.array([part.cost for part in parts])
    cost = expected_cost if is_forecast else float(costs.sum() + sums.static_r @ sums.static_r)
    residuals, blocks = residual_variance(sums), block_variance([part.blocks for part in parts], half)
    is_excess = is_in_error(cost, expected_cost, cost_dof)
    if is_excess:
        residuals = np.maximum.reduce([residuals, blocks, jackknife_variance(parts, half)])
    floor = floor_covariance(sums, cost, expected_cost, cost_dof)
    together = max((response.correlated_lines for response in responses), default=1.0)
    friction = friction_variance(fit.parameters, responses, is_taken_out)
    scatter = scatter_of_ratios(parts, half, math.nan if is_forecast else cost, expected_cost, together, is_excess)
    ratios = scatter.covariance
    total = np.maximum(np.diag(noise + ratios) + friction, 1e-300)
    of_file, lasting = file_variance(sums, [i for i, p in enumerate(fit.parameters.free) if p.is_nuisance])
    repeated = np.maximum(np.diag(noise) - of_file, 0.0)
    by_loads = np.sum((sums.static_J @ half) ** 2, axis=0)
    power = tuple(part.power[:, : len(x)] for part in parts)
    fraction = quotient(repeated, np.diag(noise), 1.0)
    known_dof = noise_dof(power, [part.noise_dof for part in parts], by_loads) / np.maximum(fraction, 1e-6) ** 2
    widened = small_sample_factors(known_dof)
    covariance = _larger(noise * np.outer(widened, widened), residuals, half) + floor + ratios + np.diag(friction)
    # Residuals above the noise, and the model error, are equal in repeated measurements.
    stated = np.diag(noise) * widened**2 + np.diag(ratios) + friction if is_excess else np.diag(covariance - floor)
    known = np.minimum(stated / np.maximum(np.diag(covariance), 1e-300), 1.0) / total
    covariance[unreached] = covariance[:, unreached] = np.nan
    covariance[unreached, unreached] = np.inf
    share, band_hz = information_shares(power, [part.freq_hz for part in parts], by_loads)
    return Uncertainty(
        covariance=covariance, singular_values=sums.singular_values, unreached=unreached,
        expected_cost=expected_cost, cost_dof=cost_dof, information_fraction=share, information_band_hz=band_hz,
        disagreement=disagreement([part.disagreement for part in parts], len(half)),
        shift=np.where(unreached, 0.0, np.sqrt(blocks / (total + np.diag(floor)))),
        averaging_fraction=repeated * known,
        persistent_fraction=(np.minimum(lasting, of_file) + np.diag(ratios)) * known,
        costs=costs, power=power, ratios=scatter,
    )  # fmt: skip


@dataclass(frozen=True, eq=False)
class Sums:
    """Sums of all configurations in the variables z of `sum_lines`, x = H^T z, and the rows beside the responses.

    half (n, n_x): H without the columns of shared factors.  prior_J (n_p, n), static_J (m, n): rows of the priors 1 / s
    (0 without one) and of load tests, whose residuals are static_r (m,).  floor_pulls: summed `LineSums.floor_pull`.
    n_residuals: real ones of the responses and load tests; dof: less the parameters, with the priors.
    """

    parts: tuple[LineSums, ...]
    half: FloatArray
    singular_values: FloatArray
    unreached: BoolArray
    prior_J: FloatArray
    static_J: FloatArray
    static_r: FloatArray
    floor_pulls: Mapping[tuple[str, str, int], ComplexArray]
    n_residuals: int
    dof: int


def sum_up(
    fit: ElasticFit, responses: Sequence[Response], weights: Sequence[Weights], x: FloatArray, home: Execution
) -> Sums:
    """The sums at x (n_x,), the optimum of `fit`."""
    factors, n_x = find_factors(responses), len(x)
    bare = replace(fit, parts=(), loads=None)  # to other processes each chunk goes by itself
    static_r, static_J = fit.static(x)
    static_J = np.pad(static_J, ((0, 0), (0, len(factors))))  # no factor of the responses moves load tests
    prior_J = np.diag(np.concatenate([fit.prior_slopes, np.ones(len(factors))]))
    configurations = list(zip(fit.parts, responses, weights, strict=True))
    R = np.vstack([prior_J, static_J])
    for block in home.at_home(partial(triangle, bare, x, factors), chunked(configurations)):  # R of the stacked J = Q R
        R = np.asarray(np.linalg.qr(np.vstack([R, block]), mode="r"))
    half, singular_values, unreached = inverse_information(R)
    parts, pulls = list[LineSums](), dict[tuple[str, str, int], ComplexArray]()
    for sums in each_at_home(partial(sum_lines, bare, x, factors, half), configurations, home):
        pulls |= {key: pulls.get(key, 0.0) + pull for key, pull in sums.floor_pull.items()}
        parts.append(replace(sums, floor_pull={}))
    known = half[:, :n_x], singular_values, unreached[:n_x], prior_J @ half.T, static_J @ half.T, static_r
    return Sums(tuple(parts), *known, pulls, fit.n_residuals, fit.problem.dof)


def noise_covariance(sums: Sums) -> tuple[FloatArray, float, float]:
    """Covariance (n_x, n_x) of x by the measured noise and the priors, the V that they lead to, and cost_dof.

    Where no noise was measured the residuals are taken for it.
    """
    parts = sums.parts
    meat = sums.prior_J.T @ sums.prior_J + sums.static_J.T @ sums.static_J
    power = float(np.count_nonzero(np.any(sums.prior_J, axis=1)) + len(sums.static_J))
    level, spread = sum(part.cost for part in parts) / max(sums.dof, 1), 2 * power
    for part in parts:
        if part.noise is None:
            meat, power = meat + level * part.rows.T @ part.rows, power + level * part.n_residuals
            spread += 2 * level**2 * part.n_residuals
        else:
            meat, power = meat + part.noise, power + part.noise_power
            spread += part.noise_spread
    is_known = any(part.noise is not None for part in parts)
    cost_dof = 2 * power**2 / max(spread, 1e-300) if is_known else math.nan
    return sums.half.T @ meat @ sums.half, power - float(np.trace(meat)), cost_dof


def residual_variance(sums: Sums) -> FloatArray:
    """Variances (n_x,) of x by the pulls of the residuals, summed over configurations at equal frequencies."""
    parts = sums.parts
    freq_hz, place = np.unique(np.concatenate([part.freq_hz for part in parts]), return_inverse=True)
    pulls = np.zeros((len(freq_hz), len(sums.half)))
    np.add.at(pulls, place, np.concatenate([part.pull for part in parts], axis=1).T)
    moved = np.vstack([pulls, sums.static_J * sums.static_r[:, None]]) @ sums.half
    length = correlation_length([part.autocovariance for part in parts], sum(part.n_residuals for part in parts))
    return np.asarray(length * sums.n_residuals / max(sums.dof, 1) * np.sum(moved**2, axis=0))


def friction_variance(parameters: Parameters, responses: Sequence[Response], is_taken_out: bool) -> FloatArray:
    """Variances (n_x,) of x by errors of friction compensation, and by distortion that no friction explains."""
    left = 1.0 if not any(p.name.startswith("relaxation_") for p in parameters) else LEFT_BY_SPRINGS
    return taken_out_error(parameters) ** 2 * is_taken_out + (left * unexplained_error(parameters, responses)) ** 2


def floor_covariance(sums: Sums, cost: float, expected_cost: float, cost_dof: float) -> FloatArray:
    """Covariance (n_x, n_x) of x by the floor, each element off by one random factor an octave, times s.

    s: the share of its power for which V leaves room above the noise and two standard deviations of V.
    """
    shifts = np.stack([*sums.floor_pulls.values()]) @ sums.half
    power = sum(part.floor_power for part in sums.parts)
    dof = sums.dof if math.isnan(cost_dof) else cost_dof
    room = cost - expected_cost + 2 * expected_cost * math.sqrt(2 / max(dof, 1.0))
    share = min(max(room / power, 0.0), 1.0) if power else 0.0
    return share * 0.5 * (shifts.conj().T @ shifts).real


def file_variance(sums: Sums, of_file: Sequence[int]) -> tuple[FloatArray, FloatArray]:
    """Variances (n_x,) of x by the tolerances of the numbers at `of_file`, and their remainder for endless data.

    Tolerances scatter from file to file, not from measurement to measurement.
    """
    J = sums.prior_J[list(of_file)]
    return np.sum((J @ sums.half) ** 2, axis=0), variance_left(J, sums.half)


# Relative std of a stiffness, a damping and a viscous friction by the compensation of friction or of gear effects.
# Amplitudes are estimated to 0.5 to 1 % (`nonlinear.variable_projection`); k was within 0.05 %, d within 0.5 %
# (scripts/studies/results.csv).
STIFFNESS_ERROR, DAMPING_ERROR, FRICTION_ERROR = 2e-4, 2e-3, 1e-2
# Of the error by unexplained distortion, the share that relaxing springs of motors leave.
LEFT_BY_SPRINGS = 0.1


def taken_out_error(parameters: Parameters) -> FloatArray:
    """Standard deviation (n_x,) of k, d and friction parameters in x due to compensated friction or gear effects."""

    def of(parameter: Parameter) -> float:
        if parameter.is_nuisance or not parameter.log:
            return 0.0
        if parameter.unit in DAMPING_UNITS:
            return FRICTION_ERROR if parameter.stands_for.startswith("f") else DAMPING_ERROR
        return STIFFNESS_ERROR if parameter.unit in ("N*m/rad", "N/m") else 0.0

    return np.array([of(parameter) for parameter in parameters.free])


def unexplained_error(parameters: Parameters, responses: Sequence[Response]) -> FloatArray:
    r"""Standard deviation (n_x,) of k and d where distortion is left that no motor's friction explains.

    .. math:: \frac{\delta k}{k} = \sqrt{\frac{2 / \pi}{1 - 2 / \pi}}\;
              \mathrm{median} \frac{\sqrt{M\, (C_{total} - C_{noise})}}{|G|}

    What distorts has a linear part, too, which all realisations share and no scatter shows: of a sign in a normal
    motion it is that many times the distortion of one of M realisations, where all lines are excited. Twice as much of
    d and of frictions.
    """
    shares = [0.0]
    for G in responses:
        if G.total is not None and G.noise is not None and any(note.code == UNEXPLAINED for note in G.notes):
            distortion = (G.total.dof + 1) * np.maximum(G.total.variance - G.noise.variance, 0.0)
            shares.append(float(np.median(np.sqrt(distortion) / np.maximum(np.abs(G.G), 1e-300))))
    share = np.sqrt(2 / (np.pi - 2)) * max(shares)
    of_unit = dict.fromkeys(DAMPING_UNITS, 2.0) | {"N*m/rad": 1.0, "N/m": 1.0}
    return np.array([share * of_unit.get(p.unit, 0.0) * (p.log and not p.is_nuisance) for p in parameters.free])


def variance_left(of_file_J: FloatArray, half: FloatArray) -> FloatArray:
    r"""Variance (n_x,) that the file leaves where its numbers alone do not get better: the data s = ENDLESS times.

    .. math:: C_\infty = (s A_{data} + P)^{-1} = H^T (s (I - Q) + Q)^{-1} H, \qquad Q = H P H^T, \quad A^{-1} = H^T H

    of_file_J: rows of the file's priors, P = J^T J, in the variables of H, so that Q = of_file_J^T of_file_J.
    """
    q, V = np.linalg.eigh(of_file_J.T @ of_file_J)
    return np.asarray(np.sum((V.T @ half) ** 2 / (ENDLESS * np.maximum(1 - q, 0.0) + q)[:, None], axis=0))


def inverse_information(R: FloatArray) -> tuple[FloatArray, FloatArray, BoolArray]:
    """H (n, n_x), singular values, and which parameters lie outside the directions that the data reach.

    A^-1 = H^T H, A = R^T R, over the n directions that they reach.

    The data do not reach directions whose scaled singular value is below 1e-8 of the largest; a parameter lies outside
    if its part in one of these, of length one, exceeds 1e-3.  From R and not from A, whose condition number is the
    square.
    """
    length = np.linalg.norm(R, axis=0)
    length[length == 0] = 1.0
    _, singular_values, Vt = np.linalg.svd(R / length)
    reached = singular_values > 1e-8 * max(singular_values[0], 1e-300)
    half = (Vt[reached] / singular_values[reached, None]) / length
    return half, singular_values, np.any(np.abs(Vt[~reached]) > 1e-3, axis=0)


def _larger(noise: FloatArray, residuals: FloatArray, half: FloatArray) -> FloatArray:
    """Larger variances (n_x,) of noise and residuals, with the correlations of the noise (by default of A^-1)."""
    variance = np.diag(noise)
    shape = noise if np.all(variance > 0) else half.T @ half
    wanted, deviation = np.sqrt(np.maximum(variance, residuals)), np.sqrt(np.diag(shape))
    scale = quotient(wanted, deviation)
    return shape * np.outer(scale, scale)
