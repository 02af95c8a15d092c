r"""Signals of motors that gears couple, brought to the link side together.

.. math:: \tau_a = \eta^T \tau_m = E^T \tau_m', \qquad q_a = \eta^{-1} q_m = E^{-1} q_m'

with the signals marked ' divided or multiplied by each motor's own ratio already (`signals`), eta = diag(ratio) E.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from elastid.arrays import FloatArray
from elastid.errors import StudyError
from elastid.experiment.recorded.log_files import name_in_file
from elastid.experiment.recorded.spec import ChannelSpec
from elastid.robot import Robot


def to_joints(channels: Sequence[ChannelSpec], robot: Robot) -> FloatArray:
    """T (n_c, n_c) from channels by their own ratio to channels on the link side: the identity without couplings.

    StudyError where a channel with side: motor needs another that is not there.
    """
    torque, angle = robot.mixing.T, np.linalg.inv(robot.mixing)
    T = np.eye(len(channels))
    motors = list(robot.motor_locations)
    for row, channel in enumerate(channels):
        if channel.side != "motor" or channel.at not in motors:
            continue
        mixed = (angle if channel.role == "y" else torque)[motors.index(channel.at)]
        for source in np.flatnonzero(np.abs(mixed) > 1e-12):
            T[row, _place(channels, channel, motors[source])] = mixed[source]
    return T


def _place(channels: Sequence[ChannelSpec], like: ChannelSpec, at: str) -> int:
    """The channel of a motor with the role, quantity and side of another."""
    for place, channel in enumerate(channels):
        same_kind = like.role != "y" or channel.quantity == like.quantity
        if (channel.role, channel.side, channel.at) == (like.role, "motor", at) and same_kind:
            return place
    raise StudyError(
        f"channel {name_in_file(like)}: {like.at} is coupled by gears with {at}, of which no channel with role "
        f"{like.role} and side: motor{'' if like.role != 'y' else f' holds the {like.quantity}'}; log it too, or give "
        "the signal on the link side"
    )
