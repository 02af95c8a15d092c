"""The section `controller` of recorded experiments: the cascade under which logs were taken."""

from __future__ import annotations

from typing import Annotated

from elastid.base.section import Key, section
from elastid.base.units import Damping, InUnit, Time

PositionGain = Annotated[float, InUnit("1/s")]


@section
class CascadeSpec:
    """The robot controller of the logs: a loop of position around a loop of velocity, so that validation can repeat it.

    u = K_v [e + (1 / T_i) integral of e], e = K_p (q_ref - q) + s q_ref' - q', q the motor's angle on the link side.
    """

    # fmt: off
    position_gain: Annotated[PositionGain | tuple[PositionGain, ...], Key("Gain K_p of the outer loop, one number for "
        "all joints or one for each driven joint.", "the servo parameter as the drive shows it, in 1/s; in (m/min)/mm "
        "it is 16.7 times as many 1/s.")]
    velocity_gain: Annotated[Damping | tuple[Damping, ...], Key("Gain K_v of the inner loop, link side (ratio^2 times "
        "that of the motor's side), one number or several.", "of the drive's motor side, times ratio^2; a wrong one "
        "shows in validation as a torque of wrong size at every reversal.")]
    integral_time: Annotated[Time | None, Key("Integral time T_i of the inner loop (default: no integral).",
        "most drives have one, of 5 to 50 ms; without it the replay keeps an error that the robot did not "
        "have.")] = None
    velocity_feed_forward: Annotated[float, Key("Share s of the reference's velocity that is fed forward, 0 to 1. The "
        "reference is in the log as channels of role reference.", "1 for controllers that follow without lag; too "
        "small a number shows as a position error in proportion to speed.")] = 0.0
    # fmt: on

    def __post_init__(self) -> None:
        """Refuse gains that do not hold a joint."""
        for name in ("position_gain", "velocity_gain"):
            value = getattr(self, name)
            numbers = value if isinstance(value, tuple) else (value,)
            if not numbers or not all(number > 0 for number in numbers):
                raise ValueError(f"{name} is {value}; a loop that holds a joint has a positive one")
        if self.integral_time is not None and not self.integral_time > 0:
            raise ValueError(f"integral_time is {self.integral_time:g} s; it must be positive (leave it out for none)")
        if not 0 <= self.velocity_feed_forward <= 1:
            raise ValueError(f"velocity_feed_forward is {self.velocity_feed_forward:g}; it is a share, 0 to 1")

    def refusal(self, n_u: int) -> tuple[str, str]:
        """The key that does not go with n_u driven joints, and why; empty texts where both do."""
        for name in ("position_gain", "velocity_gain"):
            value = getattr(self, name)
            if isinstance(value, tuple) and len(value) != n_u:
                return name, f"{len(value)} gains for {n_u} driven joints; give one for all, or one for each"
        return "", ""
