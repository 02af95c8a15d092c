"""FrictionResult: all that a friction study has found, joint by joint."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, TypeAlias

from elastid.base.display import Display, as_html, as_text
from elastid.base.errors import index_of
from elastid.base.note import Note
from elastid.base.numbers import digits, interval_of, number
from elastid.friction_fit.at_rest import AtRest
from elastid.friction_fit.law_choice import ABSENT, NOT_ASKED, Held
from elastid.friction_fit.motion import MotionFriction
from elastid.friction_fit.pass_levels import PassLevels
from elastid.friction_fit.presliding import Loops, Presliding
from elastid.friction_fit.shooting import LuGreFit
from elastid.friction_fit.static_law import StaticLaw
from elastid.friction_fit.warm_up import ThermalModel, WarmUp
from elastid.friction_record import FrictionRecord
from elastid.robot.friction import Friction

# partly: stiction of some joint cannot be told, or nothing of it.  failed: no friction of any joint.
Status: TypeAlias = Literal["identified", "partly", "failed"]


@dataclass(frozen=True)
class FrictionNumber:
    """A row of the table: one identified number of a joint, link side, with its 95 % interval, SI.

    name: Fc_m1, unique in a study.  symbol: F_c.  meaning: Coulomb friction.  learnt_from: the data that tell it.
    truth: of a simulated robot.
    """

    name: str
    symbol: str
    meaning: str
    unit: str
    value: float
    std: float
    low: float
    high: float
    learnt_from: str
    truth: float | None = None


@dataclass(frozen=True)
class JointLevels:
    """What stage `levels` leaves of one joint: levels of its passes, the regression of its motion, or both.

    example: a pass with the torque that the regression gives it, for the figure over the angle.
    """

    joint: str
    slides: bool
    levels: PassLevels | None = None
    motion: MotionFriction | None = None
    example: FrictionRecord | None = None
    notes: tuple[Note, ...] = ()


@dataclass(frozen=True)
class JointFriction:
    """Friction of one joint, link side; None where it was not measured or cannot be told.

    loops: the log of `presliding`.  bristles: the LuGre law by shooting.  warm_up: the data of `thermal`.
    friction, viscous: the law as a whole, with the ranges in which it was measured.
    numbers: the table.  held: parts without numbers, with reasons.
    """

    joint: str
    slides: bool
    levels: PassLevels | None = None
    motion: MotionFriction | None = None
    static: StaticLaw | None = None
    presliding: Presliding | None = None
    loops: Loops | None = None
    at_rest: AtRest | None = None
    bristles: LuGreFit | None = None
    thermal: ThermalModel | None = None
    warm_up: WarmUp | None = None
    friction: Friction | None = None
    viscous: float | None = None
    numbers: tuple[FrictionNumber, ...] = ()
    held: tuple[Held, ...] = ()
    example: FrictionRecord | None = None
    notes: tuple[Note, ...] = ()

    @property
    def missing(self) -> tuple[Held, ...]:
        """What a law of friction has and these data cannot tell: stiction, or friction at all."""
        if self.friction is None:
            return (Held("friction", "the data tell no law that a contact can have"),)
        return tuple(
            held for held in self.held if held.part == "stribeck" and not held.reason.startswith((NOT_ASKED, ABSENT))
        )


@dataclass(frozen=True)
class FrictionResult:
    """All joints.  message: how the identification ended, in one sentence."""

    joints: tuple[JointFriction, ...]
    notes: tuple[Note, ...]
    status: Status
    message: str

    __repr__, _repr_html_ = as_text, as_html

    @property
    def display(self) -> Display:
        """How it ended, and the table of numbers."""
        rows = []
        for each in self.numbers:
            kept = digits(each.value, each.std)
            value, ends = number(each.value, kept), " to ".join(interval_of((each.low, each.high), kept))
            rows.append((each.name, each.meaning, f"{value} {each.unit}", ends))
        return Display(f"Friction {self.status}: {self.message}", ("number", "meaning", "value", "95 % interval"), rows)

    def at(self, joint: str) -> JointFriction:
        """The friction of a joint; UnknownNameError names those there are."""
        return self.joints[index_of(joint, [each.joint for each in self.joints], "friction of joint")]

    @property
    def numbers(self) -> tuple[FrictionNumber, ...]:
        """The table of all joints."""
        return tuple(number for joint in self.joints for number in joint.numbers)
