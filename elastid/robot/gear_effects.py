"""Effects of an elastic gear besides its spring: transmission error, ripple, hysteresis, load-dependent friction."""

from typing import Annotated, Literal

from elastid.base.section import Key, section
from elastid.base.units import Angle, JointPosition, JointTorque


@section
class TransmissionError:
    """Transmission error A sin(order theta + phase) of a gear, theta: motor angle."""

    # fmt: off
    amplitude: Annotated[JointPosition, Key("Amplitude of the transmission error on the link side.", "10 to 60 arcsec "
        "in data sheets, which state the peak-to-peak value: use half of it.", above=0)]
    order: Annotated[float, Key("Periods per motor revolution.", "1 for an eccentric part on the motor shaft, 2 for a "
        "strain wave gear, other orders for teeth of later stages.", above=0)] = 1.0
    phase: Annotated[Angle, Key("Phase at motor angle zero.", "copy it from the stage gears; it matters with several "
        "orders, or for motion of less than one period.")] = 0.0


@section
class GearRipple:
    """Cogging or ripple torque A sin(order theta + phase) against the motor, theta: motor angle."""

    # fmt: off
    amplitude: Annotated[JointTorque, Key("Amplitude of the ripple torque on the link side.", "cogging torque of the "
        "motor times the ratio, typically 0.5 to 2 % of the rated torque.", above=0)]
    order: Annotated[float, Key("Periods per motor revolution.", "6 times the number of pole pairs for commutation "
        "ripple.", above=0)] = 1.0
    phase: Annotated[Angle, Key("Phase at motor angle zero.", "copy it from the stage gears.")] = 0.0


@section
class Hysteresis:
    """Element of the hysteresis of a gear: a spring that slides at a torque, parallel to the gear's spring."""

    # fmt: off
    torque: Annotated[JointTorque, Key("Torque at which the element slides, on the link side.", "half the height of "
        "the hysteresis loop in the data sheet's stiffness test; several elements round its corners.", above=0)]
    deflection: Annotated[JointPosition, Key("Torsion of the gear at which the element begins to slide.",
        "torsion after a reversal at which the loop has closed half of its height.", above=0)]
    edge: Annotated[Literal["sharp", "smooth"], Key("Transition from sticking to sliding: `sharp` (elastoplastic "
        "element) or `smooth` (Dahl model).", "copy it from the stage gears; both dissipate the same energy in large "
        "loops.")] = "sharp"


@section
class Gear:
    """Effects of an elastic gear: transmission error, ripple, hysteresis, and load-dependent friction."""

    # fmt: off
    load: Annotated[float, Key("Coulomb friction at the motor per Nm of instantaneous gear torque.", "0.02 to 0.15, "
        "about one minus the efficiency; friction.load refers to the static load instead.", least=0, below=1)] = 0.0
    transmission_error: Annotated[tuple[TransmissionError, ...], Key("Transmission error, one entry per order.",
        "from the data sheet, or as estimated by the stage gears.")] = ()
    ripple: Annotated[tuple[GearRipple, ...], Key("Torque ripple and cogging of the motor, one entry per order.",
        "for values that differ between joints; experiment.simulated.torque_ripple applies to all motors.")] = ()
    hysteresis: Annotated[tuple[Hysteresis, ...], Key("Hysteresis elements in parallel with the gear's spring.",
        "a few percent of the rated torque for strain wave gears; without an element, the gear dissipates by damping "
        "only.")] = ()
