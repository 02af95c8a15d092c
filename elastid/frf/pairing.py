r"""Channels that were exchanged: at high frequencies each motor moves itself most, whatever the scales of the channels.

The relative gain array does not change with scale or sign of a channel (Bristol, IEEE Trans. Automatic Control 11,
1966), and above the resonances, where G tends to the inverse of a positive definite inertia, its diagonal is 1
or more:

.. math:: \Lambda = G \circ G^{-T}
"""

from __future__ import annotations

import numpy as np

from elastid.arrays import ComplexArray, FloatArray
from elastid.frf.passivity import sign_words
from elastid.response import FrequencyResponse

# The part of the lines, from the highest down, that is above the resonances.
_HIGHEST = 1 / 3
# An exchange must make each element that it puts on the diagonal at least so large, and a clear gain in all.
_DOMINANT = 0.7
_CLEARLY = 0.5


def pairing_words(response: FrequencyResponse) -> tuple[str, ...]:
    """A word where outputs (or inputs) of motors look exchanged; else one for each motor whose sign looks wrong."""
    places = [name for name in response.inputs if name in response.outputs]
    exchanged = _exchanged(response, places) if len(places) > 1 else {}
    if not exchanged:
        return sign_words(response)
    pairs = ", ".join(f"y at {place} answers to u at {driven}" for place, driven in exchanged.items())
    return (
        f"configuration {response.configuration.name}: channels look exchanged between motors: at the highest lines "
        f"{pairs}; check which channels are y (or u) at {', '.join(exchanged)}",
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
