r"""LinearModel -> frequency response, the formula itself.

.. math:: G(j\omega) = c\, C Z^{-1} B, \qquad Z = -\omega^2 M + j\omega D + K, \qquad
          c = (j\omega)^k e^{-j\omega T_d} \prod_i H_i(j\omega T_i)

with k = 0, 1, 2 for position, velocity, acceleration, H_i the elements of the measurement chain, and each element times
g_y / g_u where channels have gains. An accelerometer has C + T / s^2 in the place of C. Of a torque that is held
between its samples the images in the sampled motion are added (`hold_images`).
"""

from __future__ import annotations

import numpy as np

from elastid.base.arrays import ComplexArray, FloatArray
from elastid.linear.linear_model import LinearModel
from elastid.linear.response.factor import factor
from elastid.linear.response.hold_images import hold_images
from elastid.response import FrequencyResponse


def frequency_response(model: LinearModel, theta: FloatArray, freq_hz: FloatArray) -> ComplexArray:
    r"""Response of an elastic robot in one configuration, the formula itself.

    .. math:: G(j\omega) = (j\omega)^k e^{-j\omega T_d}\, C\, [K - \omega^2 M + j\omega D]^{-1} B

    theta (n_theta,): model.parameters, SI.  freq_hz (F,): positive, ValueError otherwise.
    Returns G (F, n_y, n_u), link side, model.quantity per Nm; with the images of torques that `model.hold` holds.
    """
    check_frequencies(freq_hz)
    M, D, K = model.matrices(theta)
    s = (2j * np.pi * np.asarray(freq_hz)[:, None, None]).astype(complex)
    X = np.linalg.solve(s**2 * M + s * D + K, model.B.astype(complex))
    C, T = model.readout(theta)
    G = np.outer(*model.channel_gains(theta)) * factor(model, theta, s) * (C @ X + T @ X / s**2)
    for images in hold_images(model, np.asarray(freq_hz)):
        above = frequency_response(images.plant, images.undelayed(theta), images.nodes_hz)
        G = G + images.folding(theta).images(above)
    return np.asarray(G)


def check_frequencies(freq_hz: FloatArray) -> None:
    """ValueError for a frequency (F,) that is not positive: at 0 Hz a constant torque turns a free motor for ever."""
    lines = np.asarray(freq_hz)
    bad = np.flatnonzero(~(lines > 0))
    if bad.size:
        raise ValueError(
            f"freq_hz is {lines[bad[0]]:g} Hz at index {bad[0]}: a response is computed above 0 Hz, since a constant "
            "torque turns a free motor for ever; leave the line out, or give a small frequency such as 0.01"
        )


def to_response(model: LinearModel, theta: FloatArray, freq_hz: FloatArray) -> FrequencyResponse:
    """The response as a value like a measured one; arguments as `frequency_response`."""
    G = frequency_response(model, theta, freq_hz)
    return FrequencyResponse(
        freq_hz,
        G,
        model.inputs,
        model.outputs,
        model.quantity,
        model.configuration,
        sliding=model.sliding,
        hold=model.hold,
    )
