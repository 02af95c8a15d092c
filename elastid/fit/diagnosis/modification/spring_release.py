r"""A model in which a stiff spring stands in for a rigid coordinate, with that spring made softer: no further solution.

.. math:: Z_k = Z + \delta\, y y^T, \quad \delta = k (1 + j \omega \eta) - k_s, \quad h = y^T Z^{-1} y, \qquad
          G_k = G - c\, \frac{\delta}{1 + \delta h}\, (C Z^{-1} y)(y^T Z^{-1} B)

(Sherman and Morrison 1950), and with the derivatives J of the residuals r at the optimum V after a step of the
parameters beside the spring,

.. math:: V_k \approx r^T r - r^T \bar J (\bar J^T \bar J + \text{priors})^{-1} \bar J^T r, \qquad
          \bar J = [J, \partial r / \partial \ln k], \quad r = r(G_k)

J is that without the spring, so V_k tells where it has a minimum rather than how deep that is.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from elastid.base.arrays import ComplexArray, FloatArray
from elastid.fit.diagnosis.modification.sensitivities import Evaluated
from elastid.linear.linear_model import LinearModel
from elastid.linear.response.factor import factor

# Of the prior that keeps the normal matrix regular, in units of its diagonal.
REGULAR = 1e-12


def released_costs(
    evaluated: Sequence[Evaluated],
    models: Sequence[LinearModel],
    name: str,
    stiffnesses: FloatArray,
    damping_ratio: float,
    prior: FloatArray,
) -> FloatArray:
    """V_k (n_k,) of a stiff spring, `name` its parameter, at some stiffnesses.

    evaluated: all configurations at the optimum; models: the same with the stiff spring.  damping_ratio: d / k in s.
    prior (n_x,): 1 / s of the priors.
    """
    n_x = len(prior)
    A = np.zeros((len(stiffnesses), n_x + 1, n_x + 1))
    A[:, range(n_x), range(n_x)] += prior**2
    b, V = np.zeros((len(stiffnesses), n_x + 1)), np.zeros(len(stiffnesses))
    for one, model in zip(evaluated, models, strict=True):
        for i, (dG, slope) in enumerate(released(model, one.part.kernel.freq_hz, name, stiffnesses, damping_ratio)):
            at = replace(one, G=one.G + dG)
            fitted = one if one.part.criterion == "complex" else at  # the slopes of a difference are those of any G
            r, J, j = at.residual, fitted.rows, -at.whitened(slope[None])[0]
            A[i, :n_x, :n_x] += fitted.information
            A[i, :n_x, n_x] += J @ j
            A[i, n_x, n_x] += j @ j
            b[i] += np.append(J @ r, j @ r)
            V[i] += float(r @ r)
    A[:, n_x, :n_x] = A[:, :n_x, n_x]
    size = np.sqrt(np.maximum(np.einsum("kii->ki", A), 1e-300))
    scaled = A / (size[:, :, None] * size[:, None, :]) + REGULAR * np.eye(n_x + 1)
    steps = np.linalg.solve(scaled, (b / size)[:, :, None])[:, :, 0]
    return np.asarray(V - np.sum(steps * b / size, axis=1))


def released(
    model: LinearModel, freq_hz: FloatArray, name: str, stiffnesses: FloatArray, damping_ratio: float
) -> Iterator[tuple[ComplexArray, ComplexArray]]:
    """G_k - G and its derivative to ln k (F, n_y, n_u) at each stiffness."""
    theta, s = model.theta_ref, np.asarray(2j * np.pi * freq_hz, np.complex128)
    (M, D, K), (C, T) = model.matrices(theta), model.readout(theta)
    y = direction(model, name)
    gain = np.multiply.outer(factor(model, theta, s), np.outer(*model.channel_gains(theta)))
    Z = K + s[:, None, None] * D + s[:, None, None] ** 2 * M
    reached = np.linalg.solve(Z, np.broadcast_to(y[:, None], (len(s), len(y), 1)))[:, :, 0]  # Z^-1 y (F, n)
    across = (reached @ C.T + reached @ T.T / s[:, None] ** 2)[:, :, None] * (reached @ model.B)[:, None, :]
    h, stiff = reached @ y, model.number(theta, name)
    for k in stiffnesses:
        softer = k * (1 + s * damping_ratio)
        delta = softer - stiff
        taken = 1 / (1 + delta * h)
        change, slope = ((w[:, None, None] * across) for w in (delta * taken, softer * taken**2))
        yield -gain * change, -gain * slope


def direction(model: LinearModel, name: str) -> FloatArray:
    """y (n,) of the coordinate that a spring acts on: its dK / dk is y y^T."""
    K = model.slopes[name].K
    if K is None:
        raise ValueError(f"{name} does not enter the model of {model.configuration.name}")
    i = int(np.argmax(np.diag(K)))
    return np.asarray(K[:, i] / np.sqrt(K[i, i]))
