"""Dry friction of a motor (motor-side values) or a joint (link-side values), in sliding and presliding.

For a translation the values are in N, m and s: coulomb in N, stiffness in N/m, velocities in m/s.

Viscous friction is the `viscous` of the motor or joint itself, for every model: it is identifiable from frequency
responses above the Stribeck region, and has a parameter name.
"""

import math
from typing import Annotated

from elastid.base.section import Key, section
from elastid.base.units import (
    Damping,
    InUnit,
    JointTorque,
    JointVelocity,
    Measured,
    Stiffness,
    Temperature,
    TemperatureRise,
    translation_unit,
)


@section
class LuGre:
    """LuGre model: bristles with a Stribeck curve."""

    # fmt: off
    stiffness: Annotated[Stiffness, Key("Bristle stiffness sigma_0.", "Coulomb torque divided by the angle in which "
        "friction builds up after a reversal, 1e-5 to 1e-3 rad at a motor.", above=0)]
    damping: Annotated[Damping, Key("Bristle damping sigma_1.", "about the square root of stiffness times inertia "
        "damps presliding; larger values are not passive.", least=0)] = 0.0
    damping_velocity: Annotated[JointVelocity | None, Key("Velocity v_d in the bristle damping sigma_1 exp(-(v / "
        "v_d)^2) (default: constant bristle damping).", "for damping that must not add to viscous friction; at most "
        "9.3 coulomb / damping keeps the model passive.", above=0)] = None
    # fmt: on


@section
class MaxwellSlip:
    """Generalised Maxwell slip: parallel elements, each a spring that slips at its fraction of the Stribeck curve."""

    # fmt: off
    stiffness: Annotated[tuple[Stiffness, ...], Key("Stiffness sigma_0 of each element.", "one number per element; "
        "elements with a high ratio of stiffness to share slip first.", above=0)]
    shares: Annotated[tuple[float, ...], Key("Fraction nu of the friction torque in each element; the sum is 1.",
        "one number per stiffness; start with equal fractions.", above=0)]
    attraction: Annotated[Annotated[float, InUnit("N*m/s", "N/s")], Key("Attraction C: rate at which the torque of a "
        "slipping element approaches the Stribeck curve.", "larger values shorten the transient after break-away and "
        "need smaller time steps.", above=0)]
    damping: Annotated[tuple[Damping, ...], Key("Damping sigma_1 of each element (default: no damping).",
        "give some damping against oscillation at zero velocity; none for quasi-static loops.", least=0)] = ()
    # fmt: on

    def __post_init__(self) -> None:
        if not self.stiffness or len(self.stiffness) != len(self.shares):
            raise ValueError(
                f"maxwell_slip: {len(self.stiffness)} numbers of stiffness and {len(self.shares)} shares; give one of "
                "each for every element"
            )
        if self.damping and len(self.damping) != len(self.stiffness):
            raise ValueError(f"maxwell_slip: {len(self.damping)} dampings for {len(self.stiffness)} elements")
        if abs(sum(self.shares) - 1) > 1e-6:
            raise ValueError(f"maxwell_slip: the shares sum to {sum(self.shares):.6g}; they must sum to 1")


# A LuGre model with the bristle damping sigma_1 exp(-(v / v_d)^2) is passive if sigma_1(v) |v| <= 4 F_c for all v. The
# left side is largest at v = v_d / sqrt(2), so v_d <= 4 sqrt(2 e) F_c / sigma_1.
MAX_DAMPING_VELOCITY_RATIO = 4 * math.sqrt(2 * math.e)

EXPONENT_RANGE = (0.3, 4.0)  # of the Stribeck curve; published exponents are between 0.5 and 2


@section
class LoadDependence:
    """Additional friction per Nm (N) of the load on the joint, independent of the sign of the load."""

    # fmt: off
    coulomb: Annotated[float, Key("Coulomb friction per Nm of load, in Nm.", "0.01 to 0.1 for robot gears; three loads "
        "identify it.", least=0)] = 0.0
    stiction: Annotated[float | None, Key("Stiction per Nm of load, in Nm (default: as coulomb).", "only if slow "
        "constant-velocity runs were made at every load.", least=0)] = None
    stribeck_velocity: Annotated[JointVelocity | None, Key("Stribeck velocity nu_l of the load-dependent stiction "
        "(default: friction.stribeck_velocity).", "if the friction curves of two loads fall over different velocity "
        "ranges.", above=0)] = None
    # fmt: on

    def __post_init__(self) -> None:
        if self.stribeck_velocity is None:
            return
        if not self.of_stiction > self.coulomb:
            raise ValueError(
                f"load: stribeck_velocity has no effect, because stiction {self.of_stiction:g} is not above coulomb "
                f"{self.coulomb:g}. Remove it, or raise stiction"
            )

    @property
    def of_stiction(self) -> float:
        """Nm added to F_s by each Nm of load."""
        return self.coulomb if self.stiction is None else self.stiction


