r"""The friction of a robot: laws at its motors and joints, on the link side, under load and temperature.

With the ratio n of a motor: \tau_a = |n| \tau_m, v_m = |n| v_a, so torques go with |n|, stiffness and damping with n^2,
velocities with 1 / |n|.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from elastid.base.arrays import FloatArray
from elastid.friction.dynamic import Bristle, MaxwellElements, Stop
from elastid.friction.static import Curve, Expression, Law, Tustin
from elastid.robot import Directions, Friction, Robot


@dataclass(frozen=True)
class PlacedLaw:
    """A law at `motor <name>` or `joint <name>`, or of the torsion of `gear <name>`.

    `scale` = |ratio| of a motor, 1 at a joint; spec on its own side.

    slides: its own side translates, N and m; a motor's turns.  reverses: a positive velocity of the link is a negative
    one of its own side.
    """

    place: str
    law: Law
    spec: Friction
    scale: float
    slides: bool = False
    reverses: bool = False

    def symbols(self, numbers: Sequence[Expression]) -> Curve:
        """Return the curve of symbols, one for each of `static.CURVE`, without the parts that the law does not have."""
        load = self.spec.load
        F_c, F_s, inverse_nu_s, alpha_3, alpha_T = numbers[:5]
        curve = Curve(F_c, F_s, inverse_nu_s, alpha_3, alpha_T, exponent=self.spec.exponent)
        if load is not None and load.stribeck_velocity is not None:
            curve = replace(curve, F_l=numbers[5], inverse_nu_l=numbers[6])
        if self.spec.directions is not None:
            curve = replace(curve, delta_c=numbers[7], delta_v=numbers[8])
        return curve

    def curve(self, load: float = 0.0, temperature: float | None = None) -> FloatArray:
        """Return numbers (9,) of `static.CURVE`, link side, under a load in Nm of the link at a temperature in degC.

        temperature: the reference unless given.
        Raises ValueError where the temperature leaves less stiction than Coulomb friction, none of this, or no Stribeck
        velocity.
        """
        spec, n = self.spec, self.scale
        F_c, F_s, nu_s, alpha_T = spec.coulomb, spec.break_away, spec.stribeck_velocity, 0.0
        F_l, inverse_nu_l = 0.0, 0.0
        if spec.load is not None:
            by_load = spec.load.coulomb * abs(load) / n
            F_c += by_load
            stiction_load = (spec.load.of_stiction - spec.load.coulomb) * abs(load) / n
            F_s += by_load
            if spec.load.stribeck_velocity is None:
                F_s += stiction_load
            else:
                F_l, inverse_nu_l = stiction_load, n / spec.load.stribeck_velocity
        if spec.temperature is not None and temperature is not None:
            warm, rise = spec.temperature, temperature - spec.temperature.reference
            F_c += warm.coulomb * rise
            F_s += (warm.stiction + warm.coulomb) * rise
            nu_s = None if nu_s is None else nu_s + warm.stribeck_velocity * rise
            alpha_T = warm.viscous * math.expm1(-rise / warm.decay)
        self._check(F_c, F_s, nu_s, load, temperature)
        inverse = 0.0 if nu_s is None else n / nu_s
        directions, turn = spec.directions or Directions(), -1.0 if self.reverses else 1.0
        sliding = n * np.array([F_c, F_s, n**2 * spec.quadratic, n * alpha_T])
        extra = n * np.array([F_l, turn * directions.coulomb, turn * n * directions.viscous])
        return np.array([*sliding[:2], inverse, *sliding[2:], extra[0], inverse_nu_l, *extra[1:]])

    def sliding(self, v: float, load: float = 0.0, temperature: float | None = None) -> float:
        """Return tau_f of steady sliding at v > 0, link side, without the viscous friction of motor or joint."""
        curve = self.symbols(self.curve(load, temperature).tolist())
        return float(curve.torque(v) + curve.growing(v))

    def _check(self, F_c: float, F_s: float, nu_s: float | None, load: float, temperature: float | None) -> None:
        torque, speed = ("N", "m/s") if self.slides else ("N*m", "rad/s")
        state = f"friction of {self.place} under a load of {load:.4g} {torque}"
        state += "" if temperature is None else f" at {temperature:.4g} degC"
        faults = (
            (F_c < 0, f"Coulomb friction falls to {F_c:.4g} {torque}; correct its dependence on temperature"),
            (F_s < F_c * (1 - 1e-12), f"stiction falls to {F_s:.4g} {torque}, below coulomb of {F_c:.4g} {torque}; "
                "correct its dependence on load and temperature"),
            (nu_s is not None and not nu_s > 0,
                f"stribeck_velocity falls to {nu_s or 0.0:.4g} {speed}; correct its temperature slope"),
        )  # fmt: skip
        for is_wrong, text in faults:
            if is_wrong:
                raise ValueError(f"{state}: {text}")

    def at_rest(self) -> tuple[float, float]:
        """Return stiffness and damping at rest, link side, Nm/rad and Nms/rad."""
        curve = self.curve()
        return self.law.at_rest(float(curve[0]), float(curve[1]))


def frictions(robot: Robot) -> tuple[PlacedLaw, ...]:
    """Return all dry friction of a robot and hysteresis of its gears, motors first.

    A motor's `coulomb` alone is Coulomb's law, smoothed."""
    laws = []
    for joint in robot.driven:
        motor = joint.motor
        if motor is not None and (spec := motor.dry_friction) is not None:
            n = abs(motor.ratio)
            laws.append(PlacedLaw(f"motor {joint.name}", _law(spec, n), spec, n, reverses=motor.ratio < 0))
    for joint in robot.joints:
        if joint.friction is not None:
            laws.append(PlacedLaw(f"joint {joint.name}", _law(joint.friction, 1.0), joint.friction, 1.0, joint.slides))
        for element in () if joint.gear is None else joint.gear.hysteresis:
            stiffness = element.torque / element.deflection
            spring = Stop(stiffness) if element.edge == "sharp" else Bristle(stiffness)
            laws.append(PlacedLaw(f"gear {joint.name}", spring, Friction(element.torque), 1.0, joint.slides))
    return tuple(laws)


def joint_laws(robot: Robot, joint: str) -> list[PlacedLaw]:
    """Return the laws at a joint and at its motor."""
    return [law for law in frictions(robot) if law.place in (f"motor {joint}", f"joint {joint}")]


def coulomb_torques(robot: Robot) -> FloatArray:
    """Return the break-away torque F_c (n_u,) of each motor and its rigidly driven joint, in Nm, link side.

    A gear spring lets the motor move against a joint that sticks: there the friction of the joint does not count.
    """
    torques = {law.place: float(law.curve()[0]) for law in frictions(robot)}
    rigid = [0.0 if joint in robot.flexible else torques.get(f"joint {joint.name}", 0.0) for joint in robot.driven]
    return np.add([torques.get(f"motor {joint.name}", 0.0) for joint in robot.driven], rigid)


def _law(spec: Friction, n: float) -> Law:
    if spec.lugre is not None:
        bristle = spec.lugre
        inverse = 0.0 if bristle.damping_velocity is None else n / bristle.damping_velocity
        return Bristle(n**2 * bristle.stiffness, n**2 * bristle.damping, inverse)
    if spec.maxwell_slip is not None:
        slip = spec.maxwell_slip
        return MaxwellElements(
            tuple(n**2 * k for k in slip.stiffness),
            slip.shares,
            tuple(n**2 * d for d in slip.damping or (0.0,) * len(slip.stiffness)),
            n * slip.attraction,
        )
    return Tustin()
