r"""A joint between two bodies, its motor, its gear with the effects beside its spring, and its limits.

The spring of a joint: gearbox, bearing or link, linear or not.

.. math:: \tau(\Delta) = k_i \Delta + (k - k_i)\, g_b(\Delta) + k_2 \Delta^2 + k_{2s} \Delta |\Delta| + k_3 \Delta^3
          + d \dot\Delta, \qquad
          g_b = \tfrac12 \left[ 2 \Delta + \sqrt{(\Delta - b)^2 + e^2} - \sqrt{(\Delta + b)^2 + e^2} \right]

Without backlash g_b = Delta: a stiffness k. With it, k beyond the gap of +-b and k_i inside: 0 for free play, more for
a gear that hardens in a kink; e -> 0 gives the sharp dead zone. Niglis & Oberg (2015), eq. (2.13) for the polynomial.

The model's response is that of the tangent under gravity, the limit of small motion. A multisine that deflects the
spring by sigma rms makes a cubic one stiffer by about 3 k_3 sigma^2: keep sigma well below the deflection by gravity.
"""

import math
from collections.abc import Iterator
from dataclasses import field, is_dataclass
from typing import Annotated, Literal, TypeAlias

from elastid.base.names import PartName
from elastid.base.section import Key, section
from elastid.base.units import (
    Angle,
    CubicStiffness,
    Damping,
    Inertia,
    InUnit,
    JointPosition,
    JointTorque,
    Measured,
    QuadraticStiffness,
    Ratio,
    Stiffness,
    Torque,
    of_translation,
)
from elastid.robot.friction import Friction
from elastid.robot.placement import Axis, Numbers, Vector3, below, coordinates, unit_axis

# Field, parameter and unit of the optional terms of a spring.
_FURTHER = (
    ("quadratic", "k2", "N*m/rad^2"),
    ("symmetric_quadratic", "k2s", "N*m/rad^2"),
    ("cubic", "k3", "N*m/rad^3"),
    ("backlash", "b", "rad"),
)


