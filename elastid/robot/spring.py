r"""The spring of a joint: gearbox, bearing or link, linear or not.

.. math:: \tau(\Delta) = k_i \Delta + (k - k_i)\, g_b(\Delta) + k_2 \Delta^2 + k_{2s} \Delta |\Delta| + k_3 \Delta^3
          + d \dot\Delta, \qquad
          g_b = \tfrac12 \left[ 2 \Delta + \sqrt{(\Delta - b)^2 + e^2} - \sqrt{(\Delta + b)^2 + e^2} \right]

Without backlash g_b = Delta: a stiffness k. With backlash, the stiffness is k outside the gap +-b and k_i inside: 0 for
free play, more for a gear with a kinked characteristic; e -> 0 gives a sharp dead zone. Niglis & Oberg (2015), eq.
(2.13) for the polynomial.

The linear model has the tangent stiffness under gravity, for small motion. A multisine with an rms deflection sigma
increases the stiffness of a cubic spring by about 3 k_3 sigma^2: keep sigma well below the deflection by gravity.
"""

import math
from typing import Annotated

from elastid.base.section import Key, section
from elastid.base.units import CubicStiffness, Damping, JointPosition, QuadraticStiffness, Ratio, Stiffness
from elastid.robot.placement import Numbers

# Field, parameter and unit of the optional terms of a spring.
_OPTIONAL_TERMS = (
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
        """True if the stiffness does not depend on the deflection."""
        return all(getattr(self, field) is None for field, _, _ in _OPTIONAL_TERMS)

    def numbers(self, joint: str) -> Numbers:
        """Return k_ and d_ of a joint, then the optional terms of the spring (k2_, k2s_, k3_, b_, ki_ and e_)."""
        present = [row for row in _OPTIONAL_TERMS if getattr(self, row[0]) is not None]
        present += (("inner_stiffness", "ki", "N*m/rad"), ("rounding", "e", "1")) if self.backlash is not None else ()
        first: Numbers = {f"k_{joint}": ("N*m/rad", ("stiffness",)), f"d_{joint}": ("N*m*s/rad", ("damping",))}
        return first | {f"{letter}_{joint}": (unit, (field,)) for field, letter, unit in present}

    def _check_monotone(self) -> None:
        """Check that a + 2 s |Delta| + 3 k3 Delta^2 is positive in both directions: s >= 0 or s^2 < 3 a k3."""
        even, odd, cubic = self.quadratic or 0.0, self.symmetric_quadratic or 0.0, self.cubic or 0.0
        a = min(self.stiffness, self.inner_stiffness) if self.backlash is not None else self.stiffness
        location = " inside the backlash" if a < self.stiffness else ""
        for s, side in ((odd + even, "positive"), (odd - even, "negative")):
            if cubic < 0 or (s < 0 and not s**2 < 3 * a * cubic):
                # The smallest deflection x at which a + 2 s x + 3 cubic x^2 reaches 0.
                root = math.sqrt(max(s**2 - 3 * a * cubic, 0.0))
                ends = [(sign * root - s) / (3 * cubic) for sign in (-1, 1)] if cubic else [a / (-2 * s)]
                worst, (unit, angle) = min(x for x in ends if x >= 0), self._units
                raise ValueError(
                    f"the stiffness becomes negative at a {side} deflection of {worst:.3g} {angle} (k = {a:g} {unit}"
                    f"{location}, quadratic {s:g} {unit}^2 on this side, cubic {cubic:g} {unit}^3). The limit is "
                    "quadratic^2 < 3 k cubic"
                )

    @property
    def _units(self) -> tuple[str, str]:
        """Units of stiffness and deflection: N/m and m if any number has such a unit; the joint is unknown here."""
        numbers = (getattr(self, row[0]) for row in (("stiffness",), *_OPTIONAL_TERMS))
        slides = any("rad" not in getattr(number, "dimension", "rad") for number in numbers)
        return ("N/m", "m") if slides else ("N*m/rad", "rad")
