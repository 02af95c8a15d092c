"""The dry friction of a motor or a joint: numbers on the side of the place that they stand at, no equations.

Across a joint that slides they are in N, m and s: coulomb in N, stiffness in N/m, velocities in m/s.

The viscous part of every law is the `viscous` of the motor or joint itself: it is the one that a frequency response
above the Stribeck region sees, and has a name.
"""

from __future__ import annotations

import math
from typing import Annotated, Literal

from elastid.base.section import section
from elastid.base.units import (
    Damping,
    InUnit,
    JointTorque,
    JointVelocity,
    Measured,
    Stiffness,
    Temperature,
    TemperatureRise,
    of_translation,
)

# A LuGre law whose micro-damping dies out like exp(-(v / v_d)^2) is passive where sigma_1(v) |v| <= 4 F_c everywhere;
# the left side is largest at v = v_d / sqrt(2), so v_d <= 4 sqrt(2 e) F_c / sigma_1.
MAX_DAMPING_VELOCITY_RATIO = 4 * math.sqrt(2 * math.e)


@section
class Dahl:
    """Bristles that break at the Coulomb level; no Stribeck effect.

    stiffness: sigma_0 of the bristles.
    """

    stiffness: Stiffness

    def __post_init__(self) -> None:
        """Refuse bristles that push."""
        _positive("dahl: stiffness (sigma_0)", self.stiffness)


@section
class LuGre:
    """Bristles under a Stribeck curve.

    stiffness: sigma_0 of the bristles.  damping: sigma_1 of the bristles.  damping_velocity: v_d, with which their
    damping falls, sigma_1 exp(-(v / v_d)^2); default: constant.
    """

    stiffness: Stiffness
    damping: Damping = 0.0
    damping_velocity: JointVelocity | None = None

    def __post_init__(self) -> None:
        """Refuse bristles that push."""
        _positive("lugre: stiffness (sigma_0)", self.stiffness)
        _not_negative("lugre: damping (sigma_1)", self.damping)
        if self.damping_velocity is not None:
            _positive("lugre: damping_velocity (v_d)", self.damping_velocity)


@section
class MaxwellSlip:
    """Generalised Maxwell slip: elements side by side, each a spring that slips at its share of the Stribeck curve.

    stiffness: sigma_0 of every element.  shares: nu of every element, 1 in sum.  attraction: C, how fast the torque of
    a slipping element goes to its level.  damping: sigma_1 of every element (default: none).
    switching: `smooth` between sticking and slipping without a memory of its own, or by `events`.
    """

    stiffness: tuple[Stiffness, ...]
    shares: tuple[float, ...]
    attraction: Annotated[float, InUnit("N*m/s", "N/s")]
    damping: tuple[Damping, ...] = ()
    switching: Literal["smooth", "events"] = "smooth"

    def __post_init__(self) -> None:
        """As many numbers as elements, shares that sum to one."""
        if not self.stiffness or len(self.stiffness) != len(self.shares):
            raise ValueError(
                f"maxwell_slip: {len(self.stiffness)} numbers of stiffness and {len(self.shares)} shares; give one of "
                "each for every element"
            )
        if self.damping and len(self.damping) != len(self.stiffness):
            raise ValueError(f"maxwell_slip: {len(self.damping)} dampings for {len(self.stiffness)} elements")
        for name, values in (("stiffness (sigma_0)", self.stiffness), ("shares (nu)", self.shares)):
            for value in values:
                _positive(f"maxwell_slip: {name}", value)
        for value in self.damping:
            _not_negative("maxwell_slip: damping (sigma_1)", value)
        _positive("maxwell_slip: attraction (C)", self.attraction)
        if abs(sum(self.shares) - 1) > 1e-6:
            raise ValueError(f"maxwell_slip: the shares sum to {sum(self.shares):.6g}; they must sum to 1")


@section
class LoadDependence:
    """Friction that each Nm (N per N) of load on the joint adds, whatever its sign.

    coulomb: Nm of Coulomb level for each Nm.  stiction: Nm of stiction for each Nm; as much as coulomb unless given.
    """

    coulomb: float = 0.0
    stiction: float | None = None

    def __post_init__(self) -> None:
        """Refuse friction that falls with the load."""
        _not_negative("load: coulomb", self.coulomb)
        _not_negative("load: stiction", self.of_stiction)

    @property
    def of_stiction(self) -> float:
        """Nm added to F_s by each Nm of load."""
        return self.coulomb if self.stiction is None else self.stiction


@section
class TemperatureDependence:
    r"""Friction at temperature T: stiction and Stribeck velocity affine in T, viscous friction falling exponentially.

    .. math:: F_s + a (T - T_0), \quad \nu_s + b (T - T_0), \quad f + f_T (e^{-(T - T_0) / T_V} - 1)

    reference: T_0, where the other numbers hold.  stiction: a, change of F_s with T.  stribeck_velocity: b, change of
    nu_s with T.  viscous: f_T, part of viscous friction that vanishes with heat.  decay: T_V, over which it falls.
    """

    reference: Temperature
    stiction: Annotated[float, InUnit("N*m/K", "N/K")] = 0.0
    stribeck_velocity: Annotated[float, InUnit("rad/(s*K)", "m/(s*K)")] = 0.0
    viscous: Damping = 0.0
    decay: TemperatureRise = 20.0

    def __post_init__(self) -> None:
        """Refuse oil that thickens with heat."""
        _not_negative("temperature: viscous (f_T)", self.viscous)
        _positive("temperature: decay (T_V)", self.decay)


