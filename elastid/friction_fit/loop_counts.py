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
    amplitudes = _amplitudes(record.position, record.torque)
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


def _amplitudes(position: FloatArray, torque: FloatArray) -> FloatArray:
    """Travel between one change of the torque's sign and the next: from the middle of a loop to its end."""
    changes = np.flatnonzero(np.diff(np.sign(torque - torque.mean())) != 0) + 1
    halves = [part for part in np.split(position, changes) if len(part) > 1]
    return np.array([np.ptp(part) for part in halves])
