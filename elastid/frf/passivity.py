"""A mechanism takes energy from the motor that drives it; a measured response that gives some has a wrong sign.

    Re {velocity / torque} >= 0   at every frequency, where both are those of the same motor

However lightly damped it is, near its resonances and antiresonances this shows far above the noise. A delay of the
torque or of the sensor turns the phase too, and is allowed for.
"""

from __future__ import annotations

import numpy as np

from elastid.arrays import ComplexArray, FloatArray
from elastid.record import MOTION_ORDER
from elastid.response import FrequencyResponse

# Delays that are allowed for: up to half a turn of phase at the highest line.
_DELAY_TURNS = np.linspace(0.0, 0.5, 26)
_SIGMAS = 2.0
_FEWEST_LINES = 3
# So many lines, evenly taken, tell a sign as well as all.
_ENOUGH_LINES = 1000


def sign_words(response: FrequencyResponse) -> tuple[str, ...]:
    """A word for each motor whose own response contradicts a passive mechanism and, turned round, would not."""
    words = []
    for i, name in enumerate(response.inputs):
        if name not in response.outputs:
            continue
        j = response.outputs.index(name)
        order = MOTION_ORDER["velocity"] - MOTION_ORDER[response.quantity]
        j_omega = 2j * np.pi * response.freq_hz
        velocity = response.G[:, j, i] * j_omega**order
        covariance = response.uncertainty
        variance = np.zeros(len(velocity)) if covariance is None else covariance.variance[:, j, i]
        # Half of the variance is in the real part.
        std = np.sqrt(variance / 2) * np.abs(j_omega) ** order
        few = slice(None, None, -(-response.n_lines // _ENOUGH_LINES))
        as_is, _ = _passive_lines(response.freq_hz[few], velocity[few], std[few])
        turned, negative = _passive_lines(response.freq_hz[few], -velocity[few], std[few])
        if turned - as_is >= _FEWEST_LINES and turned > 2 * as_is:
            words.append(
                f"configuration {response.configuration.name}: the sign of y or of u at {name} looks wrong: "
                f"Re(velocity/torque) is negative beyond noise at {negative} of {len(std[few])} lines, "
                "so the motor would feed on its load; check sign, scale and gear ratio of its channels"
            )
    return tuple(words)


def _passive_lines(freq_hz: FloatArray, velocity: ComplexArray, std: FloatArray) -> tuple[int, int]:
    """At the best delay: lines where Re velocity / torque is positive beyond noise less those where it is negative.

    And those where it is positive.
    """
    phase = np.exp(2j * np.pi * np.outer(_DELAY_TURNS, freq_hz / freq_hz[-1]))
    real = (velocity * phase).real
    positive, negative = (np.sum(sign * real > _SIGMAS * std, axis=1) for sign in (1, -1))
    best = int(np.argmax(positive - negative))
    return int(positive[best] - negative[best]), int(positive[best])
