r"""Model of the noise of a measured response: noise on its outputs, and torques at its inputs that pass through it.

.. math:: C(k) = \sum_i a_i(\omega)\, e_i e_i^T + \sum_j b_j(\omega)\, g_j(k) g_j(k)^H, \qquad a_i, b_j \ge 0

F lines, n_y outputs, n_u inputs.  C, S (F, n_y, n_y): modelled and sample covariance.  e_i: unit vector of output i.
g_j (F, n_y): column j of the measured response; torque noise, friction and disturbances at motor j act on all outputs,
mostly at the resonances.  a_i: sum of white noise in position, velocity and acceleration, and of errors proportional to
the gain \|g_i\| of the output and to its square root (friction, drifting gains).  b_j: sum of white torque, torque that
decreases with frequency, and torque proportional to the excitation.

The powers theta of all these shapes Q are estimated from all lines by maximum likelihood of Wishart matrices with a
majorisation-minimisation step,

.. math:: \theta \leftarrow \theta\, \frac{\sum_k w_k\, \mathrm{tr}(Q C^{-1} S C^{-1})}
                                          {\sum_k w_k\, \mathrm{tr}(Q C^{-1})}, \qquad C = \sum \theta Q

and are far more accurate than the covariance S of a single line. w_k <= 1 is small for lines with much more noise than
the others. (Zhou, Hu, Zhou and Lange, MM algorithms for variance components models, JCGS 28, 2019.)
"""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from elastid.base.arrays import BoolArray, ComplexArray, FloatArray, quotient
from elastid.base.matrices import inverse
from elastid.record import MOTION_ORDER, Motion

MOTIONS = 3  # number of output noise spectra: white position, velocity and acceleration
MIN_VARIANCE_FRACTION = 1e-9  # regularisation, relative to the mean variance of an output: exact data have no noise


@dataclass(frozen=True)
class NoiseShapes:
    """Spectral shapes of the noise: p shapes of output noise (p, F, n_y), and q shapes of torque noise (q, F).

    G (F, n_y, n_u): response of the outputs to torques.
    """

    output: FloatArray
    torque: FloatArray
    G: ComplexArray

    @classmethod
    def of(
        cls, freq_hz: FloatArray, G: ComplexArray, quantity: Motion, inverse_power: FloatArray | None
    ) -> "NoiseShapes":
        """Build the shapes on the lines of G; inverse_power (F,): 1 / power of the excitation, None if unknown."""
        f = np.maximum(freq_hz, freq_hz[freq_hz > 0].min()) / freq_hz.max()
        motion = np.stack([f ** (2 * MOTION_ORDER[quantity] - 2.0 * order) for order in range(MOTIONS)])
        gain = np.linalg.norm(G, axis=2)
        gain = gain / np.maximum(gain.max(axis=0), 1e-300)
        output = np.concatenate([np.repeat(motion[:, :, None], gain.shape[1], axis=2), np.stack([gain, gain**2])])
        torque = [np.ones_like(f), f**-2.0]
        if inverse_power is not None and np.all(inverse_power > 0):
            torque.append(inverse_power.mean() / inverse_power)
        return cls(output, np.stack(torque), G)

    def on(self, lines: BoolArray) -> "NoiseShapes":
        """Return the shapes on some lines; lines (F,) is True where a line stays."""
        return NoiseShapes(self.output[:, lines], self.torque[:, lines], self.G[lines])


def noise_model(S: ComplexArray, shapes: NoiseShapes) -> ComplexArray:
    """Return the noise model C (F, n_y, n_y) with the largest likelihood of the sample covariances S (F, n_y, n_y).

    Errors proportional to gains are included if they increase the likelihood, the sum of -ln det C - tr(C^-1 S).
    C of every second line is estimated from the other lines, so that C is independent of the line's own S; fewer than
    16 lines are not divided.
    """
    models = [_across_lines(S, shape) for shape in (replace(shapes, output=shapes.output[:MOTIONS]), shapes)]
    return max(models, key=lambda C: -float(np.sum(np.linalg.slogdet(C)[1]) + np.sum(np.linalg.inv(C).mT * S).real))


def _across_lines(S: ComplexArray, shapes: NoiseShapes) -> ComplexArray:
    """Return the smoothed noise C of each line, estimated from the noise powers of the other half of the lines."""
    lines = np.arange(len(S))
    C = np.empty(S.shape, np.complex128)
    for half in (lines % 2 == 0, lines % 2 == 1):
        source = ~half if len(S) >= 16 else np.ones_like(half)
        C[half] = _fit_noise_powers(S[source], shapes.on(source))(shapes.on(half))
    return C


def _fit_noise_powers(S: ComplexArray, shapes: NoiseShapes) -> Callable[[NoiseShapes], ComplexArray]:
    """Fit the noise powers that explain S best; returns C (F, n_y, n_y) as a function of other lines' shapes."""
    F, n_y, n_u = shapes.G.shape
    variance = np.einsum("faa->a", S).real / F
    if not np.all(variance > 0):
        diagonal = np.diag(variance + MIN_VARIANCE_FRACTION * max(float(variance.max()), 1e-200))
        return lambda at: np.broadcast_to(diagonal, (len(at.G), n_y, n_y)).astype(np.complex128)
    scale = np.sqrt(variance)
    S, g = np.asarray(S / np.outer(scale, scale), np.complex128), shapes.G / scale[:, None]
    floor = MIN_VARIANCE_FRACTION * np.eye(n_y)
    a = 1 / np.maximum(shapes.output.mean(axis=1), 1e-300) / (2 * len(shapes.output))
    b = quotient(F * n_y / (2 * n_u * len(shapes.torque)), np.einsum("qf,fij->qj", shapes.torque, np.abs(g) ** 2))
    # 30 steps do not converge, which suffices: the neighbouring lines correct errors of the model.
    for _ in range(30):
        W = inverse(_covariance(a, b, shapes, g) + floor)
        WS = W @ S
        w = np.minimum(1.0, n_y / np.maximum(np.einsum("faa->f", WS).real, 1e-300))
        (motion, expected_motion), (torque, expected_torque) = _traces(np.stack([WS @ W, W]), w, shapes, g)
        a = a * quotient(np.maximum(motion, 0.0), expected_motion)
        b = b * quotient(np.maximum(torque, 0.0), expected_torque)
    return lambda at: np.asarray(
        (_covariance(a, b, at, at.G / scale[:, None]) + floor) * np.outer(scale, scale), np.complex128
    )


def _covariance(a: FloatArray, b: FloatArray, shapes: NoiseShapes, g: ComplexArray) -> ComplexArray:
    """Return C = sum theta Q (F, n_y, n_y) of the powers a (p, n_y) and b (q, n_u); g (F, n_y, n_u)."""
    C = (g * (shapes.torque.T @ b)[:, None, :]) @ g.mT.conj()
    diagonal = np.arange(g.shape[1])
    C[:, diagonal, diagonal] += np.einsum("pfa,pa->fa", shapes.output, a)
    return C


def _traces(W: ComplexArray, w: FloatArray, shapes: NoiseShapes, g: ComplexArray) -> tuple[FloatArray, FloatArray]:
    """Return sum_k w_k tr(Q W) of W (m, F, n_y, n_y), for noise of outputs (m, p, n_y) and torques (m, q, n_u)."""
    motion = np.einsum("pfa,mfa->mpa", shapes.output, np.einsum("mfaa->mfa", W).real * w[:, None])
    return motion, (shapes.torque * w) @ np.einsum("fij,mfij->mfj", g.conj(), W @ g).real