@section
class TemperatureDependence:
    r"""Friction at temperature T: dry friction and Stribeck velocity affine in T, viscous friction exponential.

    .. math:: F_c + c (T - T_0), \quad F_s + (a + c) (T - T_0), \quad \nu_s + b (T - T_0),
              \quad f + f_T (e^{-(T - T_0) / T_V} - 1)
    """

    # fmt: off
    reference: Annotated[Temperature, Key("Reference temperature T_0 of all other friction parameters.",
        "the mean measured temperature makes the estimates nearly uncorrelated.")]
    stiction: Annotated[Annotated[float, InUnit("N*m/K", "N/K")], Key("Temperature coefficient a of the stiction F_s.",
        "positive for grease that becomes thinner and is squeezed out, which is typical.")] = 0.0
    stribeck_velocity: Annotated[Annotated[float, InUnit("rad/(s*K)", "m/(s*K)")], Key("Temperature coefficient b of "
        "the Stribeck velocity nu_s.", "positive: a thinner lubricant film needs a higher velocity.")] = 0.0
    viscous: Annotated[Damping, Key("Amplitude f_T of the viscous friction that decreases exponentially with "
        "temperature.", "about half of the viscous friction between 34 and 64 degC in one industrial gear, a fifth in "
        "small robots.", least=0)] = 0.0
    decay: Annotated[TemperatureRise, Key("Temperature constant T_V of the exponential decrease.", "20 K was "
        "identified for an industrial gear; identification needs three temperatures over a wider "
        "range.", above=0)] = 20.0
    coulomb: Annotated[Annotated[float, InUnit("N*m/K", "N/K")], Key("Temperature coefficient c of the Coulomb "
        "friction F_c, which also applies to stiction.", "negative if seals and preload relax with temperature.")] = 0.0
    # fmt: on


@section
class Directions:
    """Friction that differs between directions: half of its excess at positive over negative velocity."""

    # fmt: off
    coulomb: Annotated[JointTorque, Key("Half the difference of Coulomb friction between the directions: F_c + coulomb "
        "forwards, F_c - coulomb backwards.", "for a difference that does not depend on speed; without varying gravity "
        "it is confounded with a torque offset.")] = 0.0
    viscous: Annotated[Damping, Key("Half the difference of viscous friction between the directions.",
        "half the difference of the slopes; on one published axis, -37 of 203 N*s/m lowers the residual from 3.6 to "
        "2.4 %.")] = 0.0


@section
class MeasuredRange:
    """Ranges in which a friction law was measured."""

    # fmt: off
    speed: Annotated[tuple[JointVelocity, JointVelocity] | None, Key("Lowest and highest measured speed, without sign "
        "(default: unknown range).", "from all constant-velocity runs; elastid warns when the model is "
        "extrapolated.", least=0)] = None
    load: Annotated[tuple[JointTorque, JointTorque] | None, Key("Lowest and highest measured load torque of the joint, "
        "without sign (default: unknown range).", "from all postures and payloads of the study.", least=0)] = None
    temperature: Annotated[tuple[Temperature, Temperature] | None, Key("Lowest and highest measured temperature "
        "(default: unknown range).", "temperature models extrapolate poorly: one published Stribeck velocity is 0 at "
        "25 degC.")] = None
    # fmt: on

    def __post_init__(self) -> None:
        for name in ("speed", "load", "temperature"):
            ends = getattr(self, name)
            if ends is not None and not ends[0] <= ends[1]:
                raise ValueError(f"measured: {name} is [{ends[0]:g}, {ends[1]:g}]; give [lowest, highest]")


