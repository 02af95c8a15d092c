r"""Bounds of effects that were not found: how large each could be without having been seen.

.. math:: f < \max(\hat f, 0) + 1.645\, \sigma_f \quad (95\,\%)

f and its standard deviation by one Gauss-Newton step of parameters, found levels and the effect in question together,
along the motion under the effects that were found. Of a sine with its cosine the amplitude.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from elastid.base.arrays import FloatArray
from elastid.base.statistics import ONE_SIDED_95
from elastid.linear.linearise import Linearisation
from elastid.nonlinear.gear.choice import candidate_groups
from elastid.nonlinear.gear.drive_lines import drive_lines
from elastid.nonlinear.gear.effects import GearEffect
from elastid.nonlinear.gear.levels import Levels, inverse, joints_of, normal_equations, priors
from elastid.nonlinear.gear.motion import estimate_motion
from elastid.nonlinear.gear.period_lines import PeriodLines
from elastid.response import Response

# Of kinds that are one effect in several shapes.
_FAMILIES = {"progressive": "cubic", "range": "cubic", "bristle": "stop"}


@dataclass(frozen=True)
class Bound:
    """How large an effect that was not found could be.  rival: place of the found one it is least told apart from.

    correlation: of their levels.  factor: level of the rival that one of the effect makes up for; 0 without a rival.
    """

    size: float
    rival: int = -1
    correlation: float = 0.0
    factor: float = 0.0


def family_of(effect: GearEffect) -> tuple[str, str, float]:
    """Kind in general, joint, and order of what is periodic: shapes of one effect have the same."""
    word = effect.kind.split()[0]
    order = effect.scale if word in ("error", "ripple") else 0.0
    return _FAMILIES.get(word, word), effect.joint, order


def level_bounds(
    data: Sequence[PeriodLines],
    responses: Sequence[Response],
    linearisation: Linearisation,
    found: Levels,
    orders: Iterable[float],
) -> dict[tuple[GearEffect, ...], Bound]:
    """The bound of each candidate group, none of whose family is among the effects that were found.

    data: as the effects were found in.
    """
    families = {family_of(effect) for effect in found.effects}
    joints, ratios = joints_of(linearisation)
    every = candidate_groups(data, found, linearisation, bent=joints, orders=tuple(orders))
    groups = [group for group in every if family_of(group[0]) not in families]
    effects = [*found.effects, *(effect for group in groups for effect in group)]
    levels, before = found.levels_of(effects), found.estimates_of(effects)
    drives = [drive_lines(c, linearisation, G, found.parameters, found.x) for c, G in zip(data, responses, strict=True)]
    estimates = [
        estimate_motion(lines, drive, joints, ratios, effects, levels, each)
        for lines, drive, each in zip(data, drives, before, strict=True)
    ]
    n_x = len(found.x)
    sums, (A, b) = (
        normal_equations(data, drives, estimates, n_x, levels),
        priors(found.parameters, found.x, n_x + len(levels)),
    )
    A, b = A + sums.A.sum(axis=0), b + sums.b.sum(axis=0)
    bounds, first = dict[tuple[GearEffect, ...], Bound](), n_x + len(found.levels)
    known = list(range(first))
    for group in groups:
        chosen = [*known, *range(first, first + len(group))]
        covariance = inverse(A[np.ix_(chosen, chosen)])
        step = (covariance @ b[chosen])[len(known) :]
        std = np.sqrt(np.diag(covariance)[len(known) :])
        size = float(np.hypot.reduce(step)) if len(group) > 1 else float(max(step[0], 0.0))
        if not group[0].brakes and len(group) == 1:
            size = float(abs(step[0]))
        bound = Bound(size + ONE_SIDED_95 * float(std.max()))
        bounds[group] = bound if len(group) > 1 else _with_rival(bound, group[0], found, covariance)
        first += len(group)
    return bounds


def _with_rival(bound: Bound, effect: GearEffect, found: Levels, covariance: FloatArray) -> Bound:
    """covariance: of parameters and found levels, and of the effect as the last."""
    own = [i for i, other in enumerate(found.effects) if other.joint == effect.joint]
    if not own:
        return bound
    rows, power = len(found.x) + np.array(own), np.maximum(np.diag(covariance), 1e-300)
    r = covariance[rows, -1] / np.sqrt(power[rows] * power[-1])
    i = int(np.argmax(np.abs(r)))
    return Bound(bound.size, own[i], float(r[i]), float(-covariance[rows[i], -1] / power[-1]))
