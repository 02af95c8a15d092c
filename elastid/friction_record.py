"""What a friction study measures, in SI and on the link side: motions of one joint each, and logs of warm-ups."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal, TypeAlias

import numpy as np

from elastid.base.arrays import FloatArray, frozen_value
from elastid.base.label import labelled
from elastid.base.note import Note
from elastid.record import Configuration, Hold, drive_unit

# passes: there and back at one speed.  motion: any other.  loops: growing torques before the joint slides.
# at_rest: a small multisine at standstill.
Purpose: TypeAlias = Literal["passes", "motion", "loops", "at_rest"]


@frozen_value
class FrictionRecord:
    """One motion of one joint; records of several joints that moved together share their name.

    joint: its name.  position, torque (n,): rad and Nm, where the joint slides m and N; link side, the torque of its
    motor that acts.  velocity (n,): measured or differentiated, None where it is left to the estimator.
    temperature (n,): degC, NaN where it is not known, or None.  reference (n,): position that the controller was asked
    for.  link_position (n,): of the joint behind its gear.  Both None where they were not logged.
    there, back: first sample of each plateau of a pass, and the one after its last.  speed: of the pass as planned.
    load: name of the load.  load_torque: |torque| of the model that the joint carries, 0 where none is known.
    torque_delay_s: by which the torque acts later than its position was read: half a sample of a command that is held.
    resolution: of the position, one count; 0 where it is not known.  start_s: time of the first sample from the start
    of the study.  period_samples: of a periodic torque.  hold: of the torque between its samples.
    configuration: posture in which the other joints are held.
    is_reference: a pass whose drift is the warm-up.  is_warm_up: a test pass within one.
    place: file or key of the study, for messages.  slides: a translation.

    Raises ValueError where shapes disagree.
    """

    name: str
    joint: str
    purpose: Purpose
    rate_hz: float
    position: FloatArray = labelled("position of the joint", "{unit}", "sample")
    torque: FloatArray = labelled("torque of the motor, link side", "{torque_unit}", "sample")
    velocity: FloatArray | None = labelled("velocity of the joint", "{unit}/s", "sample", default=None)
    temperature: FloatArray | None = labelled("temperature of the joint", "degC", "sample", default=None)
    reference: FloatArray | None = labelled("position that was asked for", "{unit}", "sample", default=None)
    link_position: FloatArray | None = labelled("position behind the gear", "{unit}", "sample", default=None)
    there: tuple[int, int] | None = None
    back: tuple[int, int] | None = None
    speed: float | None = None
    load: str = ""
    load_torque: float = 0.0
    resolution: float = 0.0
    torque_delay_s: float = 0.0
    start_s: float = 0.0
    period_samples: int | None = None
    hold: Hold = "band-limited"
    configuration: Configuration | None = None
    is_reference: bool = False
    is_warm_up: bool = False
    place: str = ""
    slides: bool = False
    notes: tuple[Note, ...] = field(default=())

    def __post_init__(self) -> None:
        """Check shapes and windows."""
        n = len(self.position)
        for name in ("position", "torque", "velocity", "temperature", "reference", "link_position"):
            signal = getattr(self, name)
            if signal is not None and signal.shape != (n,):
                raise ValueError(
                    f"record {self.name} of {self.joint}: {name} has shape {signal.shape}, expected ({n},)"
                )
        if not self.rate_hz > 0:
            raise ValueError(f"record {self.name} of {self.joint}: rate {self.rate_hz:g} Hz")
        for window in (self.there, self.back):
            if window is not None and not 0 <= window[0] < window[1] <= n:
                raise ValueError(f"record {self.name} of {self.joint}: window {window} of {n} samples")

    @property
    def duration_s(self) -> float:
        """Length in s."""
        return len(self.position) / self.rate_hz

    @property
    def mean_temperature(self) -> float:
        """Mean of the samples that have one, degC; NaN without."""
        known = np.zeros(0) if self.temperature is None else self.temperature[np.isfinite(self.temperature)]
        return float(known.mean()) if len(known) else float("nan")

    @property
    def unit(self) -> str:
        """Of its position: rad or m."""
        return "m" if self.slides else "rad"

    @property
    def torque_unit(self) -> str:
        """Of its torque: N*m or N."""
        return drive_unit(self.slides)


@frozen_value
class WarmUpLog:
    """Heat of a joint during a warm-up: power (n,) in W from time_s[k] to time_s[k + 1] (n + 1,), s from the start.

    temperature (n + 1,): of a thermometer in degC, NaN where there is none, with temperature_std.  ambient_degc,
    start_degc: of the room, and of the joint at the first time.  Its test passes are records with is_warm_up.
    """

    joint: str
    time_s: FloatArray
    power: FloatArray
    temperature: FloatArray
    temperature_std: float
    ambient_degc: float
    start_degc: float

    def __post_init__(self) -> None:
        """Check shapes."""
        n = len(self.power)
        if self.time_s.shape != (n + 1,) or self.temperature.shape != (n + 1,):
            raise ValueError(f"warm-up of {self.joint}: {n} powers need {n + 1} times and temperatures")


@dataclass(frozen=True)
class FrictionRecords:
    """All that was measured: records in the order of the plan, and the log of each warm-up."""

    records: tuple[FrictionRecord, ...]
    warm_ups: tuple[WarmUpLog, ...] = ()
    notes: tuple[Note, ...] = ()

    def of(self, joint: str, purpose: Purpose) -> tuple[FrictionRecord, ...]:
        """The records of one joint and purpose."""
        return tuple(r for r in self.records if r.joint == joint and r.purpose == purpose)

    @property
    def joints(self) -> tuple[str, ...]:
        """The joints that were measured, in order."""
        return tuple(dict.fromkeys(record.joint for record in self.records))