@section
class Friction:
    """Dry friction about g(v) = F_c + (F_s - F_c) exp(-|v / nu_s|^a), plus alpha_3 v |v|."""

    # fmt: off
    coulomb: Annotated[JointTorque, Key("Coulomb friction F_c in sliding.", "half the torque difference between slow "
        "motion in both directions; with a Stribeck curve, at medium speeds.", above=0)]
    stiction: Annotated[JointTorque | None, Key("Stiction F_s, the break-away torque (default: coulomb).",
        "typically 1.1 to 2 times coulomb; it decides whether the joint sticks and slips at reversals.")] = None
    stribeck_velocity: Annotated[JointVelocity | None, Key("Stribeck velocity nu_s, over which friction falls from F_s "
        "to F_c (default: no Stribeck effect).", "needed with stiction; some percent of the maximum speed for "
        "grease-lubricated gears.", above=0)] = None
    quadratic: Annotated[Annotated[float, InUnit("N*m*s^2/rad^2", "N*s^2/m^2")], Key("Quadratic friction alpha_3, "
        "factor of v |v|.", "for oil churning at high speed; at one working speed a linear damping includes "
        "it.", least=0)] = 0.0
    exponent: Annotated[float, Key("Exponent a of the Stribeck curve.", "below 2 for a gradual fall, such as 1.36 of "
        "one measured gear; published values are 0.5 to 2.", least=EXPONENT_RANGE[0], most=EXPONENT_RANGE[1])] = 2.0
    lugre: Annotated[LuGre | None, Key("LuGre model of presliding (default: no presliding, sgn(v) g(v) smoothed at "
        "zero velocity).", "for control and observers with one state; it drifts under vibration, and with stiffness "
        "alone it is the Dahl model.")] = None
    maxwell_slip: Annotated[MaxwellSlip | None, Key("Generalised Maxwell slip model of presliding (default: no "
        "presliding, sgn(v) g(v) smoothed at zero velocity).", "for hysteresis with inner loops, such as in fine "
        "positioning; it has several states and simulates more slowly.")] = None
    load: Annotated[LoadDependence | None, Key("Load dependence of the friction (default: no dependence on load).",
        "for joints under varying gravity or payload.")] = None
    temperature: Annotated[TemperatureDependence | None, Key("Temperature dependence of the friction (default: no "
        "dependence on temperature).", "for studies over a shift, during which a gear warms up.")] = None
    directions: Annotated[Directions | None, Key("Difference of friction between positive and negative velocity "
        "(default: equal in both directions).", "for gears and cylinders loaded in one direction.")] = None
    measured: Annotated[MeasuredRange | None, Key("Ranges of speed, load and temperature in which the friction model "
        "was identified (default: unknown ranges).", "the friction fit writes it; extend it only after a "
        "measurement.")] = None
    # fmt: on

    def __post_init__(self) -> None:
        if self.directions is not None and not abs(self.directions.coulomb) < self.coulomb:
            raise ValueError(
                f"friction: directions: coulomb {self.directions.coulomb:g} must be below coulomb {self.coulomb:g}, or "
                "friction would drive in one direction. Give half of the difference between the directions"
            )
        if self.break_away < self.coulomb:
            unit = next((x.dimension for x in (self.coulomb, self.stiction) if isinstance(x, Measured)), "N*m")
            raise ValueError(
                f"friction: stiction (F_s) is {self.break_away:g} {unit}, below coulomb (F_c) of {self.coulomb:g} "
                f"{unit}. Exchange or correct them"
            )
        if self.stribeck_velocity is None and (self.break_away > self.coulomb or self.has_variable_stiction):
            raise ValueError("friction: stiction needs stribeck_velocity (nu_s), over which it falls to coulomb")
        if self.lugre is not None and self.maxwell_slip is not None:
            raise ValueError("friction: give at most one of lugre and maxwell_slip")

    @property
    def break_away(self) -> float:
        """F_s, Nm or N."""
        return self.coulomb if self.stiction is None else self.stiction

    @property
    def has_variable_stiction(self) -> bool:
        """True if load or temperature change F_s and F_c by different amounts, with the Stribeck velocity nu_s."""
        load, temperature = self.load, self.temperature
        by_load = load is not None and load.stribeck_velocity is None and load.of_stiction != load.coulomb
        return by_load or (temperature is not None and temperature.stiction != 0)

    def check_passive(self, viscous: float, slides: bool = False) -> None:
        """Raise ValueError for a friction model that is not passive.  viscous: f on the same side, Nms/rad (Ns/m).

        Viscous friction must exceed half of its difference between the directions.

        LuGre with constant sigma_1 is passive if f >= sigma_1 (F_s - F_c) / F_c, since |sigma_0 z| <= F_s gives
        sigma_1 v z' >= -sigma_1 v^2 (F_s - F_c) / F_c, and sigma_0 z v >= (sigma_0 z^2 / 2)'. With less f, a jump from
        slow sliding to a high v supplies energy. LuGre with decreasing sigma_1 is passive if v_d <= 4 sqrt(2 e) F_c /
        sigma_1, because sigma_0^2 |v| z^2 / g - sigma_0 sigma_1 |v| v z / g + sigma_1 v^2 >= 0.
        """
        difference = 0.0 if self.directions is None else abs(self.directions.viscous)
        if difference > viscous:
            raise ValueError(
                f"friction: directions: viscous {difference:.4g} must be below the viscous friction {viscous:.4g}, or "
                "friction would drive in one direction. Give half of the difference between the directions"
            )
        if self.lugre is None or self.lugre.damping == 0:
            return
        speed, damper = (translation_unit(unit) if slides else unit for unit in ("rad/s", "N*m*s/rad"))
        max_velocity = MAX_DAMPING_VELOCITY_RATIO * self.coulomb / self.lugre.damping
        if self.lugre.damping_velocity is not None:
            if self.lugre.damping_velocity > max_velocity:
                raise ValueError(
                    f"lugre: damping_velocity is {self.lugre.damping_velocity:.4g} {speed}. A passive model needs at "
                    f"most 4 sqrt(2 e) coulomb / damping = {max_velocity:.4g} {speed}. Lower it"
                )
            return
        minimum = self.lugre.damping * (self.break_away - self.coulomb) / self.coulomb
        if viscous < minimum:
            raise ValueError(
                f"lugre: not passive: constant damping {self.lugre.damping:.4g} needs viscous >= damping (stiction - "
                f"coulomb) / coulomb = {minimum:.4g} {damper} (got {viscous:.4g}). Give damping_velocity: "
                f"{0.9 * max_velocity:.2g} (or less), lower damping, or raise viscous"
            )
