r"""LinearModel -> frequency response, the formula itself.

.. math:: G(j\omega) = c\, C Z^{-1} B, \qquad Z = -\omega^2 M + j\omega D + K, \qquad
          c = (j\omega)^k e^{-j\omega T_d} \prod_i H_i(j\omega T_i)

with k = 0, 1, 2 for position, velocity, acceleration, H_i the elements of the measurement chain, and each element times
g_y / g_u where channels have gains. An accelerometer has C + T / s^2 instead of C. Of a torque that is held
between its samples the images in the sampled motion are added (`hold_images`).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from elastid.base.arrays import ComplexArray, FloatArray
from elastid.linear.linear_model import LinearModel
from elastid.linear.response.hold_images import factor, hold_images
from elastid.response import FrequencyResponse


def frequency_response(model: LinearModel, theta: FloatArray, freq_hz: FloatArray) -> ComplexArray:
    r"""Response of an elastic robot in one configuration, the formula itself.

    .. math:: G(j\omega) = (j\omega)^k e^{-j\omega T_d}\, C\, [K - \omega^2 M + j\omega D]^{-1} B

    theta (n_theta,): model.parameters, SI.  freq_hz (F,), or one: positive numbers, ValueError otherwise.
    Returns G (F, n_y, n_u), link side, model.quantity per Nm; with the images of torques that `model.hold` holds.
    """
    freq_hz = checked_frequencies(freq_hz)
    M, D, K = model.matrices(theta)
    s = (2j * np.pi * freq_hz[:, None, None]).astype(complex)
    X = np.linalg.solve(s**2 * M + s * D + K, model.B.astype(complex))
    C, T = model.readout(theta)
    G = np.outer(*model.channel_gains(theta)) * factor(model, theta, s) * (C @ X + T @ X / s**2)
    for images in hold_images(model, freq_hz):
        above = frequency_response(images.plant, images.undelayed(theta), images.nodes_hz)
        G = G + images.folding(theta).images(above)
    return np.asarray(G)


def checked_frequencies(freq_hz: ArrayLike) -> FloatArray:
    """Frequencies (F,) as numbers, also of a single one; ValueError for others, and for those that are not positive."""
    try:
        lines = np.atleast_1d(np.asarray(freq_hz, float))
    except (TypeError, ValueError):
        raise ValueError(f"freq_hz is {freq_hz!r}; give numbers in Hz, such as [10.0, 20.0]") from None
    if lines.ndim != 1:
        raise ValueError(f"freq_hz has shape {lines.shape}; give one number or a list of them, shape (F,)")
    if np.isinf(lines).any():
        raise ValueError(f"freq_hz is infinite at index {int(np.argmax(np.isinf(lines)))}; leave the line out")
    bad = np.flatnonzero(~(lines > 0))
    if bad.size:
        raise ValueError(
            f"freq_hz is {lines[bad[0]]:g} Hz at index {bad[0]}: a response is computed above 0 Hz, since a constant "
            "torque turns a free motor for ever; leave the line out, or give a small frequency such as 0.01"
        )
    return lines


def to_response(model: LinearModel, theta: FloatArray, freq_hz: FloatArray) -> FrequencyResponse:
    """The response as a value like a measured one; arguments as `frequency_response`."""
    G = frequency_response(model, theta, freq_hz)
    return FrequencyResponse(
        np.atleast_1d(freq_hz),
        G,
        model.inputs,
        model.outputs,
        model.quantity,
        model.configuration,
        sliding=model.sliding,
        hold=model.hold,
    )
