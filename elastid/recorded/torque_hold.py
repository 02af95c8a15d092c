"""For how many samples the torques of a log are held, by the keys `hold` of its section and channels."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from elastid.base.errors import StudyError
from elastid.experiment.specs.channels import ChannelSpec
from elastid.experiment.specs.recorded import RecordedSpec
from elastid.experiment.specs.structure import Places
from elastid.recorded.link_side import to_joints


def hold_samples(recorded: RecordedSpec, channels: Sequence[ChannelSpec], rate_hz: float) -> tuple[float, ...]:
    """Of each u among the channels, in their order: samples at rate_hz for which it is held, 0 where band-limited.

    A channel with a higher rate of its own, brought to rate_hz, is held for a sample of its own rate.
    """
    rates = (channel.rate_hz or recorded.rate_hz for channel in channels if channel.role == "u")
    own = [rate_hz if isinstance(rate, str) else float(rate) for rate in rates]
    kinds = [channel.hold or recorded.hold for channel in channels if channel.role == "u"]
    return tuple(rate_hz / rate if kind == "zero-order" else 0.0 for kind, rate in zip(kinds, own, strict=True))


def check_holds(recorded: RecordedSpec, robot: Places) -> None:
    """StudyError where gears mix torques of different holds, so that the torque of a joint has neither."""
    torques = [channel for channel in recorded.channels if channel.role == "u"]
    held = hold_samples(recorded, torques, 1.0)
    for row in to_joints(torques, robot):
        mixed = [torques[i] for i in np.flatnonzero(row)]
        if len({held[torques.index(channel)] for channel in mixed}) > 1:
            names = ", ".join(f"{channel.name_in_file} ({channel.hold or recorded.hold})" for channel in mixed)
            raise StudyError(
                f"gears couple the motors of the channels {names}, whose torques are held in different ways, so that "
                "the torque of a joint has neither: log commands or measured torques for all of them, with one hold"
            )
