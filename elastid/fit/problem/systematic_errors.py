r"""Systematic errors of measured responses as nuisance parameters with a prior, for example uncompensated friction.

.. math:: \hat G_q = G_q(x) + \sum_b (c_b\, \delta G_{bq} + c_{bq}\, \delta G'_{bq}) + noise, \qquad
          c_b, c_{bq} + \bar c_b \sim N(0, 1)

for motor b in configuration q, with factors c_b common to all configurations, and factors c_bq of configuration q with
zero mean over configurations. The factors are estimated together with x, which is generalised least squares with the
covariance of these errors. delta G, delta G': `Response.bias`, evaluated with the modelled response at the end of the
fit. With the measured response, delta G = G e_j z e_j^T G and the factors would be correlated with its noise, which
biases them by many times the noise of a few realisations.
"""

from collections import Counter
from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from typing import TypeAlias

import numpy as np
from scipy.linalg import block_diag

from elastid.base.arrays import ComplexArray, FloatArray, laplace_variable
from elastid.fit.problem.frf_residuals import ElasticFit, FrfResiduals, apply_mixing, map_chunks
from elastid.fit.problem.least_squares import as_real
from elastid.linear.linear_model import LinearModel
from elastid.record import MOTION_ORDER
from elastid.response import Response

Factor: TypeAlias = tuple[str, int, str]  # input, index and configuration, "" for all configurations


def find_factors(responses: Sequence[Response]) -> tuple[Factor, ...]:
    """Return bias factors of all responses: per biased motor, one shared factor and one per configuration."""
    factors: dict[Factor, None] = {}
    for response in responses:
        for i, errors in enumerate(() if response.bias is None else response.bias):
            of_all = response.bias is not None and i < len(response.bias) - 1
            key = (i, "") if of_all else (-1, response.configuration.name)
            names = (name for name, error in zip(response.inputs, errors, strict=True) if np.any(error))
            factors |= {(name, *key): None for name in names}
    return tuple(factors)


def ratio_errors(
    frf: FrfResiduals, response: Response, theta: FloatArray, mixing: ComplexArray | None
) -> dict[str, ComplexArray]:
    r"""Return whitened errors (F, n_y, n_u) of a response for one standard deviation of each gear ratio, by its input.

    .. math:: \delta G = \epsilon_j (e_j e_j^T G + G\, e_j e_j^T - 2\, G\, e_j\, s^{-o} (J_j s^2 + f_j s)\, e_j^T G)

    J_j, f_j: link-side inertia and friction of the motor at theta (n_theta,), which depend on the stated ratio.  o:
    order of the derivative of the motion.  These errors widen intervals and are not estimated (`fit.gear_ratios`).
    """
    errors, s, model = dict[str, ComplexArray](), laplace_variable(response.freq_hz), frf.kernel.model
    delay_factor = np.exp(s * sum(model.number(theta, name, absent=0.0) for name in ("delay", "delay_u")))
    G = frf.kernel.response(theta)  # not measured, whose noise is correlated with the residuals
    for j, std in enumerate(response.ratio_std.tolist()):
        if std > 0 and response.inputs[j] in response.outputs:
            i, error = response.outputs.index(response.inputs[j]), np.zeros_like(G)
            error[:, i] += std * G[:, i]
            error[:, :, j] += std * G[:, :, j]
            impedance = _motor_impedance(model, theta, j, s) * delay_factor * s ** -MOTION_ORDER[response.quantity]
            error -= 2 * std * impedance[:, None, None] * G[:, :, j, None] * G[:, i, None, :]
            errors[response.inputs[j]] = frf.slopes(G, -error, mixing)
    return errors


def _motor_impedance(model: LinearModel, theta: FloatArray, j: int, s: ComplexArray) -> ComplexArray:
    """Return torque over angle (F,) of a motor with its viscous friction and the inertia of its coordinate."""
    joint, b = model.inputs[j].removeprefix("motor "), model.B[:, j]
    inertia, friction = (model.slopes.get(f"{name}_{joint}") for name in ("Jm", "fm"))
    at, f = int(np.argmax(np.abs(b))), 0.0
    J = 0.0 if np.any(np.delete(model.M[at], at)) else float(b @ model.M @ b)
    if inertia is not None and inertia.M is not None:
        J = model.number(theta, f"Jm_{joint}", absent=0.0) * float(b @ inertia.M @ b)
    if friction is not None and friction.D is not None:
        f = model.number(theta, f"fm_{joint}", absent=0.0) * float(b @ friction.D @ b)
    return J * s**2 + f * s


