r"""Channels exchanged between motors, and signs that contradict a passive mechanism, as a response shows them.

Exchange: the relative gain array does not change with scale or sign of a channel (Bristol, IEEE Trans. Automatic
Control 11, 1966), and above the resonances, where G tends to the inverse of a positive definite inertia, its diagonal
is 1 or more:

.. math:: \Lambda = G \circ G^{-T}

Sign: a motor of a passive mechanism takes up power, Re(velocity / torque) >= 0 at every line.
"""

from __future__ import annotations

import numpy as np

from elastid.base.arrays import ComplexArray, FloatArray
from elastid.base.note import Note
from elastid.frf.matrices import inverse
from elastid.record import MOTION_ORDER
from elastid.response import FrequencyResponse

# The part of the lines, from the highest down, that is above the resonances.
_HIGHEST_SHARE = 1 / 3
# An exchange makes each element that it puts on the diagonal at least so large, and gains so much in the mean.
_MIN_RELATIVE_GAIN = 0.7
_MIN_MEAN_GAIN = 0.5
# Delays that are allowed for: up to half a turn of phase at the highest line.
_DELAY_TURNS = np.linspace(0.0, 0.5, 26)
# A real part counts that differs from zero by so many standard deviations.
_MIN_SIGMAS = 2.0
# A sign is wrong where at least so many lines more are passive the other way round.
_MIN_LINES = 3
# So many lines, evenly taken, show a sign as well as all.
_MAX_LINES = 1000


def channel_notes(response: FrequencyResponse) -> tuple[Note, ...]:
    """A note where outputs (or inputs) of motors look exchanged; else one on each motor whose sign looks wrong."""
    places = [name for name in response.inputs if name in response.outputs]
    exchanged = _exchanged(response, places) if len(places) > 1 else {}
    if not exchanged:
        return _sign_notes(response, places)
    pairs = ", ".join(f"y at {place} answers to u at {driven}" for place, driven in exchanged.items())
    return (
        Note(
            "exchanged-channels",
            f"channels look exchanged between motors: at the highest lines {pairs}; check which channels are y (or u) "
            f"at {', '.join(exchanged)}",
            f"configuration {response.configuration.name}",
        ),
    )


def _exchanged(response: FrequencyResponse, places: list[str]) -> dict[str, str]:
    """Output place -> input place, for those of the places that another motor moves more than their own."""
    rows = [response.outputs.index(place) for place in places]
    columns = [response.inputs.index(place) for place in places]
    G = response.G[-max(1, round(_HIGHEST_SHARE * response.n_lines)) :][:, rows][:, :, columns]
    # Relative gains do not depend on scales; without this, units could make the matrix look singular.
    G = G / _geometric_scale(G)
    try:
        inverse_G = inverse(G)
    except np.linalg.LinAlgError:
        return {}
    if not np.max(np.linalg.norm(G, axis=(1, 2)) * np.linalg.norm(inverse_G, axis=(1, 2))) < 1 / np.finfo(float).eps:
        return {}
    Lambda = np.median((G * np.swapaxes(inverse_G, 1, 2)).real, axis=0)
    if np.array_equal(Lambda.argmax(axis=1), np.arange(len(places))):
        return {}
    from scipy.optimize import linear_sum_assignment  # slow to load, for the few responses that look exchanged

    _, best = linear_sum_assignment(-Lambda)
    on_best, on_own = Lambda[np.arange(len(places)), best], np.diag(Lambda)
    moved = best != np.arange(len(places))
    if (
        not moved.any()
        or on_best[moved].min() < _MIN_RELATIVE_GAIN
        or np.mean(on_best[moved] - on_own[moved]) < _MIN_MEAN_GAIN
    ):
        return {}
    return {places[i]: places[j] for i, j in enumerate(best) if moved[i]}


def _geometric_scale(G: ComplexArray) -> FloatArray:
    """Scales (n, n) of outputs times inputs."""
    magnitude = np.maximum(np.sqrt(np.mean(np.abs(G) ** 2, axis=0)), 1e-150)
    of_rows = np.sqrt(np.mean(magnitude**2, axis=1))[:, None]
    return np.asarray(of_rows * np.sqrt(np.mean((magnitude / of_rows) ** 2, axis=0)))


def _sign_notes(response: FrequencyResponse, places: list[str]) -> tuple[Note, ...]:
    """A note on each motor whose own response contradicts a passive mechanism and with the other sign would not."""
    notes = []
    few = slice(None, None, -(-response.n_lines // _MAX_LINES))
    freq_hz, order = response.freq_hz[few], MOTION_ORDER["velocity"] - MOTION_ORDER[response.quantity]
    j_omega = 2j * np.pi * freq_hz
    for name in places:
        j, i = response.outputs.index(name), response.inputs.index(name)
        velocity = response.G[few, j, i] * j_omega**order
        covariance = response.uncertainty
        variance = np.zeros(len(velocity)) if covariance is None else covariance.variance[few, j, i]
        # Half of the variance is in the real part.
        std = np.sqrt(variance / 2) * np.abs(j_omega) ** order
        as_is, _ = _passive_lines(freq_hz, velocity, std)
        turned, negative = _passive_lines(freq_hz, -velocity, std)
        if turned - as_is >= _MIN_LINES and turned > 2 * as_is:
            notes.append(
                Note(
                    "wrong-sign",
                    f"the sign of y or of u at {name} looks wrong: Re(velocity/torque) is negative beyond noise at "
                    f"{negative} of {len(std)} lines, so the motor would be driven by its load; check sign, scale and "
                    "gear ratio of its channels",
                    f"configuration {response.configuration.name}",
                )
            )
    return tuple(notes)


def _passive_lines(freq_hz: FloatArray, velocity: ComplexArray, std: FloatArray) -> tuple[int, int]:
    """Passive lines less active ones, and passive ones, at the delay with most of the former.

    A line is passive where Re(velocity / torque) is positive beyond noise, and active where it is negative.
    """
    phase = np.exp(2j * np.pi * np.outer(_DELAY_TURNS, freq_hz / freq_hz[-1]))
    real = (velocity * phase).real
    positive, negative = (np.sum(sign * real > _MIN_SIGMAS * std, axis=1) for sign in (1, -1))
    best = int(np.argmax(positive - negative))
    return int(positive[best] - negative[best]), int(positive[best])
