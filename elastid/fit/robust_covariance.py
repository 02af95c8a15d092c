r"""Robust covariance of the estimate from its scatter over blocks of lines and over configurations (jackknife).

Each configuration has 4 to 24 blocks: bands of equal numbers of lines, twice as long as the correlation length tau of
the configuration's residuals (`correlation_length`). Model errors are equal on neighbouring lines, so single lines are
not independent; blocks longer than the correlation length are.

.. math:: x_{(i)} - x = (A - A_i)^{-1} g_i, \qquad
          \mathrm{var}\, x = t^2 \frac{Q - 1}{Q} \sum_i (x_{(i)} - \bar x)^2, \qquad A_i = J_i^T J_i,\; g_i = J_i^T r_i

where x_(i) is the estimate without configuration i. With g_b the pull of the lines of a block, S_b its covariance under
the measured noise, and n the sum of the ranks of S_b:

.. math:: \mathrm{var}\, x_i = t^2 \frac{B}{B - 1} \sum_b (A^{-1} g_b)_i^2, \qquad
          T = \frac{1}{n - n_x} \sum_b g_b^T S_b^{+} g_b

A model error that parameters absorb does not show in the residuals of one configuration, but each configuration
absorbs it by different values. T is 1 for a correct model, whose blocks differ by noise alone.  t >= 1 accounts for few
configurations or blocks: ratio of the 97.5 % quantiles of Student's t and the normal distribution.
(Efron & Stein 1981, The jackknife estimate of variance; White 1980, Econometrica 48; blocks as clusters, and t, Cameron
& Miller 2015, section VI; T as Cochran 1954, Biometrics 10.)
"""

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from elastid.base.arrays import ComplexArray, FloatArray
from elastid.base.statistics import small_sample_factors
from elastid.fit.problem.frf_residuals import ElasticFit, FrfResiduals
from elastid.fit.problem.least_squares import as_real
from elastid.fit.problem.systematic_errors import Factor, block_with_factors, ratio_errors
from elastid.fit.problem.weights import Weights, vec
from elastid.response import Response


@dataclass(frozen=True)
class RatioSums:
    """Products of the whitened errors V of one configuration, each by one standard deviation of a gear ratio.

    joints (n_j,): input and angle.  pull (n_j, n_x): V^T J.  power (n_j, n_j): V^T V.  slopes (n_j,): V^T r.
    """

    joints: tuple[tuple[str, float], ...]
    pull: FloatArray
    power: FloatArray
    slopes: FloatArray


@dataclass(frozen=True)
class LineSums:
    """Sums of one configuration with F lines over n_x variables z (`sum_lines`), without large arrays.

    rows (n, n_x): rows with the J^T J of its frf.  power (F, n_p): contribution of each line to the
    variances of x (n_p,): [A^-1 A_k A^-1]_ii, A_k = J_k^T J_k.  autocovariance (F,): Re sum r_k^* r_{k+l} of
    its whitened residuals, by lag.  n_residuals: nonzero real residuals.  pull (n_x, F): J_k^T r_k of each line.
    blocks (B, n_x): the pulls summed over bands.  noise (n_x, n_x): the covariance of their sum under the measured
    noise, None where none was.  disagreement: of the bands, and its rank (`sum_blocks`).  noise_power: E|r|^2 under it,
    noise_spread: the variance of sum |r|^2 over noise_power, both having scatter, times noise_power^2; both NaN where
    no noise was measured.  noise_dof: complex degrees of freedom behind the noise of a line, inf where it is known
    exactly or not at all.  model_error_power: sum |r|^2 for an error of alpha |G| in every element.  model_error_pull:
    (output, input, octave) -> J^H r (n_x,) for an error alpha |G| with the same complex factor at all lines of the
    octave. ratios: errors by the gear ratios.
    """

    freq_hz: FloatArray
    rows: FloatArray
    power: FloatArray
    autocovariance: FloatArray
    n_residuals: int
    pull: FloatArray
    blocks: FloatArray
    noise: FloatArray | None
    disagreement: tuple[float, int]
    noise_power: float
    noise_spread: float
    noise_dof: float
    model_error_power: float
    model_error_pull: dict[tuple[str, str, int], ComplexArray]
    ratios: RatioSums

    @property
    def cost(self) -> float:
        """sum |r|^2, the contribution of this configuration to V."""
        return float(self.autocovariance[0])


