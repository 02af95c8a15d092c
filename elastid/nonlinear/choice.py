r"""The shapes of friction of all motors, by cross-validation over realisations, and those that fit nearly as well.

Candidates are on the scale of the motors' own motion; one is taken out only where it pays. The choice between shapes
that fit nearly as well adds to the levels' covariance: with levels f ~ N(0, S), S = diag(s_i^2), the evidence of a set
of shapes, their levels integrated out, is

.. math:: \ln p = \tfrac12 b^T \hat f - \tfrac12 \ln \det(S H), \qquad H = A + S^{-1}, \quad \hat f = H^{-1} b

s_i: the level at which a shape has the power of all friction that was found. Sets are the chosen one and its
neighbours: one shape more, less, or another in its place. With weights w_S = p_S / sum p,

.. math:: C = \sum_S w_S\, (\hat f_S - \hat f)(\hat f_S - \hat f)^T

about the levels of the chosen set. (Hoeting, Madigan, Raftery and Volinsky, Statistical Science 14, 1999.)

Shapes near the chosen ones, whose signs turn over a speed of their own and not over one of those that were tried.

Signs are tried at speeds a factor 2 apart. Where friction turns over a speed between two of them, both together come
out as friction that is 0.1 to 0.2 % too large in sliding; two that are near each other, and near the speed at which it
turns, leave a tenth of that.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from elastid.base.arrays import FloatArray, IntArray
from elastid.nonlinear.levels import NormalEquations, find_levels, normal_equations, solve
from elastid.nonlinear.motion import Motion, motion_of
from elastid.nonlinear.shapes import RATE_OF, Kind, Shape
from elastid.nonlinear.spectra import ConfigurationSpectra
from elastid.record import Record

# Of the power of a shape, at least: a sign in a multisine has 0.36 to 0.6, a stop operator longer than the motion 0.
MIN_NONLINEAR_SHARE = 0.05


@dataclass(frozen=True)
class Choice:
    """Shapes with the motor of each (n_f,), and the share (n_m,) of the power that they leave in other realisations.

    taken: of the shapes, those that are taken out; the others fit nearly as well.  covariance (n_f, n_f): of the levels
    by the choice between them.
    """

    shapes: tuple[Shape, ...]
    motor_of: IntArray
    kept_share: FloatArray
    taken: IntArray
    covariance: FloatArray


@dataclass(frozen=True)
class Kept:
    """The candidates (n,) that are shapes of a choice, and rates (n,): thresholds of those whose rates are, else 0."""

    candidates: IntArray
    rates: FloatArray


def choose(
    data: Sequence[ConfigurationSpectra], candidates: Sequence[Shape], places: Sequence[str], auto: bool
) -> tuple[Choice, Kept]:
    """Shapes by cross-validation: first signs and bristles, then the rates of those that were chosen.

    With those of all candidates that are kept.
    """
    motor_of = np.array([places.index(shape.place) for shape in candidates], dtype=np.int64)
    chosen, _ = _chosen_of_each(data, motor_of, len(places), auto)
    rates = np.array([candidates[i].threshold if candidates[i].kind in RATE_OF else 0.0 for i in chosen])
    shapes = _with_rates([candidates[i] for i in chosen], rates)
    motor_of = np.array([places.index(shape.place) for shape in shapes], dtype=np.int64)
    final, kept = _chosen_of_each([each.with_shapes(chosen, rates) for each in data], motor_of, len(places), auto)
    # A rate is derived from the shape of its bristle.
    bending, rated = final[final < len(chosen)], np.flatnonzero(rates > 0)[final[final >= len(chosen)] - len(chosen)]
    every = np.arange(len(candidates))
    rates_of_all = np.zeros(len(candidates))
    rates_of_all[chosen[rated]] = rates[rated]
    data = [each.with_shapes(every, rates_of_all) for each in data]
    taken = np.concatenate([chosen[bending], len(candidates) + np.arange(len(rated))])
    return _with_alternatives(data, candidates, rates_of_all, places, kept, taken)


def _with_alternatives(
    data: Sequence[ConfigurationSpectra],
    candidates: Sequence[Shape],
    rates: FloatArray,
    places: Sequence[str],
    kept: FloatArray,
    taken: IntArray,
) -> tuple[Choice, Kept]:
    """The choice of the shapes `taken` of all candidates and rates, with those candidates that fit nearly as well."""
    shapes = _with_rates(candidates, rates)
    motor_of = np.array([places.index(shape.place) for shape in shapes], dtype=np.int64)
    telling = np.mean([each.nonlinear_share() for each in data], axis=0) > MIN_NONLINEAR_SHARE
    telling[len(candidates) :] = False
    levels = np.zeros(len(shapes))
    own_data = [replace(each, Phi=each.Phi[:, taken]) for each in data]
    levels[taken], _ = find_levels(own_data, motor_of[taken], np.arange(len(taken)))
    found = normal_equations(data, levels, motor_of)
    covariance = np.zeros((len(shapes), len(shapes)))
    used = np.arange(len(shapes)) >= len(candidates)
    used[np.flatnonzero(rates > 0)] = True
    for i in range(len(places)):
        own = neighbours_of(found, taken[motor_of[taken] == i], np.flatnonzero(telling & (motor_of == i)))
        covariance[np.ix_(own.shapes, own.shapes)] = own.covariance
        used[own.shapes] = True
    some = np.flatnonzero(used)
    picked = some[some < len(candidates)]
    choice = Choice(
        shapes=tuple(shapes[i] for i in some),
        motor_of=motor_of[some],
        kept_share=kept,
        taken=np.searchsorted(some, taken),
        covariance=covariance[np.ix_(some, some)],
    )
    return choice, Kept(picked, rates[picked])


def _chosen_of_each(
    data: Sequence[ConfigurationSpectra], motor_of: IntArray, n_m: int, auto: bool
) -> tuple[IntArray, FloatArray]:
    """The chosen shapes (n,) of all motors, and the share (n_m,) of the power that they leave."""
    _, found = find_levels(data, motor_of, np.arange(len(motor_of)))
    # A shape in proportion to the motion is a spring or a damper: the response has it, no distortion tells its level.
    telling = np.mean([each.nonlinear_share() for each in data], axis=0) > MIN_NONLINEAR_SHARE
    choices = [choose_shapes(found, i, np.flatnonzero((motor_of == i) & telling)) for i in range(n_m)]
    pays = [own if not auto or kept <= MAX_KEPT_SHARE else own[:0] for own, kept in choices]
    return np.concatenate(pays), np.array([kept for _, kept in choices])


def _with_rates(shapes: Sequence[Shape], rates: FloatArray) -> tuple[Shape, ...]:
    own = [
        replace(shape, kind=RATE_OF[shape.kind], threshold=float(D))
        for shape, D in zip(shapes, rates, strict=True)
        if D > 0
    ]
    return (*shapes, *own)


# Speeds over which a sign turns, over the RMS speed.
_TURNING = (0.0, 0.005, 0.01, 0.02, 0.04, 0.08)
# Distances over which a bristle bends, over the median distance between reversals. A much longer one is a spring, which
# is part of the response. Steps of 2 instead of its root leave k up to four times as far off under LuGre.
_BENDING = tuple(0.025 * 2 ** (i / 2) for i in range(15))
_BRISTLES: tuple[Kind, ...] = ("stop", "bristle")


def candidate_shapes(records: Sequence[Record], signs_alone: bool) -> tuple[Shape, ...]:
    """For every motor a sign, at once or gradual, and bristles."""
    shapes: list[Shape] = []
    for place in records[0].inputs:
        motions = [motion_of(record, place) for record in records]
        speed = float(np.sqrt(np.mean([motion.speed**2 for motion in motions])))
        shapes += [Shape(place, "sign", part * speed) for part in _TURNING]
        swing = _typical_swing(motions)
        if not signs_alone and swing > 0:
            shapes += [Shape(place, kind, part * swing) for kind in _BRISTLES for part in _BENDING]
    return tuple(shapes)


def _typical_swing(motions: Sequence[Motion]) -> float:
    swings = np.concatenate([motion.swings for motion in motions])
    return float(np.median(swings)) if swings.size else 0.0


# A further shape must lower the power that is left in other realisations by this part of it.
_MIN_SHAPE_GAIN = 0.02
# Friction is taken out of a motor where at most this share of the power is left in other realisations.
MAX_KEPT_SHARE = 0.5


def kept_power(found: NormalEquations, motor: int, chosen: IntArray) -> float:
    """Power that `chosen` shapes leave of a motor's residual, each realisation by the levels of all others."""
    total = float(found.c[:, motor].sum())
    if not len(chosen):
        return total
    A, b = found.A[np.ix_(np.arange(len(found.A)), chosen, chosen)], found.b[:, chosen]
    left = 0.0
    for m in range(len(A)):
        f = solve(A.sum(axis=0) - A[m], b.sum(axis=0) - b[m])
        left += float(found.c[m, motor] - 2 * b[m] @ f + f @ A[m] @ f)
    return left


