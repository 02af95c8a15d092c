r"""Named link-side parameters of dry friction, and the conversion of friction models between both sides of a gear.

With the ratio n of a motor, \tau_l = |n| \tau_m and v_m = |n| v_l: link-side torques are |n| times, velocities 1 / |n|
times and dampings n^2 times as large. `TERMS` lists the names: Fc_m1 is Coulomb friction at the motor of joint 1.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace

from elastid.base.units import translation_unit
from elastid.robot.friction import Friction
from elastid.robot.joint import Joint
from elastid.robot.placement import Path, number_at, replaced
from elastid.robot.robot import Robot
from elastid.robot.simplified import with_joints


@dataclass(frozen=True)
class FrictionTerm:
    """Parameter of a friction model: `path` in the robot model, prefix of its name, symbol, meaning, unit for rotation.

    power: link-side value = |n|^power motor-side value.  turns: True if its sign changes with the sign of n.
    """

    path: str
    prefix: str
    symbol: str
    meaning: str
    unit: str
    power: int
    turns: bool = False

    def name(self, joint: str) -> str:
        """Return the name of the parameter for the motor of a joint.

        >>> TERMS["coulomb"].name("1")
        'Fc_m1'
        """
        return f"{self.prefix}_m{joint}"

    def unit_at(self, slides: bool) -> str:
        """Return the unit of the number on the link side."""
        return translation_unit(self.unit) if slides and self.unit else self.unit


def _term(row: str) -> FrictionTerm:
    path, prefix, symbol, unit, power, turns, meaning = row.split(maxsplit=6)
    return FrictionTerm(path, prefix, symbol, meaning, unit.strip("-"), int(power), turns == "turns")


# Path, prefix, symbol, unit, power, `turns`, meaning.
_TERMS = """
coulomb Fc F_c N*m 1 - Coulomb friction
stiction Fs F_s N*m 1 - stiction
stribeck_velocity vs nu_s rad/s -1 - Stribeck velocity
exponent a a - 0 - exponent of the Stribeck curve
viscous f f N*m*s/rad 2 - viscous friction
quadratic f2 alpha_3 N*m*s^2/rad^2 3 - quadratic friction
load.coulomb Fcl F_cl - 0 - Coulomb friction by load
load.stiction Fsl F_sl - 0 - stiction by load
load.stribeck_velocity vl nu_l rad/s -1 - Stribeck velocity of the load
temperature.coulomb FcT F_cT N*m/K 1 - Coulomb friction by heat
temperature.stiction FsT F_sT N*m/K 1 - stiction by heat
temperature.stribeck_velocity vsT nu_T rad/(s*K) -1 - Stribeck velocity by heat
temperature.viscous fT f_T N*m*s/rad 2 - viscous friction that vanishes with heat
temperature.decay TV T_V K 0 - decay of viscous friction with heat
directions.coulomb dFc delta_c N*m 1 turns F_c by direction
directions.viscous df delta_v N*m*s/rad 2 turns f by direction
lugre.stiffness s0 sigma_0 N*m/rad 2 - stiffness of the bristles
lugre.damping s1 sigma_1 N*m*s/rad 2 - damping of the bristles
"""
TERMS: dict[str, FrictionTerm] = {term.path: term for term in map(_term, _TERMS.strip().splitlines())}


def through_gear(friction: Friction, n: float, to_motor: bool) -> Friction:
    """Convert a friction model from the link side to a motor with ratio n, or from the motor to the link side."""
    scale = 1 / abs(n) if to_motor else abs(n)
    powers = {term.path: (term.power, term.turns) for term in TERMS.values() if term.path != "viscous"}
    powers["lugre.damping_velocity"] = (-1, False)  # has no name, but converts like a velocity
    values = {}
    for path, (power, turns) in powers.items():
        keys: Path = tuple(path.split("."))
        if _present(friction, keys):
            values[keys] = number_at(friction, keys) * scale**power * (-1.0 if turns and n < 0 else 1.0)
    law: Friction = replaced(friction, values)
    slip, measured = friction.maxwell_slip, friction.measured
    if measured is not None:
        speed, load = _scale(measured.speed, 1 / scale), _scale(measured.load, scale)
        law = replace(law, measured=replace(measured, speed=speed, load=load))
    if slip is None:
        return law
    stiffness = tuple(scale**2 * k for k in slip.stiffness)
    damping = tuple(scale**2 * d for d in slip.damping)
    slip = replace(slip, stiffness=stiffness, damping=damping, attraction=scale * slip.attraction)
    return replace(law, maxwell_slip=slip)


def law_of(robot: Robot, joint: str) -> Friction | None:
    """Return the friction model of a joint's motor with link-side values; None without dry friction."""
    motor = next(driven.motor for driven in robot.driven if driven.name == joint)
    law = None if motor is None else motor.dry_friction
    return None if law is None or motor is None else through_gear(law, motor.ratio, to_motor=False)


def friction_numbers(robot: Robot) -> dict[str, tuple[float, str]]:
    """Return the link-side value and unit of each friction parameter of the robot's motors, by name."""
    numbers = {}
    for joint in robot.driven:
        motor, law = joint.motor, law_of(robot, joint.name)
        if motor is None or law is None:
            continue
        for term in TERMS.values():
            keys, unit = tuple(term.path.split(".")), term.unit_at(joint.slides)
            if term.path == "viscous":
                numbers[term.name(joint.name)] = (motor.link_viscous, unit)
            elif _present(law, keys):
                numbers[term.name(joint.name)] = (number_at(law, keys), unit)
    return numbers


def with_numbers(robot: Robot, values: Mapping[str, float]) -> Robot:
    """Return the robot with other parameters, including link-side friction, as `Robot.with_parameters`."""
    friction = friction_numbers(robot)
    other_values = {name: value for name, value in values.items() if name not in friction}
    new_robot = robot.with_parameters(other_values) if other_values else robot
    laws = {}
    for joint in new_robot.driven:
        names = {term.path: term.name(joint.name) for term in TERMS.values()}
        numbers = {path: values[name] for path, name in names.items() if name in values and name in friction}
        law = law_of(new_robot, joint.name)
        if numbers and law is not None and joint.motor is not None:
            viscous = numbers.pop("viscous", joint.motor.link_viscous)
            laws[joint.name] = replaced(law, {tuple(path.split(".")): x for path, x in numbers.items()}), viscous
    return with_laws(new_robot, laws) if laws else new_robot


def with_laws(robot: Robot, laws: Mapping[str, tuple[Friction, float]]) -> Robot:
    """Return the robot with other friction models and viscous friction at motors, by joint; both link-side."""

    def changed(joint: Joint) -> Joint:
        if joint.name not in laws or joint.motor is None:
            return joint
        (law, viscous), n = laws[joint.name], joint.motor.ratio
        motor = replace(joint.motor, viscous=viscous / n**2, coulomb=0.0, friction=through_gear(law, n, to_motor=True))
        return replace(joint, motor=motor)

    return with_joints(robot, changed)


def _present(friction: Friction, keys: Path) -> bool:
    section: object = friction
    for key in keys:
        section = getattr(section, str(key), None)
    return section is not None


def _scale(ends: tuple[float, float] | None, factor: float) -> tuple[float, float] | None:
    return None if ends is None else (ends[0] * factor, ends[1] * factor)