def unit_bias(response: Response) -> ComplexArray:
    """Return the errors delta G, delta G' (n_e, F, n_y, n_u) of one response for unit factors."""
    if response.bias is None:
        return np.zeros((0, *response.G.shape), complex)
    return np.reshape(response.bias, (-1, *response.G.shape))


def contrasts_of(response: Response, factors: Sequence[Factor]) -> FloatArray:
    """Return C (n_b, n_e) of one response: d Ghat / d c = C delta G; rows of other responses' factors are 0."""
    n, n_u = (0, 0) if response.bias is None else response.bias.shape[:2]
    contrasts, counts = np.zeros((len(factors), n, n_u)), Counter(name for name, _, is_known in factors if is_known)
    for b, (name, i, configuration) in enumerate(factors):
        if name not in response.inputs or i >= n - 1:
            continue
        contrast = (configuration == response.configuration.name) - 1 / counts[name] if configuration else 1.0
        contrasts[b, i, response.inputs.index(name)] = contrast
    return contrasts.reshape(len(factors), n * n_u)


def with_modelled_bias(response: Response, G: ComplexArray) -> Response:
    """Return the response with its systematic errors evaluated for the modelled response G (F, n_y, n_u).

    Unchanged for fewer outputs than inputs.
    """
    _, n_y, n_u = G.shape
    if response.bias is None or n_y < n_u:
        return response
    inverse = np.linalg.pinv(response.G)
    return replace(response, bias=G @ (inverse @ response.bias) @ (inverse @ G))


def block_with_factors(
    fit: ElasticFit, x: FloatArray, factors: Sequence[Factor], frf: FrfResiduals, response: Response,
    mixing: ComplexArray | None,
) -> tuple[ComplexArray, ComplexArray, FloatArray]:  # fmt: skip
    """Return whitened r (F, n_y, n_u), slopes J (n, F, n_y, n_u) and T (n_x + n_b, n): dr / d(x, c) = T J.

    fit: with the parameters.  mixing: `FrfResiduals.mixing`.
    n is much smaller than n_x + n_b, because the factors of other configurations act only through their mean.
    """
    (r, slopes), C = fit.block(frf, x, mixing), contrasts_of(response, factors)
    if not len(factors):
        return r, slopes, np.eye(len(slopes))
    J = np.concatenate([slopes, -apply_mixing(mixing, unit_bias(response) * frf.error_gain)])
    return r, J, block_diag(np.eye(len(slopes)), C)


def next_factors(fit: ElasticFit, responses: Sequence[Response], x: FloatArray, c: FloatArray) -> FloatArray:
    """Return c (n_b,) after one joint Gauss-Newton step in x and c. fit: responses corrected for c."""
    factors = find_factors(responses)
    distance, slope = fit.parameters.priors(x)
    A, g = np.diag(np.concatenate([slope**2, np.ones(len(c))])), np.concatenate([slope * distance, c])
    r_static, J_static = fit.static(x)
    A[: len(x), : len(x)] += J_static.T @ J_static
    g[: len(x)] += J_static.T @ r_static
    sums = partial(_sums, replace(fit, frfs=(), loads=None), x, factors)
    for A_q, g_q, T in map_chunks(sums, list(zip(fit.frfs, responses, strict=True)), fit.home):
        A, g = A + T @ A_q @ T.T, g + T @ g_q
    length = np.sqrt(np.maximum(np.diag(A), 1e-300))
    step = np.linalg.lstsq(A / np.outer(length, length), -g / length, rcond=1e-12)[0] / length
    return np.asarray(c + step[len(x) :])


def _sums(
    fit: ElasticFit, x: FloatArray, factors: Sequence[Factor], pair: tuple[FrfResiduals, Response]
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return J^T J, J^T r and T (`block_with_factors`) of one configuration."""
    r, J, T = block_with_factors(fit, x, factors, *pair, pair[0].mixing)
    rows = as_real(J).reshape(len(J), -1)
    return rows @ rows.T, rows @ as_real(r).ravel(), T