@section
class Spring:
    """Spring with viscous damping, link side, of a gear (deflection q_m - q_a) or an elastic joint (deflection q_na).

    The parameters are keys of `robot.bodies[].joints[].spring`. Optional terms without a value are no parameters of a
    fit.

    Raises
    ------
    ValueError
        For a negative stiffness at some deflection, or inner_stiffness without backlash.

    Examples
    --------
    >>> Spring(3.5e5, damping=350.0).is_linear
    True
    >>> sorted(Spring(3.5e5, cubic=1e11).numbers("1"))
    ['d_1', 'k3_1', 'k_1']
    """

    # fmt: off
    stiffness: Annotated[Stiffness, Key("Stiffness k of the spring; with backlash, stiffness beyond the gap.",
        "start from the catalogue's torsional stiffness at medium torque, or 1e5 to 1e6 N*m/rad for the axes of large "
        "robots.", above=0)]
    damping: Annotated[Damping, Key("Viscous damping d of the spring.", "start with 1e-3 s times the stiffness; a fit "
        "keeps a damping of 0 unless fit.parameters gives d_NAME a start.", least=0)] = 0.0
    quadratic: Annotated[QuadraticStiffness | None, Key("Quadratic stiffness k2 in k2 Delta^2, which makes one "
        "direction stiffer (default: no quadratic term).", "for springs that differ between directions, such as cable "
        "drives; postures with opposite gravity identify it.")] = None
    symmetric_quadratic: Annotated[QuadraticStiffness | None, Key("Symmetric quadratic stiffness k2s in k2s Delta "
        "|Delta| (default: no such term).", "for gears whose stiffness grows in proportion to the deflection in both "
        "directions, such as strain wave gears.")] = None
    cubic: Annotated[CubicStiffness | None, Key("Cubic stiffness k3 in k3 Delta^3 (default: no cubic term).",
        "for smooth hardening; a multisine with rms deflection sigma raises the stiffness by about 3 k3 "
        "sigma^2.")] = None
    backlash: Annotated[JointPosition | None, Key("Backlash b, half the gap (default: no backlash).", "for worn gears "
        "and rack drives; it is identifiable only where gravity does not press the flanks together.", above=0)] = None
    inner_stiffness: Annotated[Stiffness, Key("Stiffness k_i inside the gap of the backlash.", "above 0 for gears that "
        "are softer near zero torque, such as strain wave gears.", least=0)] = 0.0
    rounding: Annotated[Ratio, Key("Rounding e / b of the backlash: fraction of b over which the flanks make contact.",
        "smaller for hard flanks, with more substeps in simulation; the solver needs smooth derivatives, for which 0.1 "
        "is enough.", above=0)] = 0.1
    # fmt: on

    def __post_init__(self) -> None:
        if self.backlash is None and self.inner_stiffness > 0:
            raise ValueError("inner_stiffness, inside the backlash, needs backlash. Give half of the gap")
        self._check_monotone()

    @property
    def is_linear(self) -> bool:
        """One stiffness at every deflection."""
        return all(getattr(self, field) is None for field, _, _ in _FURTHER)

    def numbers(self, joint: str) -> Numbers:
        """Return k_ and d_ of a joint; k2_, k2s_, k3_, b_, ki_ and e_ where the spring has them."""
        present = [row for row in _FURTHER if getattr(self, row[0]) is not None]
        present += (("inner_stiffness", "ki", "N*m/rad"), ("rounding", "e", "1")) if self.backlash is not None else ()
        first: Numbers = {f"k_{joint}": ("N*m/rad", ("stiffness",)), f"d_{joint}": ("N*m*s/rad", ("damping",))}
        return first | {f"{letter}_{joint}": (unit, (field,)) for field, letter, unit in present}

    def _check_monotone(self) -> None:
        """Check that a + 2 s |Delta| + 3 k3 Delta^2 is positive in both directions: s >= 0 or s^2 < 3 a k3."""
        even, odd, cubic = self.quadratic or 0.0, self.symmetric_quadratic or 0.0, self.cubic or 0.0
        a = min(self.stiffness, self.inner_stiffness) if self.backlash is not None else self.stiffness
        where = " inside the backlash" if a < self.stiffness else ""
        for s, side in ((odd + even, "positive"), (odd - even, "negative")):
            if cubic < 0 or (s < 0 and not s**2 < 3 * a * cubic):
                # The smallest deflection x at which a + 2 s x + 3 cubic x^2 reaches 0.
                root = math.sqrt(max(s**2 - 3 * a * cubic, 0.0))
                ends = [(sign * root - s) / (3 * cubic) for sign in (-1, 1)] if cubic else [a / (-2 * s)]
                worst, (unit, angle) = min(x for x in ends if x >= 0), self._units
                raise ValueError(
                    f"the stiffness becomes negative at a {side} deflection of {worst:.3g} {angle} (k = {a:g} {unit}"
                    f"{where}, quadratic {s:g} {unit}^2 on this side, cubic {cubic:g} {unit}^3). The limit is "
                    "quadratic^2 < 3 k cubic"
                )

    @property
    def _units(self) -> tuple[str, str]:
        """Units of stiffness and deflection: N/m and m where any number has them; a spring does not know its joint."""
        numbers = (getattr(self, row[0]) for row in (("stiffness",), *_FURTHER))
        slides = any("rad" not in getattr(number, "dimension", "rad") for number in numbers)
        return ("N/m", "m") if slides else ("N*m/rad", "rad")


@section
class TransmissionError:
    """Error e of a gear that repeats with the motor's turn: A sin(order theta + phase), theta the motor's angle."""

    # fmt: off
    amplitude: Annotated[JointPosition, Key("Amplitude of the transmission error on the link side.", "10 to 60 arcsec "
        "in data sheets, which state the peak-to-peak value: use half of it.", above=0)]
    order: Annotated[float, Key("Periods per motor revolution.", "1 for an eccentric part on the motor shaft, 2 for a "
        "strain wave gear, other orders for teeth of later stages.", above=0)] = 1.0
    phase: Annotated[Angle, Key("Phase at motor angle zero.", "copy it from the stage gears; it matters with several "
        "orders, or for motion of less than one period.")] = 0.0
    # fmt: on