def choose_shapes(found: NormalEquations, motor: int, candidates: IntArray) -> tuple[IntArray, float]:
    """The shapes of a motor, added one at a time as long as another pays; and the share of the power that they leave.

    The first candidate is Coulomb friction: it goes where others explain its part.
    """
    chosen: list[int] = []
    left = total = kept_power(found, motor, candidates[:0])
    while len(chosen) < len(candidates):
        others = [each for each in candidates.tolist() if each not in chosen]
        powers = [kept_power(found, motor, np.array([*chosen, each])) for each in others]
        best = int(np.argmin(powers))
        if powers[best] > (1 - _MIN_SHAPE_GAIN) * left:
            break
        chosen.append(others[best])
        left = powers[best]
    share = left / total if total > 0 else 1.0
    return _without_needless(found, motor, np.array(sorted(chosen), dtype=np.int64), left), share


def _without_needless(found: NormalEquations, motor: int, chosen: IntArray, left: float) -> IntArray:
    """Without those that others have made needless."""
    for each in chosen.tolist():
        rest = chosen[chosen != each]
        if len(rest) and kept_power(found, motor, rest) <= (1 + _MIN_SHAPE_GAIN / 2) * left:
            return _without_needless(found, motor, rest, left)
    return chosen


def shares(found: NormalEquations, motors: int, motor_of: IntArray, chosen: IntArray) -> FloatArray:
    """Share (n_m,) of the power that the chosen shapes (n,) of each motor leave in other realisations."""
    every = [chosen[motor_of[chosen] == motor] for motor in range(motors)]
    none = motor_of[:0]
    powers = [(kept_power(found, i, own), kept_power(found, i, none)) for i, own in enumerate(every)]
    return np.array([left / total if total > 0 else 1.0 for left, total in powers])


