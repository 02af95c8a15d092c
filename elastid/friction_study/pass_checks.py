r"""Faults of passes that would be taken for friction: clipped torques, and sticking.

Friction that changes with the angle of its joint is found by the difference of passes there and back at the same angle.

.. math:: h(q) = \frac{u_{there}(q) - u_{back}(q)}{2} - J \frac{a_{there} - a_{back}}{2}

is friction alone: gravity, ripple and offsets of the torque are the same in both directions. Of each pair h over its
mean is fitted by Legendre polynomials of the angle; shapes that all pairs have in common are no noise.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.polynomial.legendre import legval, legvander
from scipy.special import stdtrit

from elastid.base.arrays import FloatArray
from elastid.base.errors import DataError
from elastid.base.note import Note
from elastid.friction_study.least_squares import FALSE_ALARM
from elastid.friction_study.passes import Pass
from elastid.record import FrictionRecord, motion_unit


@dataclass(frozen=True)
class PassThresholds:
    """Thresholds of the judgement of passes; shares are of the quantity that is named."""

    clipped_run: int = 3  # equal samples in a row at the largest torque of all passes
    clipped_share: float = 0.02  # of a pass, at that torque, from which on it is clipped
    constant_share: float = 0.98  # of a pass: a torque without noise is constant throughout
    min_values: int = 50  # different torques of a pass in a log of fine steps
    min_pairs: int = 4  # from which a change of friction with the angle can be identified
    min_cover: float = 0.6  # of the widest range of angles, below which a pair is left out of that test
    min_change: float = 0.03  # of friction with the angle, relative, that is worth a note
    min_counts: float = 3.0  # amplitude of a loop in counts, below which it is steps of the encoder


PASSES = PassThresholds()


def usable_passes(passes: Sequence[Pass]) -> tuple[list[Pass], list[Note]]:
    """The passes that slide below the drive's limit, and notes on the others, whole pairs; DataError where none is."""
    sticking = {
        each.pair: f"the joint stands or turns back within the pass (velocity {each.velocity.min():.3g} to "
        f"{each.velocity.max():.3g}): it sticks and slips at this speed, and its level does not count; raise the "
        "bandwidth of the controller, or measure faster"
        for each in passes
        if each.turns_back
    }
    faults = {pair: ("friction/passes", text) for pair, text in sticking.items()}
    faults |= {pair: ("friction/passes", text) for pair, text in _clipped(passes).items()}
    notes = [Note(code, text, f"pass {name}") for name, (code, text) in faults.items()]
    used = [each for each in passes if each.pair not in faults]
    if not used:
        place = passes[0].place if passes else "the joint"
        reason = f"; {notes[0]}" if notes else ""
        raise DataError(
            "friction/passes",
            f"none slides all the time; measure faster, or raise the bandwidth of the controller{reason}",
            f"passes of {place}",
        )
    return used, notes


def _clipped(passes: Sequence[Pass]) -> dict[str, str]:
    """Pairs in which a torque stands at the largest of all passes."""
    limit = max((float(np.abs(each.torque).max()) for each in passes), default=0.0)
    pairs: dict[str, str] = {}
    for each in passes:
        at_limit = np.abs(each.torque) == limit
        run = np.convolve(at_limit, np.ones(PASSES.clipped_run), "valid").max(initial=0.0)
        share = float(np.mean(at_limit))
        # The steps of a coarse converter are no limit.
        if (
            run >= PASSES.clipped_run
            and PASSES.clipped_share <= share < PASSES.constant_share
            and len(np.unique(each.torque)) > PASSES.min_values
        ):
            pairs[each.pair] = (
                f"{share:.0%} of its torques stand at the limit of {limit:.4g}: clipped there, so that its level is "
                "too low and does not count; measure slower, or raise the limit of the drive"
            )
    return pairs


# Degrees of the polynomials, and bins of the angle.
DEGREES, BINS = 3, 24


def angle_note(passes: Sequence[Pass], inertia: float) -> Note | None:
    """A note where friction changes with the angle by more than pairs scatter; inertia: J of the passes."""
    of_pair: dict[str, dict[float, Pass]] = {}
    for each in passes:
        of_pair.setdefault(each.pair, {}).setdefault(each.direction, each)
    pairs = [(ways[1.0], ways[-1.0]) for ways in of_pair.values() if len(ways) == 2]
    # Lowest and highest position that both directions have.
    lows = np.array([max(float(each.position.min()) for each in pair) for pair in pairs])
    highs = np.array([min(float(each.position.max()) for each in pair) for pair in pairs])
    is_wide = highs - lows > PASSES.min_cover * (highs - lows).max(initial=0.0)
    if is_wide.sum() < PASSES.min_pairs:
        return None
    low, high = float(lows[is_wide].max()), float(highs[is_wide].min())
    shapes = np.array([_shape(pairs[i], inertia, low, high) for i in np.flatnonzero(is_wide)])
    mean = shapes.mean(axis=0)
    std = shapes.std(axis=0, ddof=1) / np.sqrt(len(shapes))
    limit = stdtrit(len(shapes) - 1, 1 - FALSE_ALARM / 2 / DEGREES)
    clear = np.where(np.abs(mean) > limit * std, mean, 0.0)
    change = float(np.ptp(legval(np.linspace(-1, 1, 101), np.append(0.0, clear))))
    if change < PASSES.min_change:
        return None
    unit = motion_unit("position", passes[0].slides)
    text = (
        f"friction changes by {change:.0%} of itself with the position, between {low:.3g} and {high:.3g} {unit}, and "
        "its law has no such change: levels are means over the positions of each pass, and slow passes that cover "
        "fewer of them deviate from the curve; give all passes one window, or take the law to hold there only"
    )
    return Note("friction/by-angle", text, passes[0].place)


def _shape(pair: tuple[Pass, Pass], inertia: float, low: float, high: float) -> FloatArray:
    """Coefficients (DEGREES,) of h over its mean, between two positions."""
    edges = np.linspace(low, high, BINS + 1)
    means = []
    for each in pair:
        bins = np.clip(np.digitize(each.position, edges) - 1, 0, BINS - 1)
        used = (each.position >= low) & (each.position <= high)
        count = np.bincount(bins[used], minlength=BINS)
        total = np.bincount(bins[used], (each.torque - inertia * each.acceleration)[used], BINS)
        means.append(np.divide(total, count, out=np.full(BINS, np.nan), where=count > 0))
    h = (means[0] - means[1]) / 2
    known = np.isfinite(h)
    x = np.linspace(-1, 1, 2 * BINS + 1)[1::2]
    if known.sum() <= DEGREES + 1:
        return np.zeros(DEGREES)
    coefficients, *_ = np.linalg.lstsq(legvander(x[known], DEGREES), h[known], rcond=None)
    return np.asarray(coefficients[1:] / coefficients[0])


def check_reversal(record: FrictionRecord) -> None:
    """DataError for loops without a way back."""
    if np.count_nonzero(np.diff(np.sign(record.torque - record.torque.mean()))) == 1:
        raise DataError(
            "friction/presliding",
            f"loops of joint {record.joint}: its torque never reverses, so that friction cannot be "
            "distinguished from a spring; log loops to and fro, or take purpose: motion",
            record.place,
        )
