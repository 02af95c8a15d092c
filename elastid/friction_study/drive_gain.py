r"""The gain of a drive from motions of one joint with a known payload once on and once off.

.. math:: u = g\, [J \ddot q + f \dot q + F_c\, \mathrm{sgn}\, \dot q + G \cos q + H \sin q + o + \tau_p]

u is logged, with an unknown torque constant behind it; tau_p(q, q', q'') is the torque of the payload by the robot's
geometry. All else is the same in all logs and is taken out without having to be known.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from elastid.base.arrays import FloatArray
from elastid.base.note import Note
from elastid.base.statistics import QUANTILE_95
from elastid.friction_study.least_squares import Equations, solve
from elastid.friction_study.motion import PASSBAND_HZ
from elastid.friction_study.motion_signals import Motion, MotionSignals


def find_gain(motions: Sequence[Motion], payloads: Sequence[FloatArray]) -> tuple[float, float]:
    """g and its std from motions of one joint; payloads (n,): the torque of the payload in each, 0 without it."""
    equations = []
    for motion, payload in zip(motions, payloads, strict=True):
        signals = MotionSignals.of(motion, PASSBAND_HZ)
        q, v = signals.position, signals.velocity
        rest = [signals.acceleration, v, np.abs(v), signals.direction, np.ones_like(q), np.cos(q), np.sin(q)]
        sides = (payload[:, None, None], np.stack(rest, axis=1)[:, None, :], motion.torque[:, None])
        X, R, y = (signals.filtered(side) * signals.used.reshape(-1, *[1] * (side.ndim - 1)) for side in sides)
        equations.append(Equations(X, R, y, np.zeros((len(y), 0))))
    solution = solve(equations, MotionSignals.of(motions[0], PASSBAND_HZ).kept_hz)
    return float(solution.beta[0]), float(np.sqrt(solution.covariance[0, 0]))


def gain_note(joint: str, gain: float, std: float) -> Note:
    """The gain and, where it is not 1, the scale that takes it out."""
    reach = QUANTILE_95 * std
    text = f"with and without payload its torque is logged {gain:.4g} [{gain - reach:.4g}, {gain + reach:.4g}] times"
    if abs(gain - 1) <= reach:
        text += " as large as it is: the torque constant is right"
        return Note("drive-gain", text, f"joint {joint}", severity="information")
    advice = f"multiply scale of its channel of role u by {1 / gain:.5g}, and all torques here are Nm"
    return Note("drive-gain", f"{text} as large as it is: {advice}", f"joint {joint}", severity="warning")