def triangle(
    fit: ElasticFit, x: FloatArray, factors: Sequence[Factor], chunk: Sequence[tuple[FrfResiduals, Response, Weights]]
) -> FloatArray:
    """Return R (n_x, n_x) of the stacked J = Q R of a chunk of configurations; arguments as `sum_lines`."""
    blocks = (block_with_factors(fit, x, factors, frf, response, frf.mixing)[1:] for frf, response, _ in chunk)
    return np.asarray(np.linalg.qr(np.vstack([np.linalg.qr(_rows(J), mode="r") @ T.T for J, T in blocks]), mode="r"))


def sum_lines(
    fit: ElasticFit, x: FloatArray, factors: Sequence[Factor], H: FloatArray,
    configuration: tuple[FrfResiduals, Response, Weights],
) -> LineSums:  # fmt: skip
    """Return the sums of one configuration at x (n_p,); fit: whose parameters count.

    factors: of systematic errors, which are further columns of J.  H (n_x, n_p): H with A^-1 = H^T H.  The variables
    of the sums are z, with x = H^T z, in which A = 1: sums in x would lose small variances, which differ by factors of
    1e8, for example between a common scale that only the prior determines and ratios.
    """
    frf, response, weights = configuration
    mixing = frf.mixing
    r, J, chain = block_with_factors(fit, x, factors, frf, response, mixing)
    # Only the combinations U^T z change the residuals of this configuration.
    U, product = np.linalg.qr(H @ chain)
    J = np.tensordot(product, J, axes=1)
    T, flat = _whitening(frf, mixing), vec(J)
    errors = T * vec(weights.model_error * response.G)[:, None, :]
    # Errors common to n neighbouring lines multiply the variance of a sum over lines by n.
    correlated_lines, S, power, spread, dof = response.correlated_lines, None, math.nan, math.nan, math.inf
    noise = weights.noise_covariance()
    if noise is not None and weights.noise is not None:
        S = T @ noise @ T.mT.conj()
        power = float(np.einsum("faa->", S).real)
        # (1 + repeats) sum_k tr(S_k^2), S = T C~ T^H: variance by circular errors and by their sample covariance.
        is_exact = weights.noise.smooth is weights.noise.measured
        smooth = S if is_exact else T @ weights.noise.smooth.full() @ T.mT.conj()
        dof = weights.noise.measured.dof
        lines_in_power = max(correlated_lines, weights.noise.measured.averaging_lines)
        spread = lines_in_power * ((1 + weights.noise.repeats) * float(np.sum(np.abs(smooth) ** 2)))
        S *= correlated_lines
    rows = _rows(J)
    power_of_lines = ((rows @ (U.T @ H[:, : len(x)])) ** 2).reshape(len(r), -1, len(x)).sum(axis=1)
    residual, n_residuals = r.reshape(len(r), -1), 2 * int(np.count_nonzero(r))
    pull = np.einsum("pfab,fab->pf", J.conj(), r).real
    lags = autocovariance(residual)
    blocks, scatter, statistic = sum_blocks(pull, flat, S, correlation_length([lags], n_residuals))
    model_error_pull = {key: U @ sums for key, sums in _coherent_gradients(response, flat, errors).items()}
    of_ratios = ratio_errors(frf, response, frf.theta(fit.parameters, x), mixing)
    error_sums = float(np.sum(np.abs(errors) ** 2)), model_error_pull, _sum_ratios(of_ratios, response, r, J, U)
    # In z the information of a configuration is at most 1: squaring it loses no precision.
    values, vectors = np.linalg.eigh(rows.T @ rows)
    by_line = response.freq_hz, np.sqrt(np.maximum(values, 0.0))[:, None] * (U @ vectors).T, power_of_lines
    of_z = U @ pull, blocks @ U.T, None if scatter is None else U @ scatter @ U.T
    return LineSums(*by_line, lags, n_residuals, *of_z, statistic, power, spread, dof, *error_sums)


