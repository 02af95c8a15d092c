r"""Friction that changes with the angle of its joint, by what passes there and back differ in at the same angles.

.. math:: h(q) = \frac{u_{there}(q) - u_{back}(q)}{2} - J \frac{a_{there} - a_{back}}{2}

is friction alone: gravity, ripple and offsets of the torque are alike in both directions. Of each pair h over its mean
is fitted by Legendre polynomials of the angle; shapes that all pairs have in common are no noise.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.polynomial.legendre import legval, legvander
from scipy.stats import t as t_distribution

from elastid.base.arrays import FloatArray
from elastid.base.note import Note
from elastid.friction_fit.pass_regression import Pass

# Degrees of the polynomials, bins of the angle, and pairs that can tell anything.
DEGREES, BINS, MIN_PAIRS = 3, 24, 4
# Pairs that cover less of the widest one's angles are left out.
MIN_COVER = 0.6
# Chance of a note without angle dependence, and the smallest change, in parts of friction, that is worth one.
FALSE_ALARM, MIN_CHANGE = 0.01, 0.03


def angle_note(passes: Sequence[Pass], inertia: float) -> Note | None:
    """A note where friction changes with the angle by more than pairs scatter; inertia: J of the passes."""
    pairs = [pair for pair in _there_and_back(passes) if pair is not None]
    widest = max((_cover(pair) for pair in pairs), default=0.0)
    wide = [pair for pair in pairs if _cover(pair) > MIN_COVER * widest]
    if len(wide) < MIN_PAIRS:
        return None
    low, high = max(_range(pair)[0] for pair in wide), min(_range(pair)[1] for pair in wide)
    shapes = np.array([_shape(pair, inertia, low, high) for pair in wide])
    mean = shapes.mean(axis=0)
    std = shapes.std(axis=0, ddof=1) / np.sqrt(len(shapes))
    limit = t_distribution.ppf(1 - FALSE_ALARM / 2 / DEGREES, len(shapes) - 1)
    clear = np.where(np.abs(mean) > limit * std, mean, 0.0)
    change = float(np.ptp(legval(np.linspace(-1, 1, 101), np.append(0.0, clear))))
    if change < MIN_CHANGE:
        return None
    unit = "m" if passes[0].slides else "rad"
    text = (
        f"friction changes by {change:.0%} of itself with the position, between {low:.3g} and {high:.3g} {unit}, and "
        "its law has no such change: levels are means over the positions of each pass, and slow passes that cover "
        "fewer of them stand beside the curve; give all passes one window, or hold the law to hold there only"
    )
    return Note("friction-by-angle", text, passes[0].place)


def _there_and_back(passes: Sequence[Pass]) -> list[tuple[Pass, Pass] | None]:
    """The first pass of each direction of every pair; None without one."""
    pairs: dict[str, dict[float, Pass]] = {}
    for one in passes:
        pairs.setdefault(one.pair, {}).setdefault(one.direction, one)
    return [(two[1.0], two[-1.0]) if len(two) == 2 else None for two in pairs.values()]


def _range(pair: tuple[Pass, Pass]) -> tuple[float, float]:
    """Lowest and highest position that both directions have."""
    return max(float(one.position.min()) for one in pair), min(float(one.position.max()) for one in pair)


def _cover(pair: tuple[Pass, Pass]) -> float:
    low, high = _range(pair)
    return high - low


def _shape(pair: tuple[Pass, Pass], inertia: float, low: float, high: float) -> FloatArray:
    """Coefficients (DEGREES,) of h over its mean, between two positions."""
    edges = np.linspace(low, high, BINS + 1)
    means = []
    for one in pair:
        bins = np.clip(np.digitize(one.position, edges) - 1, 0, BINS - 1)
        used = (one.position >= low) & (one.position <= high)
        count = np.bincount(bins[used], minlength=BINS)
        total = np.bincount(bins[used], (one.torque - inertia * one.acceleration)[used], BINS)
        means.append(np.divide(total, count, out=np.full(BINS, np.nan), where=count > 0))
    h = (means[0] - means[1]) / 2
    known = np.isfinite(h)
    x = np.linspace(-1, 1, 2 * BINS + 1)[1::2]
    if known.sum() <= DEGREES + 1:
        return np.zeros(DEGREES)
    found, *_ = np.linalg.lstsq(legvander(x[known], DEGREES), h[known], rcond=None)
    return np.asarray(found[1:] / found[0])
