r"""Systematic errors of measured responses of which only the size is known, one factor a motor for all configurations.

.. math:: \hat G = G(x) + \sum_b c_b\, \delta G_b + noise, \qquad c_b \sim N(0, 1)

The factors are further unknowns with a prior, estimated together with x: generalised least squares with the covariance
that such errors have. delta G: `FrequencyResponse.bias`.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from elastid.base.arrays import ComplexArray, FloatArray
from elastid.fit.problem.elastic import ElasticFit, Part, mixed
from elastid.fit.problem.residuals import as_real, error_gain
from elastid.response import FrequencyResponse


def biased_inputs(responses: Sequence[FrequencyResponse]) -> tuple[str, ...]:
    """The inputs whose motors bias any of the responses, each with a factor."""
    found: dict[str, None] = {}
    for response in responses:
        if response.bias is not None:
            found |= {name: None for name, one in zip(response.inputs, response.bias, strict=True) if np.any(one)}
    return tuple(found)


def bias_of(response: FrequencyResponse, inputs: Sequence[str]) -> ComplexArray:
    """delta G (n_b, F, n_y, n_u) of one response in the order of all inputs, zero where it has none."""
    bias = np.zeros((len(inputs), *response.G.shape), complex)
    if response.bias is not None:
        for b, name in enumerate(inputs):
            if name in response.inputs:
                bias[b] = response.bias[response.inputs.index(name)]
    return bias


def bias_slopes(part: Part, response: FrequencyResponse, inputs: Sequence[str]) -> ComplexArray:
    """-dr/dc (n_b, F, n_y, n_u) of whitened residuals r as they change with the factors c, taken out of Ghat."""
    used = part.gain > 0
    with np.errstate(divide="ignore", invalid="ignore"):
        gain = np.where(used, part.gain * error_gain(part.criterion, part.measured), 0j)
    whitened = bias_of(response, inputs) * gain
    return -whitened if part.mixing is None else -mixed(part.mixing, whitened)


def shared_factors(fit: ElasticFit, responses: Sequence[FrequencyResponse], x: FloatArray) -> FloatArray:
    """c (n_b,) of the optimum in x and c together, one Gauss-Newton step from x; fit: of the responses as measured."""
    inputs = biased_inputs(responses)
    r_priors, slope = fit.residual(x)[0][fit.n_residuals :], fit.prior_slopes
    known = np.flatnonzero(slope)
    n = len(x) + len(inputs)
    A, g = np.diag(np.concatenate([slope**2, np.ones(len(inputs))])), np.zeros(n)
    g[known] = slope[known] * r_priors
    for part, response, (r, J) in zip(fit.parts, responses, fit.blocks(x), strict=True):
        rows = as_real(np.concatenate([J, bias_slopes(part, response, inputs)])).reshape(n, -1)
        A += rows @ rows.T
        g += rows @ as_real(r).ravel()
    length = np.sqrt(np.maximum(np.diag(A), 1e-300))
    step = np.linalg.lstsq(A / np.outer(length, length), -g / length, rcond=1e-12)[0] / length
    return np.asarray(step[len(x) :])
