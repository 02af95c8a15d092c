r"""Identifiability before a fit: parameters without effect, and gains without anything that fixes their scale.

.. math:: \hat G = \frac{g_y}{g_u}\, G(M, D, K), \qquad G(c M, c D, c K) = G(M, D, K) / c

Where all inertias, stiffnesses and dampings that a gain multiplies are free, their common factor is that of the gain;
and where the torques' and the motions' gains are all free, one of them stands for the others.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from elastid.base.arrays import FloatArray
from elastid.base.errors import FitError
from elastid.fit.problem.elastic import ElasticFit
from elastid.parameters import ParameterSet
from elastid.robot import Robot

# The effect of a parameter, as a share of the strongest, below which it has none; rounding leaves about 1e-16.
MIN_RELATIVE_EFFECT = 1e-9
# A combination whose effect is below this share of the largest has none; rounding leaves about 1e-15.
MIN_COMBINED_EFFECT = 1e-10
# A parameter with a larger part in such a combination of length one belongs to it.
MIN_PART = 1e-3


def check_effects(fit: ElasticFit, robot: Robot) -> None:
    """FitError that names the free parameters without effect on the responses that count."""
    x = fit.parameters.x
    information = np.diag(replace(fit, inertias=()).evaluate(x).hessian) / 2 - fit.prior_slopes**2
    effect = np.sqrt(np.maximum(information, 0.0)) * _span(fit.parameters)
    without = effect <= MIN_RELATIVE_EFFECT * effect.max()
    if without.any():
        names = ", ".join(name for name, none in zip(fit.parameters.free_names, without, strict=True) if none)
        places = any(name.partition("@")[0] in robot.geometry for name in names.split(", "))
        hint = "; a coordinate along the axis of a joint does nothing, one across it may from another start"
        raise FitError(
            f"{names}: without effect on any of the {len(fit.parts)} frequency responses, so that no fit can find it; "
            f"fix it (fit.parameters: {{{names.split(', ')[0]}: {{fixed: true}}}}), or measure what it moves"
            + (hint if places else "")
        )


def _span(parameters: ParameterSet) -> FloatArray:
    """A plausible change of x (n_x,): a factor e, or the range of the bounds of a linear parameter."""
    return np.array(
        [1.0 if p.log or not np.isfinite(p.upper - p.lower) else p.upper - p.lower for p in parameters.free]
    )


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
    parts: FloatArray = np.linalg.norm(Vt[effect <= MIN_COMBINED_EFFECT * effect[0]], axis=0)
    return parts
