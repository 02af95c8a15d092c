"""Faults of passes that would be taken for friction: clipped torques, loads that are no loads, offsets that move."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from scipy.stats import f as f_distribution

from elastid.base.arrays import FloatArray
from elastid.base.errors import DataError
from elastid.base.note import Note
from elastid.friction_fit.pass_regression import Pass

# Equal samples in a row at the largest torque of all passes, and their share of a pass, from which on it is clipped; a
# noise-free torque is constant throughout.
CLIPPED_RUN, CLIPPED_SHARE, CONSTANT_SHARE = 3, 0.02, 0.98
# Values that a pass takes in a log with fine steps.
MIN_VALUES = 50
# A load that equals the torque this closely, in pairs whose torques differ by as much, is that torque.
SAME_TORQUE, DIFFERENT_TORQUES = 0.01, 0.05
# Chance of a step of the offset where there is none, over all places at which one may be; and its least size, as a
# share of the smallest level.
STEP_CHANCE, STEP_SHARE = 1e-3, 0.1
SAME_LOAD = 0.05
# Gravity over friction from which on a small error of gravity is a large one of friction.
LARGE_GRAVITY = 50.0


def usable_passes(passes: Sequence[Pass]) -> tuple[list[Pass], list[Note]]:
    """The passes that slide all the time below the drive's limit, and notes on the others, whose pair goes with them.

    DataError where none is left.
    """
    faults = {each.pair: _sticking(each) for each in passes if each.turns_back} | _clipped(passes)
    notes = [Note(code, text, f"pass {name}") for name, (code, text) in faults.items()]
    used = [each for each in passes if each.pair not in faults]
    if not used:
        place = passes[0].place if passes else "the joint"
        said = f"; {notes[0]}" if notes else ""
        raise DataError(
            f"passes of {place}: none slides all the time; measure faster, or raise the bandwidth of the "
            f"controller{said}"
        )
    return used, notes


def _sticking(each: Pass) -> tuple[str, str]:
    return "stick-slip", (
        f"the joint stands or turns back within the pass (velocity {each.velocity.min():.3g} to "
        f"{each.velocity.max():.3g}): it sticks and slips at this speed, and its level does not count; raise the "
        "bandwidth of the controller, or measure faster"
    )


def _clipped(passes: Sequence[Pass]) -> dict[str, tuple[str, str]]:
    """Pairs in which a torque stands at the largest of all passes."""
    limit = max((float(np.abs(each.torque).max()) for each in passes), default=0.0)
    found: dict[str, tuple[str, str]] = {}
    for each in passes:
        at_limit = np.abs(each.torque) == limit
        run, share = np.convolve(at_limit, np.ones(CLIPPED_RUN), "valid").max(initial=0.0), float(np.mean(at_limit))
        # The steps of a coarse converter are no limit.
        if run >= CLIPPED_RUN and CLIPPED_SHARE <= share < CONSTANT_SHARE and len(np.unique(each.torque)) > MIN_VALUES:
            found[each.pair] = (
                "clipped-pass",
                (
                    f"{share:.0%} of its torques stand at the limit of {limit:.4g}: clipped there, so that its level "
                    "is too low and does not count; measure slower, or raise the limit of the drive"
                ),
            )
    return found


def check_loads(passes: Sequence[Pass]) -> None:
    """DataError where the load of passes is the very torque that they are to explain."""
    torque = np.array([abs(float(each.torque.mean())) for each in passes])
    load = np.array([each.load for each in passes])
    if len(passes) < 3 or not load.any() or np.ptp(torque) < DIFFERENT_TORQUES * torque.max():
        return
    if np.all(np.abs(load - torque) <= SAME_TORQUE * torque.max()):
        raise DataError(
            f"passes of {passes[0].place}: the load of each equals its own torque ({load.min():.4g} to "
            f"{load.max():.4g}): friction would explain itself; the load is the torque of gravity that the model holds "
            "in that posture"
        )


def offset_steps(
    offset: FloatArray,
    speed: FloatArray,
    load: FloatArray,
    names: Sequence[str],
    level: FloatArray,
    place: str,
    slides: bool,
) -> tuple[Note, ...]:
    """A note for each load on offsets of pairs (n,), in the order in which they were measured, that jump between two.

    What grows with speed is no offset but friction of unlike directions.
    """
    unit = "N" if slides else "N*m"
    found = [_offset_step(offset[own], speed[own], [names[i] for i in own], level[own], unit) for own in _groups(load)]
    return tuple(Note("moved-offset", text, f"passes of {place}") for text in found if text)


def _groups(load: FloatArray) -> list[list[int]]:
    """Pairs of one load, to a twentieth of the largest."""
    rounded = np.round(load / max(float(load.max(initial=0.0)), 1e-300) / SAME_LOAD)
    return [np.flatnonzero(rounded == value).tolist() for value in np.unique(rounded)]


def _offset_step(offset: FloatArray, speed: FloatArray, names: Sequence[str], level: FloatArray, unit: str) -> str:
    """The sentence on a jump; empty without one."""
    n = len(offset)
    smooth = np.stack([np.ones(n), speed], axis=1)
    dof = n - 3
    if dof < 2:
        return ""
    without = _left(smooth, offset)
    costs = [_left(np.column_stack([smooth, np.arange(n) >= k]), offset) for k in range(1, n)]
    k = 1 + int(np.argmin(costs))
    size = float(np.linalg.lstsq(np.column_stack([smooth, np.arange(n) >= k]), offset, rcond=None)[0][2])
    ratio = (without - costs[k - 1]) / max(costs[k - 1] / dof, 1e-300)
    is_chance = f_distribution.sf(ratio, 1, dof) * (n - 1) > STEP_CHANCE
    if is_chance or abs(size) < STEP_SHARE * float(np.abs(level).min()):
        return ""
    return (
        f"their offset jumps by {size:.4g} {unit} between pass {names[k - 1]} and pass {names[k]}: controller, sensor "
        "or posture were moved in between, and the levels of both sides are compared as if nothing had; measure them "
        "again in one go, or in studies of their own"
    )


def _left(A: FloatArray, y: FloatArray) -> float:
    """Sum of squares that the columns leave."""
    left = y - A @ np.linalg.lstsq(A, y, rcond=None)[0]
    return float(left @ left)


def gravity_note(
    shared: Mapping[str, tuple[float, float]], levels: FloatArray, place: str, slides: bool
) -> tuple[Note, ...]:
    """A note on gravity that is much larger than friction."""
    if "gravity.cos" not in shared or not len(levels):
        return ()
    gravity, friction = float(np.hypot(shared["gravity.cos"][0], shared["gravity.sin"][0])), float(np.median(levels))
    if gravity < LARGE_GRAVITY * friction:
        return ()
    unit = "N" if slides else "N*m"
    text = (
        f"gravity of {gravity:.4g} {unit} is {gravity / friction:.0f} times friction ({friction:.4g} {unit}): an error "
        f"of {1 / LARGE_GRAVITY:.0%} in it is as large as friction, and the std of the levels is mostly its; measure "
        "about the vertical, in a posture with less gravity, or with a counterweight"
    )
    return (Note("large-gravity", text, f"passes of {place}"),)
