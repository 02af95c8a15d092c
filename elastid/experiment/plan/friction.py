"""The plan of a friction study: its motions, one joint at a time, and the contract of the rigs that carry it out."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

from elastid.base.arrays import FloatArray, frozen_value
from elastid.base.note import Note
from elastid.experiment.plan.passes import PassLimits, PlannedPass
from elastid.friction_record import FrictionRecord, Purpose, WarmUpLog
from elastid.record import Configuration


@frozen_value
class PlannedMotion:
    """One motion of one joint; its name is that of the record and unique in the plan.

    configuration: posture in which the others are held.  load, payload: name, and kg at the last frame.
    start_s: from the start of the study.  planned: of a pass.  torque (n,): injected, of loops and at rest, Nm link
    side.  period_samples: of a periodic torque.  is_warm_up: a test pass within a warm-up.
    """

    name: str
    joint: str
    purpose: Purpose
    configuration: Configuration
    load: str = ""
    payload: float = 0.0
    start_s: float = 0.0
    planned: PlannedPass | None = None
    torque: FloatArray | None = None
    period_samples: int | None = None
    is_warm_up: bool = False


@frozen_value
class JointPassDesign:
    """The passes of one joint: limits, speed (n,) with passes (n,) at each, and the certificate of the speeds.

    excess: max Tr(M^-1 H_i) / d - 1, 0 at the optimum.  efficiency: of whole passes against the best shares.
    """

    joint: str
    limits: PassLimits
    speed: FloatArray
    passes: FloatArray
    excess: float
    efficiency: float


@dataclass(frozen=True)
class PlannedWarmUp:
    """A joint that moves to and fro between start and stop at `speed`, from start_s for time_s; tests are motions.

    Link side: rad (m), rad/s; s.
    """

    joint: str
    configuration: Configuration
    start: float
    stop: float
    speed: float
    start_s: float
    time_s: float


@dataclass(frozen=True)
class FrictionPlan:
    """All motions in their order, sampled at rate_hz, and the warm-ups between them.

    robot_time_s: of all of them.  known, unknown: sentences on what the levels will tell, and what they cannot and why.
    """

    rate_hz: float
    motions: tuple[PlannedMotion, ...]
    designs: tuple[JointPassDesign, ...]
    robot_time_s: float
    warm_ups: tuple[PlannedWarmUp, ...] = ()
    known: tuple[str, ...] = ()
    unknown: tuple[str, ...] = ()
    notes: tuple[Note, ...] = ()


class FrictionRig(Protocol):
    """Something that can be measured, one motion at a time, in any order and in any process (it pickles)."""

    @property
    def motions(self) -> tuple[PlannedMotion, ...]:
        """All motions that it can run."""
        ...

    def measure(self, motion: PlannedMotion) -> FrictionRecord:
        """Run one motion; the same motion gives the same record, bit for bit."""
        ...

    def warm_ups(self) -> tuple[WarmUpLog, ...]:
        """The logs of warm-ups, one a joint that was warmed."""
        ...
