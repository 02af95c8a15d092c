"""The shapes of friction of all motors: those that are taken out, and those that fit nearly as well."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from elastid.base.arrays import FloatArray, IntArray
from elastid.frf.friction.alternatives import neighbours_of
from elastid.frf.friction.levels import find_levels, normal_equations
from elastid.frf.friction.selection import MAX_KEPT_SHARE, choose_shapes
from elastid.frf.friction.shapes import RATE_OF, Shape
from elastid.frf.friction.spectra import ConfigurationSpectra

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
