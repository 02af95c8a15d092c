"""A response whose outputs are turned into another quantity of motion, exactly: by powers of j omega."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from elastid.arrays import FloatArray
from elastid.record import MOTION_ORDER, Motion
from elastid.response import Covariance, FrequencyResponse


def in_quantity(response: FrequencyResponse, quantity: Motion) -> FrequencyResponse:
    r"""The same response in position, velocity or acceleration per torque, its covariance with it.

    .. math:: G' = (j\omega)^k G, \qquad cov(vec\, G') = \omega^{2k} cov(vec\, G)
    """
    k = MOTION_ORDER[quantity] - MOTION_ORDER[response.quantity]
    if k == 0:
        return response
    gain = ((2j * np.pi * response.freq_hz) ** k)[:, None, None]
    power = np.abs(gain) ** 2
    return replace(
        response,
        G=gain * response.G,
        quantity=quantity,
        noise=_scaled(response.noise, power),
        total=_scaled(response.total, power),
        distortion=_scaled(response.distortion, power),
        quality=None,  # it speaks of the outputs as they were measured
    )


def _scaled(covariance: Covariance | None, power: FloatArray) -> Covariance | None:
    if covariance is None:
        return None
    left, matrix = (None if part is None else part * power for part in (covariance.left, covariance.matrix))
    return replace(covariance, variance=covariance.variance * power, left=left, matrix=matrix)