def _sum_ratios(
    errors: dict[str, ComplexArray], response: Response, r: ComplexArray, J: ComplexArray, U: FloatArray
) -> RatioSums:
    angles = response.configuration.angles
    V, of_all = as_real(np.reshape([*errors.values()], (-1, *r.shape))), len(angles) == len(response.inputs)
    joints = tuple((name, angles[response.inputs.index(name)] if of_all else math.nan) for name in errors)
    rows = V.reshape(len(errors), 2 * r.size)
    return RatioSums(joints, rows @ _rows(J) @ U.T, rows @ rows.T, rows @ as_real(r).ravel())


def _rows(J: ComplexArray) -> FloatArray:
    """Return J (n_x, F, n_y, n_u) as real rows (2 N, n_x)."""
    return as_real(J).reshape(len(J), -1).T


def autocovariance(residual: ComplexArray) -> FloatArray:
    """Return Re sum_k r_k^* r_{k+l} (F,) of residuals (F, n), l = 0 ... F - 1."""
    F = len(residual)
    return np.fft.ifft(np.sum(np.abs(np.fft.fft(residual, 2 * F, axis=0)) ** 2, axis=1))[:F].real


def correlation_length(autocovariances: Sequence[FloatArray], n_residuals: int) -> float:
    r"""Return correlation time tau of the whitened residuals, pooled over configurations with n_residuals real non-zero
    values; 1 if white.

    .. math:: \tau = 1 + 2 \sum_{l=1}^{L} \rho(l), \qquad \rho(l) = \mathrm{Re} \sum_k r_k^* r_{k+l} / \sum_k |r_k|^2

    L is the last lag before rho falls to chance, at most a quarter of the lines.
    """
    power = sum(float(rho_q[0]) for rho_q in autocovariances if len(rho_q))
    longest = max((len(rho_q) for rho_q in autocovariances), default=0) // 4
    tau = 1.0
    for lag in range(1, longest + 1):
        rho = sum(float(rho_q[lag]) for rho_q in autocovariances if lag < len(rho_q)) / max(power, 1e-300)
        if rho < np.sqrt(4 / max(n_residuals, 1)):  # two standard deviations of rho for white residuals
            break
        tau += 2 * rho
    return tau


def _whitening(frf: FrfResiduals, mixing: ComplexArray | None) -> ComplexArray:
    """Return T (F, m, m), vec column-major: from errors of Ghat to whitened residuals."""
    t = vec(frf.error_gain)
    if mixing is None:
        return np.asarray(t[:, :, None] * np.eye(t.shape[1]))
    n_y, n_u = frf.measured.shape[1:]
    column_by_column = np.arange(n_y * n_u).reshape(n_y, n_u).T.ravel()
    return np.asarray(mixing[:, column_by_column[:, None], column_by_column] * t[:, None, :])


def _coherent_gradients(
    response: Response, J: ComplexArray, errors: ComplexArray
) -> dict[tuple[str, str, int], ComplexArray]:
    """Return gradients J^H e (n,) of whitened errors e (F, m, m) for each element, summed over lines by octave.

    J (n, F, m): derivatives; vec column-major.
    """
    lowest = response.freq_hz[response.freq_hz > 0].min()
    octave = np.floor(np.log2(np.maximum(response.freq_hz, lowest) / lowest)).astype(int)
    sums = {
        int(o): J[:, octave == o].reshape(len(J), -1).conj() @ errors[octave == o].reshape(-1, errors.shape[2])
        for o in np.unique(octave)
    }
    return {
        (output, input_, o): pulls[:, i + j * len(response.outputs)]
        for o, pulls in sums.items()
        for i, output in enumerate(response.outputs)
        for j, input_ in enumerate(response.inputs)
    }


