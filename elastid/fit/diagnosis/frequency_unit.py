"""Whether all stiffnesses suggest frequencies in another unit, which no residual shows."""

from __future__ import annotations

import math

import numpy as np

from elastid.base.note import Note
from elastid.fit.result import FitResult

# The spread of the factors (2 pi)^2 by which all stiffnesses are off where the unit of the frequency is wrong.
MAX_FACTOR_SPREAD = 2.5
# Relative standard deviation of a stiffness that counts there.
MAX_STIFFNESS_STD = 0.5


def find_wrong_frequency_unit(result: FitResult) -> tuple[Note, ...]:
    r"""A note where all stiffnesses suggest frequencies in rad/s instead of Hz, or the other way round.

    An acceleration per torque is the same for K, D at omega and (2 pi)^2 K, 2 pi D at 2 pi omega: no residual shows it.
    """
    known = np.sqrt(np.diag(result.covariance)) < MAX_STIFFNESS_STD
    stiff = [i for i, p in enumerate(result.parameters.free) if p.log and p.unit in ("N*m/rad", "N/m") and known[i]]
    if not stiff:
        return ()
    change = result.x[stiff] - result.parameters.x[stiff]
    expected = 2 * math.log(2 * math.pi) * np.sign(np.median(change))
    if np.any(np.abs(change - expected) > math.log(MAX_FACTOR_SPREAD)):
        return ()
    factor = math.exp(abs(float(np.median(change))))
    names = ", ".join(result.parameters.free[i].name for i in stiff)
    side, unit, other = ("above", "rad/s", "Hz") if expected > 0 else ("below", "Hz", "rad/s")
    return (
        Note(
            "frequency-unit",
            f"{factor:.0f} times {side} the start, and (2 pi)^2 is 39: are the frequencies of the responses in "
            f"{unit}, where {other} was taken? Then all stiffnesses are off by it, and no residual shows it",
            names,
        ),
    )
