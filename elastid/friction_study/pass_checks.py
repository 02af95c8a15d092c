"""Faults of passes that would be taken for friction: clipped torques, and sticking."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from elastid.base.errors import DataError
from elastid.base.note import Note
from elastid.friction_study.passes import Pass
from elastid.record import FrictionRecord


@dataclass(frozen=True)
class PassThresholds:
    """Thresholds of the judgement of passes; shares are of the quantity that is named."""

    clipped_run: int = 3  # equal samples in a row at the largest torque of all passes
    clipped_share: float = 0.02  # of a pass, at that torque, from which on it is clipped
    constant_share: float = 0.98  # of a pass: a torque without noise is constant throughout
    min_values: int = 50  # different torques of a pass in a log of fine steps
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


def check_reversal(record: FrictionRecord) -> None:
    """DataError for loops without a way back."""
    if np.count_nonzero(np.diff(np.sign(record.torque - record.torque.mean()))) == 1:
        raise DataError(
            "friction/presliding",
            f"loops of joint {record.joint}: its torque never reverses, so that friction cannot be "
            "distinguished from a spring; log loops to and fro, or take purpose: motion",
            record.place,
        )
