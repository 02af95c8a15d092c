"""Effects of a joint's gear besides its spring and the friction before and behind it: numbers of the link side."""

from __future__ import annotations

from typing import Annotated, Literal

from elastid.base.section import Key, section
from elastid.base.units import Angle, JointPosition, JointTorque
from elastid.robot.placement import require_not_negative, require_positive


@section
class TransmissionError:
    """Error e of a gear that repeats with the motor's turn: A sin(order theta + phase), theta the motor's angle."""

    # fmt: off
    amplitude: Annotated[JointPosition, Key("Amplitude of the error, at the link.", "10 to 60 arcsec of makers' "
        "sheets, which give the whole swing: half of that.")]
    order: Annotated[float, Key("Periods in a turn of the motor.", "1 for an eccentric part on the motor's shaft, 2 "
        "for a strain wave gear; others for the teeth of later stages.")] = 1.0
    phase: Annotated[Angle, Key("Phase at motor angle zero.", "as found by the stage gears; it matters beside other "
        "errors, and where the robot swings by less than a period.")] = 0.0
    # fmt: on

    def __post_init__(self) -> None:
        require_positive("error: amplitude", self.amplitude)
        require_positive("error: order", self.order)


@section
class GearRipple:
    """Torque on the motor that repeats with its turn, cogging and ripple: A sin(order theta + phase), braking."""

    # fmt: off
    amplitude: Annotated[JointTorque, Key("Amplitude of the torque, at the link.", "the motor's cogging times the "
        "ratio: 0.5 to 2 % of rated torque.")]
    order: Annotated[float, Key("Periods in a turn of the motor.", "6 times the pole pairs where commutation makes "
        "it.")] = 1.0
    phase: Annotated[Angle, Key("Phase at motor angle zero.", "as found by the stage gears.")] = 0.0
    # fmt: on

    def __post_init__(self) -> None:
        require_positive("ripple: amplitude", self.amplitude)
        require_positive("ripple: order", self.order)


@section
class Hysteresis:
    """An element of a gear's hysteresis: a spring that slides at a torque, in parallel with the gear's own."""

    # fmt: off
    torque: Annotated[JointTorque, Key("Torque at which the element slides, at the link.", "half of the height of the "
        "loop in a maker's stiffness test; several elements make it round.")]
    deflection: Annotated[JointPosition, Key("Torsion of the gear over which it bends before it slides.", "the torsion "
        "after a reversal at which the loop has closed half of its height.")]
    edge: Annotated[Literal["sharp", "smooth"], Key("Change from bending to sliding: `sharp`, as a spring with a stop, "
        "or `smooth`, as Dahl's bristles.", "as found by the stage gears; both lose as much energy in large "
        "loops.")] = "sharp"
    # fmt: on

    def __post_init__(self) -> None:
        require_positive("hysteresis: torque", self.torque)
        require_positive("hysteresis: deflection", self.deflection)


@section
class Gear:
    """Effects of an elastic gear: its error, ripple, hysteresis, and friction that grows with its torque."""

    # fmt: off
    load: Annotated[float, Key("Coulomb friction at the motor for each Nm of torque in the gear, at every moment.",
        "0.02 to 0.15: one minus the efficiency, about; friction.load is of the load at rest instead.")] = 0.0
    error: Annotated[tuple[TransmissionError, ...], Key("Transmission error, by order.", "from the maker's sheet, or "
        "as found by the stage gears.")] = ()
    ripple: Annotated[tuple[GearRipple, ...], Key("Ripple and cogging at the motor, by order.", "where they are known "
        "by joint; experiment.simulated.torque_ripple is the same at all motors.")] = ()
    hysteresis: Annotated[tuple[Hysteresis, ...], Key("Elements of the hysteresis in the gear's torsion.", "strain "
        "wave gears: a few percent of rated torque; without it a gear loses energy by damping alone.")] = ()
    # fmt: on

    def __post_init__(self) -> None:
        require_not_negative("gear: load", self.load)
        if self.load >= 1:
            raise ValueError(
                f"gear: load is {self.load:g}; a gear whose friction takes all of its torque turns no link"
            )
