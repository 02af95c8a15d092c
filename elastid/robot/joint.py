"""A joint between two bodies, its motor, and its limits."""

import math
from collections.abc import Iterator
from dataclasses import field, is_dataclass
from typing import Annotated, Literal, TypeAlias

from elastid.base.names import PartName
from elastid.base.section import Key, section
from elastid.base.units import Angle, Damping, Inertia, InUnit, JointPosition, Measured, Torque, translation_unit
from elastid.robot.friction import Friction
from elastid.robot.gear_effects import Gear
from elastid.robot.placement import Axis, Numbers, Vector3, below, coordinates, unit_axis
from elastid.robot.spring import Spring


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
        """Viscous friction on the link side."""
        return self.viscous * self.ratio**2

    @property
    def dry_friction(self) -> Friction | None:
        """Model of dry friction; Coulomb friction if only `coulomb` is given, None without dry friction."""
        return Friction(self.coulomb) if self.friction is None and self.coulomb > 0 else self.friction

    def numbers(self, joint: str) -> Numbers:
        """Return Jm_ and fm_ of a joint, km_ and dm_ of the motor's shaft, on the motor side."""
        entries: Numbers = {f"Jm_{joint}": ("kg*m^2", ("inertia",)), f"fm_{joint}": ("N*m*s/rad", ("viscous",))}
        if self.spring is None:
            return entries
        shaft = {f"{name[0]}m{name[1:]}": path for name, path in self.spring.numbers(joint).items()}
        return entries | below("spring", shaft)


# Infinite without a limit.
PositionLimit: TypeAlias = Annotated[float, InUnit("rad", "m", is_finite=False)]
VelocityLimit: TypeAlias = Annotated[float, InUnit("rad/s", "m/s", is_finite=False)]
AccelerationLimit: TypeAlias = Annotated[float, InUnit("rad/s^2", "m/s^2", is_finite=False)]
JerkLimit: TypeAlias = Annotated[float, InUnit("rad/s^3", "m/s^3", is_finite=False)]
TorqueLimit: TypeAlias = Annotated[float, InUnit("N*m", "N", is_finite=False)]
OptionalSpring: TypeAlias = Annotated[Spring | None, Key("Spring of the gear or of an elastic joint (default: rigid "
    "gear; without a motor, a free joint).", "give it to every driven joint whose gear is elastic, and to every joint "
    "that models bending or bearing tilt.")]  # fmt: skip
OptionalMotor: TypeAlias = Annotated[Motor | None, Key("Motor that drives the joint (default: no motor).", "for every "
    "axis with a drive; configurations list angles in the order of the driven joints.")]  # fmt: skip


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
    spring: OptionalSpring = None
    motor: OptionalMotor = None
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
        """True without motor and spring: gravity or a loop moves the joint."""
        return self.motor is None and self.spring is None

    @property
    def all_viscous(self) -> float:
        """Viscous friction of joint and motor together, link side."""
        return self.viscous + (0.0 if self.motor is None else self.motor.link_viscous)

    @property
    def is_flexible(self) -> bool:
        """True if driven through its own spring; `Robot.flexible` also includes gears that couplings make elastic."""
        return self.motor is not None and (self.spring is not None or self.motor.spring is not None)

    @property
    def slides(self) -> bool:
        """True for a translation."""
        return self.motion == "translation"

    @property
    def cells(self) -> tuple[str, str, str, str]:
        """Axis, gear ratio, stiffness and damping as table cells, empty for missing values."""
        direction = (
            self.axis if isinstance(self.axis, str) else ", ".join(f"{component:.4g}" for component in self.axis)
        )
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
        across = spring | {f"f_{self.name}": ("N*m*s/rad", ("viscous",))}
        if self.slides:
            across = {name: (translation_unit(unit), path) for name, (unit, path) in across.items()}
        return across | motor

    @property
    def geometry(self) -> Numbers:
        """Point pj_ on the axis of a rotation, and zero offset zero_ of a driven joint."""
        if self.slides:
            return {}
        zero = {f"zero_{self.name}": ("rad", ("zero",))} if self.motor is not None else {}
        return coordinates(f"pj_{self.name}", ("point",)) | zero

    @property
    def unit(self) -> str:
        """Unit of the position: rad or m."""
        return "m" if self.slides else "rad"

    def refusal_of(self, number: float) -> str:
        """Return why the unit of a number is wrong for this joint; empty if it is right."""
        if not isinstance(number, Measured) or _turns(number.dimension) != self.slides:
            return ""
        hint = "" if self.slides else " (motion: translation makes it slide)"
        return (
            f"is given in units of {number.dimension}, but joint {self.name} is a {self.motion}{hint}; "
            f"give it in {_convert_dimension(number.dimension)}"
        )

    def position_refusal(self, at: float, swing: float = 0.0) -> str:
        """Return why a position and an amplitude about it, rad or m, are impossible; empty if they are possible."""
        low, high = self.limits.angle
        # Without limits: more than 50 m or two revolutions suggest another unit.
        if math.isinf(high - low) and abs(at) > (50.0 if self.slides else 4 * math.pi):
            turns = "" if self.slides else f", {abs(at) / (2 * math.pi):.2g} turns,"
            return (
                f"joint {self.name} at {at:g} {self.unit}{turns} is farther than robots go; a number without a unit is "
                f"in {self.unit}: write '{at:g} {'mm' if self.slides else 'deg'}' if that is meant, or give the joint "
                "its limits"
            )
        if low <= at - swing <= at + swing <= high:
            return ""
        range_text = f" with the carrier's {swing:.4g} {self.unit} to either side" if swing else ""
        return (
            f"joint {self.name} at {at:.4g} {self.unit}{range_text} is outside its limits [{low:.4g}, {high:.4g}] "
            f"{self.unit}"
        )

    def _check_units(self) -> None:
        """Check the units of values: the joint's kind of motion for the joint, rotation for its motor."""
        for name, number in _numbers_of(self):
            if refusal := self.refusal_of(number):
                raise ValueError(f"{name} {refusal}")
        for name, number in () if self.motor is None else _numbers_of(self.motor):
            if isinstance(number, Measured) and not _turns(number.dimension):
                raise ValueError(
                    f"motor: {name} of joint {self.name} is given in units of {number.dimension}, but a motor turns, "
                    f"its ratio leads to the joint; give it in {_convert_dimension(number.dimension)}"
                )


def _numbers_of(section: object, path: str = "") -> Iterator[tuple[str, float]]:
    """Yield numbers of a section and of sections in it except motors: `viscous`, `friction.lugre: stiffness`."""
    for name, value in vars(section).items():
        if is_dataclass(value) and not isinstance(value, Motor):
            yield from _numbers_of(value, f"{path}.{name}" if path else name)
        for number in value if isinstance(value, tuple) else (value,):
            if isinstance(number, float):
                yield f"{path}: {name}" if path else name, number


def _turns(dimension: str) -> bool:
    return "rad" in dimension or "N*m" in dimension


def _convert_dimension(dimension: str) -> str:
    if _turns(dimension):
        return translation_unit(dimension)
    return next(unit for unit in _OF_ROTATION if translation_unit(unit) == dimension)


_OF_ROTATION = (
    *("N*m/rad", "N*m/rad^2", "N*m/rad^3", "N*m*s/rad", "N*m*s^2/rad^2", "rad", "rad/s", "rad/s^2"),
    *("rad/s^3", "N*m", "N*m/s", "N*m/K", "rad/(s*K)"),
)