@section
class GearRipple:
    """Torque on the motor that repeats with its turn, cogging and ripple: A sin(order theta + phase), braking."""

    # fmt: off
    amplitude: Annotated[JointTorque, Key("Amplitude of the ripple torque on the link side.", "cogging torque of the "
        "motor times the ratio, typically 0.5 to 2 % of the rated torque.", above=0)]
    order: Annotated[float, Key("Periods per motor revolution.", "6 times the number of pole pairs for commutation "
        "ripple.", above=0)] = 1.0
    phase: Annotated[Angle, Key("Phase at motor angle zero.", "copy it from the stage gears.")] = 0.0
    # fmt: on


@section
class Hysteresis:
    """An element of a gear's hysteresis: a spring that slides at a torque, in parallel with the gear's own."""

    # fmt: off
    torque: Annotated[JointTorque, Key("Torque at which the element slides, on the link side.", "half the height of "
        "the hysteresis loop in the data sheet's stiffness test; several elements round its corners.", above=0)]
    deflection: Annotated[JointPosition, Key("Torsion of the gear at which the element begins to slide.",
        "torsion after a reversal at which the loop has closed half of its height.", above=0)]
    edge: Annotated[Literal["sharp", "smooth"], Key("Transition from sticking to sliding: `sharp` (elastoplastic "
        "element) or `smooth` (Dahl model).", "copy it from the stage gears; both dissipate the same energy in large "
        "loops.")] = "sharp"
    # fmt: on


@section
class Gear:
    """Effects of an elastic gear: its error, ripple, hysteresis, and friction that grows with its torque."""

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
    # fmt: on


@section
class Motor:
    """Motor with its gear ratio, motor side; link-side values are ratio^2 inertia, ratio^2 viscous, abs(ratio) coulomb.

    The parameters are keys of `robot.bodies[].joints[].motor`.

    Raises
    ------
    ValueError
        For a ratio of 0, a nonlinear shaft spring, `on` without `axis`, or friction that can supply energy.

    Examples
    --------
    >>> Motor(1e-3, ratio=100, viscous=1e-4).link_viscous
    1.0
    """

    # fmt: off
    inertia: Annotated[Inertia, Key("Inertia of the rotor about its axis, on the motor side.", "add rotor, brake and "
        "input stage; the data sheet's rotor inertia alone can be half of the sum.", above=0)]
    ratio: Annotated[float, Key("Gear ratio: motor revolutions per joint revolution, negative if the directions are "
        "opposite.", "copy it with its sign from the controller's parameters; its relative error doubles in the "
        "reflected inertia.")] = 1.0
    viscous: Annotated[Damping, Key("Viscous friction of the motor, on the motor side.", "slope of torque over speed "
        "of the warm axis, divided by ratio^2; a fit estimates fm_NAME from a start above 0.", least=0)] = 0.0
    coulomb: Annotated[Torque, Key("Coulomb friction of the motor, on the motor side.", "half the torque difference "
        "between slow motion in both directions; it affects simulation, not the linear model.", least=0)] = 0.0
    spring: Annotated[Spring | None, Key("Torsional spring of the motor shaft, before all gears, on the motor side "
        "(default: rigid shaft).", "for belts and couplings with resonances of their own, mostly above 50 Hz.")] = None
    on: Annotated[str, Key("Body that carries the motor (default: the rotor only rotates about its own axis). The "
        "rotor's kinetic energy is then inertia (axis . omega + ratio q_m')^2 / 2; the body includes its mass and "
        "other inertias.", "for motors in the arm, above all of the wrist; at ratios above 100 the natural frequencies "
        "change by a few percent.")] = ""
    axis: Annotated[Axis | None, Key("Direction of the rotor axis in the frame of the body `on`, needed with `on` "
        "(default: none without `on`).", "for motors behind bevel gears or belts; its sign and the sign of ratio "
        "belong together.")] = None
    friction: Annotated[Friction | None, Key("Friction model of the motor, in place of coulomb (default: coulomb "
        "alone).", "for friction studies, whose export writes it; a study of elasticity needs only `coulomb`.")] = None
    # fmt: on

    def __post_init__(self) -> None:
        if self.ratio == 0:
            raise ValueError("ratio is 0; give the turns of the motor in one of the joint")
        if self.spring is not None and not self.spring.is_linear:
            raise ValueError(
                "the spring of a motor's shaft must be linear; give backlash and stiffening to the spring of the joint"
            )
        if bool(self.on) != (self.axis is not None):
            raise ValueError(
                f"a motor on a body needs `on` (the body, got {self.on or 'nothing'}) and `axis` (direction of the "
                f"rotor in the body's axes, got {'nothing' if self.axis is None else self.axis})"
            )
        if self.axis is not None:
            unit_axis(self.axis)
        if self.friction is not None:
            if self.coulomb > 0:
                raise ValueError(
                    "coulomb and friction are both given; friction has a coulomb of its own, leave one out"
                )
            self.friction.check_passive(self.viscous)

    @property
    def link_viscous(self) -> float:
        """Its viscous friction on the link side."""
        return self.viscous * self.ratio**2

    @property
    def dry_friction(self) -> Friction | None:
        """The law of dry friction, Coulomb's where `coulomb` alone is given; None without any."""
        return Friction(self.coulomb) if self.friction is None and self.coulomb > 0 else self.friction

    def numbers(self, joint: str) -> Numbers:
        """Return Jm_ and fm_ of a joint, km_ and dm_ of the motor's shaft, on the motor side."""
        entries: Numbers = {f"Jm_{joint}": ("kg*m^2", ("inertia",)), f"fm_{joint}": ("N*m*s/rad", ("viscous",))}
        if self.spring is None:
            return entries
        shaft = {f"{name[0]}m{name[1:]}": place for name, place in self.spring.numbers(joint).items()}
        return entries | below("spring", shaft)