MIN_BANDS, MAX_BANDS = 4, 24


def bands(n_lines: int, length: float) -> tuple[slice, ...]:
    """Return the bands of equal numbers of lines by the correlation length of the residuals, in lines.

    >>> bands(60, 7.0)
    (slice(0, 15, None), slice(15, 30, None), slice(30, 45, None), slice(45, 60, None))
    """
    count = int(np.clip(n_lines / (2 * length), MIN_BANDS, MAX_BANDS))
    edges = np.unique(np.linspace(0, n_lines, count + 1).round().astype(int))
    return tuple(slice(int(low), int(high)) for low, high in pairwise(edges))


def sum_blocks(
    pull: FloatArray, J: ComplexArray, S: ComplexArray | None, length: float
) -> tuple[FloatArray, FloatArray | None, tuple[float, int]]:
    """Return the sums of one configuration: pulls g_b (B, n_x), the S_b, and sum g_b^T S_b^+ g_b with the ranks of S_b.

    pull (n_x, F): J_k^T r_k of each line.  J (n_x, F, m), S (F, m, m): derivatives and covariance of its whitened
    residuals.  length: their correlation length, in lines.
    """
    slices = bands(J.shape[1], length)
    pulls, scatter, total, rank = np.array([pull[:, band].sum(axis=1) for band in slices]), np.zeros(()), 0.0, 0
    if S is None:
        return pulls, None, (total, rank)
    for band, g in zip(slices, pulls, strict=True):
        SJ = S[band] @ J[:, band].transpose(1, 2, 0)
        noise = 0.5 * (J[:, band].reshape(len(J), -1).conj() @ SJ.reshape(-1, len(J))).real
        values, vectors = np.linalg.eigh(noise)
        positive = values > 1e-9 * max(float(values[-1]), 1e-300)
        total += float(np.sum((vectors[:, positive].T @ g) ** 2 / values[positive]))
        scatter, rank = scatter + noise, rank + int(np.count_nonzero(positive))
    return pulls, scatter, (total, rank)


def jackknife_variance(line_sums: Sequence[LineSums], H: FloatArray) -> FloatArray:
    """Return variances (n_p,) of x = H^T z, zero for fewer than three configurations.

    H (n_x, n_p): H, with which J^T J of all, priors included, is 1 in the variables z of the sums.
    """
    Q = len(line_sums)
    if Q < 3:
        return np.zeros(H.shape[1])
    changes = np.array([_change_without(sums) for sums in line_sums]) @ H
    t = small_sample_factors(Q - 1)
    return np.asarray(t**2 * (Q - 1) / Q * np.sum((changes - changes.mean(axis=0)) ** 2, axis=0))


def _change_without(sums: LineSums) -> FloatArray:
    """Return the change of z (n_x,) without a configuration, in directions that the others determine."""
    values, vectors = np.linalg.eigh(np.eye(len(sums.pull)) - sums.rows.T @ sums.rows)
    is_reached = values > 1e-10  # other directions are determined by this configuration alone
    return np.asarray(
        vectors[:, is_reached] @ ((vectors[:, is_reached].T @ sums.pull.sum(axis=1)) / values[is_reached])
    )


def block_variance(blocks: Sequence[FloatArray], H: FloatArray) -> FloatArray:
    """Return variances (n_p,) of x = H^T z by the scatter of the pulls of all blocks; zero for fewer than two."""
    changes = np.concatenate(blocks) @ H
    n = int(np.count_nonzero(np.any(changes != 0, axis=1)))
    if n < 2:
        return np.zeros(H.shape[1])
    return np.asarray(small_sample_factors(n - 1) ** 2 * n / (n - 1) * np.sum(changes**2, axis=0))


def disagreement(of_each: Iterable[tuple[float, int]], n_x: int) -> float:
    """Return T from the disagreement of each configuration (`sum_blocks`); NaN with at most n_x blocks."""
    totals, ranks = zip(*of_each, strict=True)
    rank = sum(ranks) - n_x
    return sum(totals) / rank if rank > 0 else math.nan
