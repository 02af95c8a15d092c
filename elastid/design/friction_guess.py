"""What a friction law may be before it is measured: the numbers of the robot's file, else those of common gears."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

from elastid.design.pass_speeds import StribeckGuess
from elastid.friction.robot_friction import frictions
from elastid.robot import Joint, Robot

# Where the file has no friction: parts of the largest torque and of the highest speed (LiTH-ISY-R-2948 has F_c of 3 %
# of the rating and nu_s of 5 % of the speed; its viscous friction at full speed is three times F_c).
COULOMB_SHARE, VELOCITY_SHARE, STICTION_RATIO, VISCOUS_RATIO = 0.03, 0.05, 1.6, 2.0
# Stribeck velocities that a design serves, over the guessed one: it is the number that is known least.
VELOCITY_SPREAD = (0.4, 1.0, 2.5)
# Of a joint without limits: torque over its inertia times 1 rad/s^2, and speed.
FREE_TORQUE_RATE, FREE_SPEED = 10.0, 2.0


@dataclass(frozen=True)
class FrictionGuess:
    """law: link side.  is_from_file: whether the robot's file has it, or the defaults."""

    law: StribeckGuess
    is_from_file: bool

    @property
    def spread(self) -> tuple[StribeckGuess, ...]:
        """The laws that a design must serve."""
        nu_s = self.law.stribeck_velocity
        return tuple(replace(self.law, stribeck_velocity=factor * nu_s) for factor in VELOCITY_SPREAD)

    def torque(self, speed: float) -> float:
        """F(v), Nm: what braking takes at a speed."""
        law = self.law
        fall = math.exp(-float((speed / law.stribeck_velocity) ** law.exponent))
        return law.coulomb + (law.stiction - law.coulomb) * fall + law.viscous * speed

    def slope(self, speed: float) -> float:
        """dF / dv, Nms/rad: negative where friction falls with speed."""
        law = self.law
        x = float((speed / law.stribeck_velocity) ** law.exponent)
        return law.viscous - (law.stiction - law.coulomb) * law.exponent * x * math.exp(-x) / speed


def guess_friction(robot: Robot, joint: Joint, inertia: float) -> FrictionGuess:
    """The friction of a driven joint as far as the file tells it.

    inertia: of the joint in kg m^2, link side, from which that of a joint without limits follows.  Stiction and
    Stribeck velocity that the file does not have are those of common gears.
    """
    speed = joint.limits.velocity if math.isfinite(joint.limits.velocity) else FREE_SPEED
    torque = joint.limits.torque if math.isfinite(joint.limits.torque) else FREE_TORQUE_RATE * inertia
    viscous = joint.viscous + (0.0 if joint.motor is None else joint.motor.viscous * joint.motor.ratio**2)
    placed = [one for one in frictions(robot) if one.place in (f"motor {joint.name}", f"joint {joint.name}")]
    curves = [one.curve().tolist() for one in placed]
    coulomb = sum(curve[0] for curve in curves) or COULOMB_SHARE * torque
    excess = sum(curve[1] - curve[0] for curve in curves) or (STICTION_RATIO - 1) * coulomb
    nu_s = next((1 / curve[2] for curve in curves if curve[2] > 0), VELOCITY_SHARE * speed)
    exponent = next((one.spec.exponent for one in placed if one.spec.stribeck_velocity is not None), 2.0)
    viscous = viscous or VISCOUS_RATIO * coulomb / speed
    return FrictionGuess(StribeckGuess(coulomb, coulomb + excess, viscous, nu_s, exponent), bool(placed))
