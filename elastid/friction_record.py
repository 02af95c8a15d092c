"""FrictionRecord: sampled motion of one joint for the identification of friction, and the log of a warm-up."""

from collections.abc import Collection
from dataclasses import dataclass, field, replace
from typing import Literal, TypeAlias

import numpy as np

from elastid.base.arrays import FloatArray, frozen_value, labelled
from elastid.base.errors import Note
from elastid.record import Configuration, Hold, drive_unit

# constant_velocity: there and back at one speed.  motion: any other.  presliding_loops: torque grows up to sliding.
# presliding_test: a small multisine or noise at zero velocity.  warm_up: to and fro until the joint is warm.
# coast_down: the joint coasts, one way, against a known inertia.  commands: any motion, without a torque.
Purpose: TypeAlias = Literal[
    "constant_velocity", "motion", "presliding_loops", "presliding_test", "warm_up", "coast_down", "commands"
]


@frozen_value
class FrictionRecord:
    """One motion of one joint; records of several joints that moved together share their name.

    joint: its name.  position, torque (n,): rad and Nm, where the joint slides m and N; values of the motor's
    shaft on the link side, by its own ratio.  disturbance (n,): known torque that the motor does not produce, included
    in torque.  velocity (n,): measured or differentiated, None where it is left to the estimator.
    temperature (n,): degC, NaN where it is not known, or None.  reference (n,): position that the controller was asked
    for.  link_position (n,): of the joint behind its gear.  Both None where they were not logged.
    there, back: first sample of each plateau of a pass, and the one after its last.  speed: of the pass as planned.
    load: name of the load, payload: its mass.  load_torque: |torque| of the model that the joint carries, 0 where none
    is known.
    command (n,), gains: of a record without a torque, which is NaN then: k_p q_ref + k_d q_ref' as the controller has
    them, and (k_p, k_d) of its feedback, link side.  feedback_delays_s: of the feedback of a sampled controller, and of
    its velocities in addition.
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
    disturbance: FloatArray | None = labelled("known torque in torque", "{torque_unit}", "sample", default=None)
    reference: FloatArray | None = labelled("position that was asked for", "{unit}", "sample", default=None)
    link_position: FloatArray | None = labelled("position behind the gear", "{unit}", "sample", default=None)
    command: FloatArray | None = labelled("reference times gains", "{torque_unit}", "sample", default=None)
    gains: tuple[float, float] | None = None
    feedback_delays_s: tuple[float, float] = (0.0, 0.0)
    there: tuple[int, int] | None = None
    back: tuple[int, int] | None = None
    speed: float | None = None
    load: str = ""
    payload: float = labelled("mass at the last frame", "kg", default=0.0)
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
        motions = ("position", "velocity", "reference", "link_position")
        for name in (*motions, "torque", "temperature", "disturbance", "command"):
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
        degc = np.zeros(0) if self.temperature is None else self.temperature[np.isfinite(self.temperature)]
        return float(degc.mean()) if len(degc) else float("nan")

    def angles(self, n_u: int) -> FloatArray:
        """Return angles (n_u,) of the posture in which the other joints are held; 0 where it is not known."""
        return np.zeros(n_u) if self.configuration is None else self.configuration.angles

    @property
    def unit(self) -> str:
        """Unit of the position: rad or m."""
        return "m" if self.slides else "rad"

    @property
    def torque_unit(self) -> str:
        """Unit of the torque: N*m or N."""
        return drive_unit(self.slides)


@frozen_value
class WarmUpLog:
    """Heat of a joint during a warm-up: power (n,) in W from time_s[k] to time_s[k + 1] (n + 1,), s from the start.

    temperature (n + 1,): of a thermometer in degC, NaN where there is none, with temperature_std.  ambient_degc,
    start_degc: of the room, and of the joint at the first time, known to start_std; ambient_degc is NaN where the joint
    started at it.  Its test passes are records with is_warm_up.
    """

    joint: str
    time_s: FloatArray
    power: FloatArray
    temperature: FloatArray
    temperature_std: float
    ambient_degc: float
    start_degc: float
    start_std: float = 0.0

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
        """Return the records of one joint and purpose."""
        return tuple(r for r in self.records if r.joint == joint and r.purpose == purpose)

    def divided(self, left_out: Collection[str]) -> "tuple[FrictionRecords, FrictionRecords]":
        """Return records for identification, and validation logs by name."""
        inside, outside = (tuple(r for r in self.records if (r.name in left_out) == out) for out in (False, True))
        return replace(self, records=inside), FrictionRecords(outside)

    @property
    def joints(self) -> tuple[str, ...]:
        """The joints that were measured, in order."""
        return tuple(dict.fromkeys([*(log.joint for log in self.records), *(log.joint for log in self.warm_ups)]))