# Infinite where there is no limit.
PositionLimit: TypeAlias = Annotated[float, InUnit("rad", "m", is_finite=False)]
VelocityLimit: TypeAlias = Annotated[float, InUnit("rad/s", "m/s", is_finite=False)]
AccelerationLimit: TypeAlias = Annotated[float, InUnit("rad/s^2", "m/s^2", is_finite=False)]
JerkLimit: TypeAlias = Annotated[float, InUnit("rad/s^3", "m/s^3", is_finite=False)]
TorqueLimit: TypeAlias = Annotated[float, InUnit("N*m", "N", is_finite=False)]


@section
class Limits:
    """Limits of a driven joint, link side; for a translation in m, m/s, m/s^2, m/s^3 and N."""

    # fmt: off
    angle: Annotated[tuple[PositionLimit, PositionLimit], Key("Lowest and highest position.", "use the limits of the "
        "cell if they are narrower; designs keep excitation.margin.", rising=True)] = (-math.inf, math.inf)
    velocity: Annotated[VelocityLimit, Key("Largest speed of the joint.", "a tenth above the speed of the test; it "
        "bounds slow motions and multisines.", above=0)] = math.inf
    torque: Annotated[TorqueLimit, Key("Largest torque of the motor.", "continuous torque of motor and gear at the "
        "link, not the peak, for experiments of minutes.", above=0)] = math.inf
    acceleration: Annotated[AccelerationLimit, Key("Largest acceleration of the joint.", "if drives trip by "
        "acceleration before torque.", above=0)] = math.inf
    jerk: Annotated[JerkLimit, Key("Largest jerk of the moves of `elastid tune`.", "if the controller refuses or "
        "smooths references by their jerk.", above=0)] = math.inf
    # fmt: on


