"""Where friction found in records ends: motors that stick, and motors whose torque is no input."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from elastid.base.note import Note
from elastid.frf.friction.motion import motion_of
from elastid.record import Record

# A velocity below this part of its RMS, or below so many times its noise, is none.
_STILL, _NOISES = 0.01, 2.0
# A motor that is still for this part of the time sticks; one of Gaussian velocity is for at most 5 %.
_MIN_STICKING = 0.2


def limits_of(records: Sequence[Record]) -> tuple[Note, ...]:
    """Notes on the motors of a configuration, from the first of its records."""
    first = records[0]
    notes = []
    for place in first.inputs:
        motion = motion_of(first, place)
        still = max(_STILL * motion.speed, _NOISES * motion.velocity_noise)
        share = float(np.mean(np.abs(motion.velocity) <= still))
        if share > _MIN_STICKING:
            text = (
                f"{place} hardly moves for {100 * share:.0f} % of the time in configuration "
                f"{first.configuration.name}: it sticks, friction is then a spring of bristles, which stays in the "
                "responses; excite it more, or move it by a carrier"
            )
            notes.append(Note("friction-sticks", text))
    others = [place for place in first.outputs if place.startswith("motor ") and place not in first.inputs]
    if others:
        names = ", ".join(others)
        text = (
            f"{names}: friction stays in the responses, since the torque of {names} is not among the inputs; log it "
            "and excite it, or take what the responses call viscous friction there for dry friction as well"
        )
        notes.append(Note("friction-left", text, severity="information"))
    return tuple(notes)


def torque_is_reference(record: Record) -> tuple[str, ...]:
    """Inputs whose logged torque equals the reference to the last bit."""
    if record.r is None:
        return ()
    same = np.all(record.u == record.r, axis=0)
    return tuple(place for place, equal in zip(record.inputs, same.tolist(), strict=True) if equal)
