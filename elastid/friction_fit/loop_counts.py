"""Loops before sliding against the counts of the encoder that sees them."""

from __future__ import annotations

import numpy as np

from elastid.base.arrays import FloatArray
from elastid.base.errors import DataError
from elastid.base.note import Note
from elastid.friction_record import FrictionRecord

# Counts of a loop's amplitude below which it is steps of the encoder.
MIN_COUNTS = 3.0
# Share of the loops that may be as small.
MAX_SMALL_SHARE = 0.5


def check_counts(record: FrictionRecord) -> tuple[Note, ...]:
    """A note on loops of fewer than three counts; DataError where most are."""
    if record.resolution <= 0:
        return ()
    amplitudes = _amplitudes(record)
    counts = amplitudes / record.resolution
    small = int(np.sum(counts < MIN_COUNTS))
    if not small:
        return ()
    where = f"loops {record.name} of joint {record.joint}"
    said = (
        f"{small} of {len(counts)} half loops move by less than {MIN_COUNTS:g} counts of the encoder "
        f"({record.resolution:.3g} {record.unit} each; the smallest has {counts.min():.2g})"
    )
    if small > MAX_SMALL_SHARE * len(counts):
        raise DataError(
            f"{where}: {said}: stiffness before sliding cannot be seen in steps; raise the torque of the loops, or "
            "measure with a finer encoder"
        )
    return (Note("small-loops", f"{said}: they tell little of the stiffest elements", where, "information"),)


def _amplitudes(record: FrictionRecord) -> FloatArray:
    """Travel of each half loop: by its period where it has one, else from one change of the torque's sign to the next.

    Noise changes the sign of a small torque too, which a period is free of.
    """
    if record.period_samples is not None:
        ends = np.arange(0, len(record.position), record.period_samples / 2)[1:].astype(int)
    else:
        ends = np.flatnonzero(np.diff(np.sign(record.torque - record.torque.mean())) != 0) + 1
    halves = [part for part in np.split(record.position, ends) if len(part) > 1]
    return np.array([np.ptp(part) for part in halves])
