"""A real record of 1.99 periods that are no whole number of samples, from its study to a response."""

from __future__ import annotations

import numpy as np
from plants.measured import EMPS, EMPS_PULSES, measured
from scipy.io import loadmat

from elastid.friction_study.motion import regress_motion
from elastid.friction_study.motion_signals import Motion


def test_two_records_of_the_axis_agree_within_their_intervals() -> None:
    """Motion alone, and with pulses of force: 95 % intervals of the difference of each number."""
    logs = [loadmat(measured(name)) for name in (EMPS, EMPS_PULSES)]
    motions = [Motion("joint 1", 1e3, log["qm"].ravel(), 35.1507 * log["vir"].ravel(), slides=True) for log in logs]
    first, second = (regress_motion(motion).chosen for motion in motions)
    assert first.names == second.names
    for name in first.names:
        assert abs(first[name] - second[name]) < 1.96 * np.hypot(first.std(name), second.std(name)), name