# Sets of a lower weight than this are left out, and shapes that are in no other set.
_MIN_WEIGHT = 0.05


@dataclass(frozen=True)
class Neighbours:
    """Shapes (n,) of a motor, sorted, in sets of some weight; covariance (n, n) of levels by the choice of a set."""

    shapes: IntArray
    covariance: FloatArray


def neighbours_of(found: NormalEquations, chosen: IntArray, candidates: IntArray) -> Neighbours:
    """The neighbours of the chosen shapes (n,) of one motor among its candidates, these among them."""
    if not len(chosen):
        return Neighbours(chosen, np.zeros((0, 0)))
    A, b = (2 * found.dof_share * each.sum(axis=0) for each in (found.A, found.b))
    f = solve(A[np.ix_(chosen, chosen)], b[chosen])
    power = float(f @ A[np.ix_(chosen, chosen)] @ f)
    first, *others = _sets(chosen.tolist(), candidates.tolist())
    sets = [first, *(each for each in others if _is_possible(A, b, each))]
    evidence = np.array([_evidence(A[np.ix_(each, each)], b[each], power) for each in sets])
    weights = np.exp(evidence - evidence.max())
    weights /= weights.sum()
    kept = [(w, each) for w, each in zip(weights.tolist(), sets, strict=True) if w >= _MIN_WEIGHT]
    shapes = np.array(sorted({*chosen.tolist(), *(i for _, each in kept for i in each)}), dtype=np.int64)
    levels = [_levels(A, b, each, shapes) for _, each in kept]
    apart = np.array(levels) - _levels(A, b, chosen.tolist(), shapes)
    w = np.array([each for each, _ in kept])
    return Neighbours(shapes, np.asarray((apart.T * (w / w.sum())) @ apart))


def _sets(chosen: list[int], candidates: list[int]) -> list[list[int]]:
    """The chosen set, and with one shape more, less, or another in its place; none is empty."""
    others = [i for i in candidates if i not in chosen]
    smaller = [[i for i in chosen if i != gone] for gone in chosen]
    larger = [[*base, i] for base in (chosen, *smaller) for i in others]
    return [chosen, *(each for each in smaller if each), *larger]


def _is_possible(A: FloatArray, b: FloatArray, shapes: list[int]) -> bool:
    """True if all levels are positive."""
    return bool(np.all(solve(A[np.ix_(shapes, shapes)], b[shapes]) > 0))


def _evidence(A: FloatArray, b: FloatArray, power: float) -> float:
    s = np.sqrt(power / np.diag(A))
    H, b = A * np.outer(s, s) + np.eye(len(b)), b * s
    return float(0.5 * b @ np.linalg.solve(H, b) - 0.5 * np.linalg.slogdet(H)[1])


def _levels(A: FloatArray, b: FloatArray, shapes: list[int], every: IntArray) -> FloatArray:
    """The levels (n,) of a set of shapes, 0 of all others of `every` (n,)."""
    levels = np.zeros(len(every))
    levels[np.searchsorted(every, shapes)] = solve(A[np.ix_(shapes, shapes)], b[shapes])
    return levels


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
