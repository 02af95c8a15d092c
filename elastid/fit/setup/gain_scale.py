r"""Gains of channels, and whether anything fixes the scale of the responses.

.. math:: \hat G = \frac{g_y}{g_u}\, G(M, D, K), \qquad G(c M, c D, c K) = G(M, D, K) / c

Where all inertias, stiffnesses and dampings that a gain multiplies are free, their common factor is that of the gain;
and where the torques' and the motions' gains are all free, one of them stands for the others.
"""

from __future__ import annotations

import numpy as np

from elastid.base.arrays import FloatArray
from elastid.base.errors import FitError
from elastid.fit.problem.elastic import ElasticFit
from elastid.robot import Robot

# A combination whose effect is below this share of the largest has none; rounding leaves about 1e-15.
MIN_RELATIVE_EFFECT = 1e-10
# A parameter with a larger part in such a combination of length one belongs to it.
MIN_PART = 1e-3


def check_scale(fit: ElasticFit, robot: Robot) -> None:
    """FitError where a gain and other parameters have no effect together; it names priors that would fix the scale."""
    names = fit.parameters.free_names
    gains = np.array([parameter.stands_for in robot.gains for parameter in fit.parameters.free])
    if not gains.any():
        return
    rows = [np.diag(fit.prior_slopes)]
    for _, J in fit.blocks(fit.parameters.x):
        flat = J.reshape(len(names), -1)
        rows.append(np.asarray(np.linalg.qr(np.vstack([flat.real.T, flat.imag.T]), mode="r")))
    R = np.vstack(rows)
    R /= np.maximum(np.linalg.norm(R, axis=0), 1e-300)
    together, needed = _without_scale(R), []
    parts = together
    while np.any(parts[gains] > MIN_PART):
        place = int(np.argmax(np.where(gains, parts, 0.0)))
        needed.append(names[place])
        R = np.vstack([R, np.eye(len(names))[place]])
        parts = _without_scale(R)
    if needed:
        listed = ", ".join(name for name, part in zip(names, together, strict=True) if part > MIN_PART)
        priors = ", ".join(f"{name}: {{prior: {{std: 0.05}}}}" for name in needed)
        raise FitError(
            f"nothing fixes the scale of {listed}: they can change together without any effect on the responses; say "
            f"how well a gain is known (fit.parameters: {{{priors}}} for 5 %), or fix {' and '.join(needed)} with "
            "fixed: true, or an inertia that is known"
        )


def _without_scale(R: FloatArray) -> FloatArray:
    """The part (n_x,) of each parameter in combinations without effect, of R (n, n_x) with columns of length one."""
    _, values, Vt = np.linalg.svd(R, full_matrices=True)
    effect = np.zeros(len(Vt))
    effect[: len(values)] = values
    parts: FloatArray = np.linalg.norm(Vt[effect <= MIN_RELATIVE_EFFECT * effect[0]], axis=0)
    return parts