@section
class Friction:
    r"""Dry friction about g(v) = F_c + (F_s - F_c) exp(-(v / nu_s)^2), plus alpha_3 v |v|.

    coulomb: level F_c of sliding friction.  stiction: level F_s of break-away (default: F_c).  stribeck_velocity: nu_s,
    over which it falls from F_s to F_c.  quadratic: alpha_3, factor of v |v|.
    dahl, lugre, maxwell_slip: presliding, by at most one of these laws; without one the torque is sgn(v) g(v) (Tustin's
    law), smoothed at standstill.
    load: how friction grows with the joint's load.  temperature: how friction changes with temperature.
    """

    coulomb: JointTorque
    stiction: JointTorque | None = None
    stribeck_velocity: JointVelocity | None = None
    quadratic: Annotated[float, InUnit("N*m*s^2/rad^2", "N*s^2/m^2")] = 0.0
    dahl: Dahl | None = None
    lugre: LuGre | None = None
    maxwell_slip: MaxwellSlip | None = None
    load: LoadDependence | None = None
    temperature: TemperatureDependence | None = None

    def __post_init__(self) -> None:
        """Refuse laws that contradict themselves."""
        _positive("friction: coulomb (F_c)", self.coulomb)
        _not_negative("friction: quadratic (alpha_3)", self.quadratic)
        if self.stribeck_velocity is not None:
            _positive("friction: stribeck_velocity (nu_s)", self.stribeck_velocity)
        if self.break_away < self.coulomb:
            unit = next((x.dimension for x in (self.coulomb, self.stiction) if isinstance(x, Measured)), "N*m")
            raise ValueError(
                f"friction: stiction (F_s) is {self.break_away:g} {unit}, below coulomb (F_c) of {self.coulomb:g} "
                f"{unit}; break-away takes at least the torque of sliding: exchange or correct them"
            )
        if self.stribeck_velocity is None and (self.break_away > self.coulomb or self.has_variable_stiction):
            raise ValueError("friction: stiction needs stribeck_velocity (nu_s), over which it falls to coulomb")
        if sum(kind is not None for kind in (self.dahl, self.lugre, self.maxwell_slip)) > 1:
            raise ValueError("friction: give at most one of dahl, lugre and maxwell_slip")
        if self.dahl is not None and (self.break_away > self.coulomb or self.has_variable_stiction):
            raise ValueError("friction: dahl has no Stribeck effect; leave stiction out, or take lugre")

    @property
    def break_away(self) -> float:
        """F_s, Nm or N."""
        return self.coulomb if self.stiction is None else self.stiction

    @property
    def has_variable_stiction(self) -> bool:
        """Whether load or temperature change F_s by other amounts than F_c."""
        return (self.load is not None and self.load.of_stiction != self.load.coulomb) or (
            self.temperature is not None and self.temperature.stiction != 0
        )

    def check_passive(self, viscous: float, slides: bool = False) -> None:
        """ValueError for a LuGre law that can supply energy.  viscous: f on the same side, Nms/rad (slides: Ns/m).

        A constant sigma_1 needs f >= sigma_1 (F_s - F_c) / F_c. It is enough, since |sigma_0 z| <= F_s leaves
        sigma_1 v z' >= -sigma_1 v^2 (F_s - F_c) / F_c, and sigma_0 z v >= (sigma_0 z^2 / 2)'; with less, a jump from
        slow sliding to a high v supplies more energy than the bristles hold. A falling sigma_1 needs
        v_d <= 4 sqrt(2 e) F_c / sigma_1: then sigma_0^2 |v| z^2 / g - sigma_0 sigma_1 |v| v z / g + sigma_1 v^2 >= 0.
        """
        if self.lugre is None or self.lugre.damping == 0:
            return
        speed, damper = (of_translation(unit) if slides else unit for unit in ("rad/s", "N*m*s/rad"))
        fastest = MAX_DAMPING_VELOCITY_RATIO * self.coulomb / self.lugre.damping
        if self.lugre.damping_velocity is not None:
            if self.lugre.damping_velocity > fastest:
                raise ValueError(
                    f"lugre: damping_velocity is {self.lugre.damping_velocity:.4g} {speed}; above "
                    f"4 sqrt(2 e) coulomb / damping = {fastest:.4g} {speed} the law can supply energy; lower it"
                )
            return
        needed = self.lugre.damping * (self.break_away - self.coulomb) / self.coulomb
        if viscous < needed:
            raise ValueError(
                f"lugre: not passive, it can supply energy: a constant damping of {self.lugre.damping:.4g} needs "
                f"viscous >= damping (stiction - coulomb) / coulomb = {needed:.4g} {damper}, and viscous is "
                f"{viscous:.4g}; give damping_velocity: {0.9 * fastest:.2g} (or less), lower damping, or raise viscous"
            )


def _positive(name: str, value: float) -> None:
    if not value > 0:
        raise ValueError(f"{name} is {value:g}; it must be positive")


def _not_negative(name: str, value: float) -> None:
    if value < 0:
        raise ValueError(f"{name} is {value:g}; it must not be negative")