@section
class Joint:
    """Rotation about `axis` or translation along it, with a spring, a motor, both or neither.

    The parameters are keys of `robot.bodies[].joints[]`.

    Raises
    ------
    ValueError
        For units of the other kind of motion, and for keys without effect on this kind of joint.

    Examples
    --------
    >>> joint = Joint("1", axis="y", spring=Spring(3.5e5), motor=Motor(1e-3, ratio=100))
    >>> joint.slides
    False
    """

    # fmt: off
    name: Annotated[PartName, Key("Name of the joint, used in the names of its parameters (k_1, d_1, fm_1).",
        "use the numbers of the controller's axes, so that k_1 belongs to motor 1.")]
    axis: Annotated[Axis, Key("Axis of the joint: x, y, z or a direction in the frame before the joint.",
        "positive as the controller counts; a wrong sign inverts the response of this axis.")] = "z"
    spring: Annotated[Spring | None, Key("Spring of the gear or of an elastic joint (default: rigid gear; without a "
        "motor, a free joint).", "give it to every driven joint whose gear is elastic, and to every joint that models "
        "bending or bearing tilt.")] = None
    motor: Annotated[Motor | None, Key("Motor that drives the joint (default: no motor).", "for every axis with a "
        "drive; configurations list angles in the order of the driven joints.")] = None
    viscous: Annotated[Damping, Key("Viscous friction of the joint, on the link side.", "for bearings and seals behind "
        "the gear; friction before the gear belongs to the motor.", least=0)] = 0.0
    friction: Annotated[Friction | None, Key("Dry friction of the joint, on the link side (default: no dry friction).",
        "for simulation of bearings under load; most of the dry friction is at the motor.")] = None
    gear: Annotated[Gear | None, Key("Nonlinear gear effects: transmission error, ripple, hysteresis, load-dependent "
        "friction (default: no such effects).", "for simulation of a real gear, or as written by the stage gears; the "
        "linear model does not include them.")] = None
    limits: Annotated[Limits, Key("Limits of the joint, on the link side.", "give them for every driven joint whose "
        "experiments are designed; otherwise the excitation is not limited.")] = field(default_factory=Limits)
    motion: Annotated[Literal["rotation", "translation"], Key("Motion of the joint: `rotation` or `translation`. A "
        "translation has its stiffness in N/m, damping in N*s/m and ratio in rad/m; for a linear motor set ratio 1 and "
        "give its moving mass as inertia.", "`translation` for rails, gantries and telescopic axes.")] = "rotation"
    start: Annotated[JointPosition, Key("Position of the joint at which loops are assembled, which selects one of two "
        "assembly modes.", "give an angle near the assembled posture if the linkage closes in the mirrored "
        "configuration.")] = 0.0
    point: Annotated[Vector3, Key("Point on the axis of a rotation, in the frame before the joint; bodies behind it "
        "keep their zero placement.", "for elastic joints inside a link; two joints at different points model bending "
        "of a beam.")] = (0.0, 0.0, 0.0)
    zero: Annotated[Angle, Key("Zero offset of a rotation, added to the joint position.", "copy it from a calibration, "
        "or from a fit with a tolerance of angles.")] = 0.0
    # fmt: on

    def __post_init__(self) -> None:
        unit_axis(self.axis)
        if self.gear is not None and (self.motor is None or self.spring is None):
            raise ValueError(
                f"joint {self.name}: gear holds effects of an elastic gear, and the joint has no "
                f"{'motor' if self.motor is None else 'spring'}; give it one, or drop gear"
            )
        if self.motor is not None and not self.slides and abs(self.motor.ratio) < 0.1:
            raise ValueError("motor.ratio is below 0.1; give turns of the motor per turn of the joint")
        if self.slides and any((self.zero, *self.point)):
            raise ValueError(f"joint {self.name} slides, so zero and point have no effect. Remove them")
        self._check_units()
        if self.friction is not None:
            self.friction.check_passive(self.viscous, self.slides)

    @property
    def is_passive(self) -> bool:
        """Neither driven nor elastic: gravity or a loop moves it."""
        return self.motor is None and self.spring is None

    @property
    def all_viscous(self) -> float:
        """Viscous friction of joint and motor together, link side."""
        return self.viscous + (0.0 if self.motor is None else self.motor.link_viscous)

    @property
    def is_flexible(self) -> bool:
        """Driven through a gear with a spring of its own; `Robot.flexible` adds those that couplings make elastic."""
        return self.motor is not None and (self.spring is not None or self.motor.spring is not None)

    @property
    def slides(self) -> bool:
        """A translation, not a rotation."""
        return self.motion == "translation"

    @property
    def cells(self) -> tuple[str, str, str, str]:
        """Axis, gear ratio, stiffness and damping as table cells, empty for missing values."""
        direction = self.axis if isinstance(self.axis, str) else ", ".join(f"{part:.4g}" for part in self.axis)
        axis = f"along {direction}" if self.slides else direction
        ratio = "" if self.motor is None else f"{self.motor.ratio:.6g}"
        if self.spring is None:
            return axis, ratio, "", ""
        units = ("N/m", "N*s/m") if self.slides else ("N*m/rad", "N*m*s/rad")
        return axis, ratio, f"{self.spring.stiffness:.4g} {units[0]}", f"{self.spring.damping:.4g} {units[1]}"

    @property
    def numbers(self) -> Numbers:
        """Numbers of the spring, of friction across the joint (f_), of the motor."""
        spring = below("spring", self.spring.numbers(self.name)) if self.spring is not None else {}
        motor = below("motor", self.motor.numbers(self.name)) if self.motor is not None else {}
        across: Numbers = spring | {f"f_{self.name}": ("N*m*s/rad", ("viscous",))}
        if self.slides:
            across = {name: (of_translation(unit), path) for name, (unit, path) in across.items()}
        return across | motor

    @property
    def geometry(self) -> Numbers:
        """Point pj_ on the axis of a rotation, and zero offset zero_ of a driven joint."""
        if self.slides:
            return {}
        zero: Numbers = {f"zero_{self.name}": ("rad", ("zero",))} if self.motor is not None else {}
        return coordinates(f"pj_{self.name}", ("point",)) | zero

    @property
    def unit(self) -> str:
        """Unit of the position: rad or m."""
        return "m" if self.slides else "rad"

    def refusal_of(self, number: float) -> str:
        """Return why a number, written with a unit, cannot belong to this joint; empty where it can."""
        if not isinstance(number, Measured) or _turns(number.dimension) != self.slides:
            return ""
        hint = "" if self.slides else " (motion: translation makes it slide)"
        return (
            f"is given in units of {number.dimension}, but joint {self.name} is a {self.motion}{hint}; "
            f"give it in {_converted_dimension(number.dimension)}"
        )

    def position_refusal(self, at: float, swing: float = 0.0) -> str:
        """Return why it cannot be at a position, in rad or m, and swing about it; empty where it can."""
        low, high = self.limits.angle
        # Without limits: beyond a long rail in m, or two turns in rad, it was given in another unit.
        if math.isinf(high - low) and abs(at) > (50.0 if self.slides else 4 * math.pi):
            turns = "" if self.slides else f", {abs(at) / (2 * math.pi):.2g} turns,"
            return (
                f"joint {self.name} at {at:g} {self.unit}{turns} is farther than robots go; a number without a unit is "
                f"in {self.unit}: write '{at:g} {'mm' if self.slides else 'deg'}' if that is meant, or give the joint "
                "its limits"
            )
        if low <= at - swing <= at + swing <= high:
            return ""
        reach = f" with the carrier's {swing:.4g} {self.unit} to either side" if swing else ""
        return (
            f"joint {self.name} at {at:.4g} {self.unit}{reach} is outside its limits [{low:.4g}, {high:.4g}] "
            f"{self.unit}"
        )

    def _check_units(self) -> None:
        """Check the units of values: the joint's kind of motion for the joint, rotation for its motor."""
        for name, number in _numbers_of(self):
            if refused := self.refusal_of(number):
                raise ValueError(f"{name} {refused}")
        for name, number in () if self.motor is None else _numbers_of(self.motor):
            if isinstance(number, Measured) and not _turns(number.dimension):
                raise ValueError(
                    f"motor: {name} of joint {self.name} is given in units of {number.dimension}, but a motor turns, "
                    f"its ratio leads to the joint; give it in {_converted_dimension(number.dimension)}"
                )


def _numbers_of(part: object, path: str = "") -> Iterator[tuple[str, float]]:
    """Yield numbers of a section and of sections in it except motors: `viscous`, `friction.lugre: stiffness`."""
    for name, value in vars(part).items():
        if is_dataclass(value) and not isinstance(value, Motor):
            yield from _numbers_of(value, f"{path}.{name}" if path else name)
        for number in value if isinstance(value, tuple) else (value,):
            if isinstance(number, float):
                yield f"{path}: {name}" if path else name, number


def _turns(dimension: str) -> bool:
    return "rad" in dimension or "N*m" in dimension


def _converted_dimension(dimension: str) -> str:
    if _turns(dimension):
        return of_translation(dimension)
    return next(unit for unit in _OF_ROTATION if of_translation(unit) == dimension)


_OF_ROTATION = (
    *("N*m/rad", "N*m/rad^2", "N*m/rad^3", "N*m*s/rad", "N*m*s^2/rad^2", "rad", "rad/s", "rad/s^2"),
    *("rad/s^3", "N*m", "N*m/s", "N*m/K", "rad/(s*K)"),
)
