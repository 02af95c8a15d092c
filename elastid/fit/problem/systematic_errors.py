r"""Systematic errors of measured responses as nuisance parameters with a prior, for example uncompensated friction.

.. math:: \hat G_q = G_q(x) + \sum_b (c_b\, \delta G_{bq} + c_{bq}\, \delta G'_{bq}) + noise, \qquad
          c_b, c_{bq} + \bar c_b \sim N(0, 1)

for motor b in configuration q: factors c_b common to all configurations, and factors c_bq of each configuration minus
their mean, which the common factors contain. The factors are nuisance parameters with a prior, estimated together with
x; this is generalised least squares with the covariance of such errors. delta G, delta G': `Response.bias`, evaluated
with the model's response at the end of the fit instead of the measured one. The measured response would correlate
delta G = G e_j z e_j^T G, and so the factors, with its noise: a bias of many times the noise of a few realisations.
"""

from collections import Counter
from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from typing import TypeAlias

import numpy as np
from scipy.linalg import block_diag

from elastid.base.arrays import ComplexArray, FloatArray, laplace_variable
from elastid.fit.problem.frf_residuals import ElasticFit, Part, apply_mixing, each_at_home
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
    part: Part, response: Response, theta: FloatArray, mixing: ComplexArray | None
) -> dict[str, ComplexArray]:
    r"""Return whitened errors (F, n_y, n_u) of a response for one standard deviation of each gear ratio, by its input.

    .. math:: \delta G = \epsilon_j (e_j e_j^T G + G\, e_j e_j^T - 2\, G\, e_j\, s^{-o} (J_j s^2 + f_j s)\, e_j^T G)

    J_j, f_j: of the motor at theta (n_theta,), which the ratio of the file refers to the link side as the angles; o: of
    the derivative of the motion.  They widen intervals and are not estimated (`fit.gear_ratios`).
    """
    errors, s, model = dict[str, ComplexArray](), laplace_variable(response.freq_hz), part.kernel.model
    late = np.exp(s * sum(model.number(theta, name, absent=0.0) for name in ("delay", "delay_u")))
    G = part.kernel.response(theta)  # noise of the measured one would be correlated with the residuals
    for j, std in enumerate(response.ratio_std.tolist()):
        if std > 0 and response.inputs[j] in response.outputs:
            i, error = response.outputs.index(response.inputs[j]), np.zeros_like(G)
            error[:, i] += std * G[:, i]
            error[:, :, j] += std * G[:, :, j]
            impedance = _motor_impedance(model, theta, j, s) * late * s ** -MOTION_ORDER[response.quantity]
            error -= 2 * std * impedance[:, None, None] * G[:, :, j, None] * G[:, i, None, :]
            errors[response.inputs[j]] = part.slopes(G, -error, mixing)
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


def errors_of(response: Response) -> ComplexArray:
    """Return the errors delta G, delta G' (n_e, F, n_y, n_u) of one response, of which factors are shares."""
    if response.bias is None:
        return np.zeros((0, *response.G.shape), complex)
    return np.reshape(response.bias, (-1, *response.G.shape))


def shares_of(response: Response, factors: Sequence[Factor]) -> FloatArray:
    """Return C (n_b, n_e) of the errors of one response: d Ghat / d c = C errors, zero where a factor is not of it."""
    n, n_u = (0, 0) if response.bias is None else response.bias.shape[:2]
    contrasts, counts = np.zeros((len(factors), n, n_u)), Counter(name for name, _, is_known in factors if is_known)
    for b, (name, i, configuration) in enumerate(factors):
        if name not in response.inputs or i >= n - 1:
            continue
        contrast = (configuration == response.configuration.name) - 1 / counts[name] if configuration else 1.0
        contrasts[b, i, response.inputs.index(name)] = contrast
    return contrasts.reshape(len(factors), n * n_u)


def with_modelled_bias(response: Response, G: ComplexArray) -> Response:
    """Return the response with the systematic errors that the response G (F, n_y, n_u) of a model would have.

    Measured with fewer outputs than inputs it keeps those that it has.
    """
    _, n_y, n_u = G.shape
    if response.bias is None or n_y < n_u:
        return response
    inverse = np.linalg.pinv(response.G)
    return replace(response, bias=G @ (inverse @ response.bias) @ (inverse @ G))


def with_factors(
    fit: ElasticFit, x: FloatArray, factors: Sequence[Factor], part: Part, response: Response,
    mixing: ComplexArray | None,
) -> tuple[ComplexArray, ComplexArray, FloatArray]:  # fmt: skip
    """Return whitened r (F, n_y, n_u), slopes J (n, F, n_y, n_u) and T (n_x + n_b, n): dr / d(x, c) = T J.

    fit: whose parameters count.  mixing: `Part.mixing`.
    Most factors are of other configurations, and count here by their mean alone: n is far below n_x + n_b.
    """
    (r, slopes), C = fit.block(part, x, mixing), shares_of(response, factors)
    if not len(factors):
        return r, slopes, np.eye(len(slopes))
    J = np.concatenate([slopes, -apply_mixing(mixing, errors_of(response) * part.error_gain)])
    return r, J, block_diag(np.eye(len(slopes)), C)


def next_factors(fit: ElasticFit, responses: Sequence[Response], x: FloatArray, c: FloatArray) -> FloatArray:
    """Return c (n_b,) after one joint Gauss-Newton step in x and c. fit: responses corrected for c."""
    factors = find_factors(responses)
    distance, slope = fit.parameters.priors(x)
    A, g = np.diag(np.concatenate([slope**2, np.ones(len(c))])), np.concatenate([slope * distance, c])
    r_static, J_static = fit.static(x)
    A[: len(x), : len(x)] += J_static.T @ J_static
    g[: len(x)] += J_static.T @ r_static
    sums = partial(_sums, replace(fit, parts=(), loads=None), x, factors)
    for A_q, g_q, T in each_at_home(sums, list(zip(fit.parts, responses, strict=True)), fit.home):
        A, g = A + T @ A_q @ T.T, g + T @ g_q
    length = np.sqrt(np.maximum(np.diag(A), 1e-300))
    step = np.linalg.lstsq(A / np.outer(length, length), -g / length, rcond=1e-12)[0] / length
    return np.asarray(c + step[len(x) :])


def _sums(
    fit: ElasticFit, x: FloatArray, factors: Sequence[Factor], pair: tuple[Part, Response]
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return J^T J, J^T r and T (`with_factors`) of one configuration."""
    r, J, T = with_factors(fit, x, factors, *pair, pair[0].mixing)
    rows = as_real(J).reshape(len(J), -1)
    return rows @ rows.T, rows @ as_real(r).ravel(), T
