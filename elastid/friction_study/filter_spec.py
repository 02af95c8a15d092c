"""The section `filter` of a study of friction."""

from __future__ import annotations

from typing import Annotated, Literal, TypeAlias

from elastid.base.section import Key, section
from elastid.base.units import JointTorque, Ratio, Time

# What may be followed: Coulomb friction, viscous friction, of each direction, and the slow error of the torque.
Followed: TypeAlias = Literal["Fc", "f", "f+", "f-", "offset"]


@section
class FilterSpec:
    """A Kalman filter that follows friction over the motions of a joint, from motor angle and torque alone."""

    # fmt: off
    states: Annotated[tuple[Followed, ...], Key("States of the filter: Fc (Coulomb friction), f (viscous friction) or "
        "f+ and f- (of each direction), offset (slow error of the torque, as of gravity).", "f+ and f- for axes whose "
        "slopes differ, without offset where gravity is known well; each more widens all where motion is "
        "poor.")] = ("Fc", "f", "offset")
    drift: Annotated[Ratio, Key("Relative change of a number that is expected within drift_time.", "larger follows "
        "faster and scatters more; the report's check of the innovations says which of both it is. 20 % in 20 minutes "
        "is a robot that warms up.")] = 0.2
    drift_time: Annotated[Time, Key("Time in which the expected change of a number happens.", "the time constant of "
        "warming; the filter sees drift over the root of it alone, so that tuning one of the two is enough.")] = 1200.0
    correlation_time: Annotated[Time, Key("Correlation time of the torque noise that is not white, 0 for none; ripple "
        "and cables need it.", "the time of a motor turn or of a ripple at working speed, where innovations are "
        "correlated; 0 would trust such logs too much: intervals come out too narrow.")] = 0.0
    torque_std: Annotated[JointTorque | None, Key("Standard deviation of the torque noise of a sample (default: from "
        "the innovations of the first minute).", "where the first minute is not typical, as with the robot at rest; "
        "larger makes the filter slower and its intervals wider.")] = None
    settle: Annotated[Time, Key("Time that a filter takes before it is judged.", "longer where the start is far from "
        "the truth, so that the swing-in does not count against the filter. 10 s hold several motions with "
        "reversals.")] = 10.0
    # fmt: on

    def __post_init__(self) -> None:
        """Refuse nothing to follow, a number followed twice, and times that run backwards."""
        if not self.states:
            raise ValueError("states is empty; follow at least one of Fc, f, f+, f-, offset")
        twice = sorted({name for name in self.states if self.states.count(name) > 1})
        if twice:
            raise ValueError(f"states: {twice[0]} is given twice; leave one out")
        if "f" in self.states and {"f+", "f-"} & set(self.states):
            raise ValueError("states: f is viscous friction of both directions; give f, or f+ and f-, not both")
        if not (self.drift > 0 and self.drift_time > 0) or min(self.correlation_time, self.settle) < 0:
            raise ValueError(
                f"drift is {self.drift:g}, drift_time {self.drift_time:g} s, correlation_time "
                f"{self.correlation_time:g} s and settle {self.settle:g} s; the first two must be positive, the others "
                "not negative"
            )
        if self.torque_std is not None and not self.torque_std > 0:
            raise ValueError(f"torque_std is {self.torque_std:g}; it must be positive (default: from the innovations)")

    @property
    def drift_rates(self) -> dict[str, float]:
        """Of each followed logarithm, in a root second; of the offset in parts of F_c."""
        return dict.fromkeys(self.states, self.drift / self.drift_time**0.5)
