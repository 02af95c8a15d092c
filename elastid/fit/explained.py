r"""How much of the measured responses a model explains, and which configurations it explains far worse than others.

.. math:: \text{explained} = 1 - \frac{\sum_i w_i |\hat G_i - G_i|^2 - V_0}{\sum_i w_i |\hat G_i|^2 - V_0},
          \qquad w = 2 / \sigma^2

over all elements that count, V_0 what the noise alone leaves: 1 for all but the noise, 0 for no better than no model.
"""

from __future__ import annotations

import numpy as np

from elastid.arrays import FloatArray
from elastid.fit.elastic import ElasticFit
from elastid.fit.residuals import error_gain

# A configuration whose residuals are so many times those of the median one is not like the others.
FAR_APART = 5.0


def explained(fit: ElasticFit, x: FloatArray, noise_cost: float) -> float:
    """The share of the measured responses that the model at x (n_x,) explains; negative where it is worse than none."""
    left, whole = 0.0, 0.0
    for part in fit.parts:
        weight = part.gain * np.abs(error_gain(part.criterion, part.measured))
        used = part.gain > 0
        error = np.where(used, weight * (part.measured - part.kernel.response(fit.theta(part, x))), 0.0)
        left += float(np.sum(np.abs(error) ** 2))
        whole += float(np.sum(np.abs(np.where(used, weight * part.measured, 0.0)) ** 2))
    return 1 - max(left - noise_cost, 0.0) / max(whole - noise_cost, 1e-300)


def apart_words(fit: ElasticFit, x: FloatArray) -> tuple[str, ...]:
    """A word about each configuration that the model at x explains far worse than the others."""
    level = {}
    for part in fit.parts:
        if part.n_residuals:
            name = part.kernel.model.configuration.name
            level[name] = np.sqrt(part.normal.at(fit.theta(part, x))[0] / part.n_residuals)
    if len(level) < 3:
        return ()
    usual = float(np.median(list(level.values())))
    return tuple(
        f"configuration {name}: its residuals are {one / usual:.0f} times those of the other configurations; is it of "
        "the same robot, with the same load, at the angles that it claims?"
        for name, one in level.items()
        if one > FAR_APART * usual
    )
