"""Shapes near the chosen ones, whose signs turn over a speed of their own and not over one of those that were tried.

Signs are tried at speeds a factor 2 apart. Where friction turns over a speed between two of them, both together come
out as friction that is 0.1 to 0.2 % too large in sliding; two that are near each other, and near the speed at which it
turns, leave a tenth of that.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from elastid.base.arrays import FloatArray
from elastid.frf.friction.choice import Choice
from elastid.frf.friction.shapes import Shape

# Over and below the speed at which the chosen signs turn in the mean.
_NEAR = 1.1
# Chosen signs further apart are friction that turns over more than one speed.
_MAX_SPREAD = 2.1


def refined(choice: Choice, levels: FloatArray, places: Sequence[str]) -> Choice:
    """The choice with gradual signs near the mean speed of the chosen ones, in their place; levels (n_f,) found so far.

    Of a motor whose signs are refined, other signs that fitted nearly as well are left out. The covariance by the
    choice between shapes is that of the first choice where shapes are the same, 0 of new ones.
    """
    shapes: list[Shape] = []
    is_taken: list[bool] = []
    kept: list[int] = []
    for place in places:
        own = [i for i, shape in enumerate(choice.shapes) if shape.place == place]
        near = _near([choice.shapes[i] for i in own], levels[own], place)
        shapes += near
        is_taken += [True] * len(near)
        kept += [-1] * len(near)
        rest = [i for i in own if not (near and choice.shapes[i].kind == "sign")]
        shapes += [choice.shapes[i] for i in rest]
        is_taken += [i in choice.taken for i in rest]
        kept += rest
    same = np.array(kept, dtype=np.int64)
    covariance = np.where(np.outer(same >= 0, same >= 0), choice.covariance[np.ix_(same, same)], 0.0)
    return Choice(
        shapes=tuple(shapes),
        motor_of=np.array([places.index(shape.place) for shape in shapes], dtype=np.int64),
        kept_share=choice.kept_share,
        taken=np.flatnonzero(is_taken),
        covariance=covariance,
    )


def _near(shapes: Sequence[Shape], levels: FloatArray, place: str) -> list[Shape]:
    """Signs near the mean speed of those that were taken out; none where there are none, or far from each other."""
    signs = [(shape.threshold, level) for shape, level in zip(shapes, levels, strict=True) if shape.kind == "sign"]
    speeds = np.array([speed for speed, level in signs if level > 0])
    weights = np.array([level for _, level in signs if level > 0])
    gradual = speeds[speeds > 0]
    if not gradual.size or gradual.max() > _MAX_SPREAD * gradual.min():
        return []
    mean = float(weights @ speeds / weights.sum())
    return [Shape(place, "sign", mean / _NEAR), Shape(place, "sign", mean * _NEAR)]
