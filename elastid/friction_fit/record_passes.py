"""The passes of a record: its plateaus with velocity and acceleration."""

from __future__ import annotations

import numpy as np
from scipy.signal import butter, sosfiltfilt

from elastid.base.arrays import FloatArray
from elastid.friction_fit.pass_regression import Pass
from elastid.friction_record import FrictionRecord

# Position is smoothed above, before it is differentiated: speeds and ripple of a pass are slower.
SMOOTHED_HZ = 60.0


def passes_of(record: FrictionRecord) -> tuple[Pass, ...]:
    """There and back of one record of passes, as one pair; whichever of both it has."""
    velocity, acceleration = motion_of(record)
    # Gravity is that of the angle at which the torque acts; half a sample's travel turns it with the direction.
    position = record.position + record.torque_delay_s * velocity
    return tuple(
        Pass(
            f"joint {record.joint}",
            record.name,
            record.rate_hz,
            position[part],
            velocity[part],
            acceleration[part],
            record.torque[part],
            record.load_torque,
            _mean_temperature(record, part),
            record.slides,
            record.load,
        )
        for part in (_inner(*window, record.rate_hz) for window in (record.there, record.back) if window is not None)
    )


def motion_of(record: FrictionRecord) -> tuple[FloatArray, FloatArray]:
    """Velocity, as measured where it was, and acceleration (n,)."""
    smooth = butter(2, min(SMOOTHED_HZ, 0.45 * record.rate_hz), fs=record.rate_hz, output="sos")
    if record.velocity is not None:
        velocity = record.velocity
    else:
        velocity = np.gradient(sosfiltfilt(smooth, record.position), 1 / record.rate_hz)
    return velocity, np.gradient(sosfiltfilt(smooth, velocity), 1 / record.rate_hz)


def _inner(start: int, stop: int, rate_hz: float) -> slice:
    """A plateau without its ends, into which the filter brings the ramps; of a short one at most a tenth each."""
    margin = min(int(rate_hz / SMOOTHED_HZ) + 1, (stop - start) // 10)
    return slice(start + margin, stop - margin)


def _mean_temperature(record: FrictionRecord, part: slice) -> float:
    known = np.zeros(0) if record.temperature is None else record.temperature[part]
    known = known[np.isfinite(known)]
    return float(known.mean()) if len(known) else float("nan")
