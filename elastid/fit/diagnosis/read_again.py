"""The fit to responses that are read another way: times a factor, on fewer lines, roughly solved."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from elastid.base.arrays import ComplexArray, FloatArray
from elastid.base.errors import FitError
from elastid.fit.problem.elastic import ElasticFit, Part
from elastid.fit.solve.solvers import ROUGH, solve

# Lines of a configuration that are fitted, and iterations of each solve.
MAX_LINES = 40
MAX_ITERATIONS = 60


def times(fit: ElasticFit, factors: Sequence[ComplexArray | FloatArray]) -> ElasticFit:
    """The fit to measured responses times a factor (F, n_y, n_u) each, relative weights kept."""
    return replace(fit, parts=tuple(map(_part_times, fit.parts, factors)))


def _part_times(part: Part, factor: ComplexArray | FloatArray) -> Part:
    if part.criterion == "log":  # of the ratio, whose errors are relative already
        return replace(part, measured=part.measured * factor)
    size = np.broadcast_to(np.abs(factor), part.gain.shape)
    mixing = part.mixing
    if mixing is not None:
        turn = np.broadcast_to(factor / np.abs(factor), part.gain.shape)
        mixing = mixing * np.conj(turn).reshape(len(turn), 1, -1)
    return replace(part, measured=part.measured * factor, gain=part.gain / size, mixing=mixing)


def thinned(fit: ElasticFit, lines: int = MAX_LINES) -> ElasticFit:
    """The fit on every so many lines, at most `lines` of a configuration."""

    def thin(part: Part) -> Part:
        keep = slice(None, None, math.ceil(len(part.measured) / lines))
        kernel = replace(part.kernel, freq_hz=part.kernel.freq_hz[keep])
        mixing = None if part.mixing is None else part.mixing[keep]
        return replace(part, kernel=kernel, measured=part.measured[keep], gain=part.gain[keep], mixing=mixing)

    return replace(fit, parts=tuple(thin(part) for part in fit.parts))


def roughly_solved(fit: ElasticFit, x: FloatArray) -> tuple[float, FloatArray]:
    """V and x (n_x,) of an optimum from x; an infinite V where the solver fails."""
    try:
        end = solve(fit.problem, x, ROUGH, MAX_ITERATIONS)
    except FitError:
        return math.inf, x
    return end.cost, end.x
