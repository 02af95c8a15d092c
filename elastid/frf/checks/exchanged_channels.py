r"""Channels that were exchanged: at high frequencies each motor moves itself most, whatever the scales of the channels.

The relative gain array does not change with scale or sign of a channel (Bristol, IEEE Trans. Automatic Control 11,
1966), and above the resonances, where G tends to the inverse of a positive definite inertia, its diagonal is 1
or more:

.. math:: \Lambda = G \circ G^{-T}
"""

from __future__ import annotations

import numpy as np

from elastid.base.arrays import ComplexArray, FloatArray
from elastid.base.note import Note
from elastid.record import MOTION_ORDER
from elastid.response import FrequencyResponse

# Delays that are allowed for: up to half a turn of phase at the highest line.
_DELAY_TURNS = np.linspace(0.0, 0.5, 26)
_SIGMAS = 2.0
_FEWEST_LINES = 3
# So many lines, evenly taken, tell a sign as well as all.
_ENOUGH_LINES = 1000


def sign_words(response: FrequencyResponse) -> tuple[Note, ...]:
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
                Note(
                    "wrong-sign",
                    f"the sign of y or of u at {name} looks wrong: "
                    f"Re(velocity/torque) is negative beyond noise at {negative} of {len(std[few])} lines, "
                    "so the motor would feed on its load; check sign, scale and gear ratio of its channels",
                    f"configuration {response.configuration.name}",
                )
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


# The part of the lines, from the highest down, that is above the resonances.
_HIGHEST = 1 / 3
# An exchange must make each element that it puts on the diagonal at least so large, and a clear gain in all.
_DOMINANT = 0.7
_CLEARLY = 0.5


def pairing_words(response: FrequencyResponse) -> tuple[Note, ...]:
    """A word where outputs (or inputs) of motors look exchanged; else one for each motor whose sign looks wrong."""
    places = [name for name in response.inputs if name in response.outputs]
    exchanged = _exchanged(response, places) if len(places) > 1 else {}
    if not exchanged:
        return sign_words(response)
    pairs = ", ".join(f"y at {place} answers to u at {driven}" for place, driven in exchanged.items())
    return (
        Note(
            "exchanged-channels",
            f"channels look exchanged between motors: at the highest lines "
            f"{pairs}; check which channels are y (or u) at {', '.join(exchanged)}",
            f"configuration {response.configuration.name}",
        ),
    )


def _exchanged(response: FrequencyResponse, places: list[str]) -> dict[str, str]:
    """Output place -> input place, for those of the places that another motor moves more than their own."""
    from scipy.optimize import linear_sum_assignment

    rows = [response.outputs.index(place) for place in places]
    columns = [response.inputs.index(place) for place in places]
    G = response.G[-max(1, round(_HIGHEST * response.n_lines)) :][:, rows][:, :, columns]
    # Gains do not change with scales, so that units do not pass for a singular matrix.
    G = G / _geometric_scale(G)
    try:
        inverse = np.linalg.inv(G)
    except np.linalg.LinAlgError:
        return {}
    if not np.max(np.linalg.norm(G, axis=(1, 2)) * np.linalg.norm(inverse, axis=(1, 2))) < 1 / np.finfo(float).eps:
        return {}
    Lambda = np.median((G * np.swapaxes(inverse, 1, 2)).real, axis=0)
    _, best = linear_sum_assignment(-Lambda)
    on_best, on_own = Lambda[np.arange(len(places)), best], np.diag(Lambda)
    moved = best != np.arange(len(places))
    if not moved.any() or on_best[moved].min() < _DOMINANT or np.mean(on_best[moved] - on_own[moved]) < _CLEARLY:
        return {}
    return {places[i]: places[j] for i, j in enumerate(best) if moved[i]}


def _geometric_scale(G: ComplexArray) -> FloatArray:
    """Scales (n, n) of outputs times inputs."""
    magnitude = np.maximum(np.sqrt(np.mean(np.abs(G) ** 2, axis=0)), 1e-150)
    of_rows = np.sqrt(np.mean(magnitude**2, axis=1))[:, None]
    scale: FloatArray = of_rows * np.sqrt(np.mean((magnitude / of_rows) ** 2, axis=0))
    return scale
