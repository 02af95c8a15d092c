r"""A gravity compensator: a spring of steel or gas between points of two bodies, at the distance L of each other.

.. math:: F_{coil} = k_c (L - L_0), \qquad F_{gas} = \pm F_0 \left( \frac{h_0}{h_0 \pm (L_0 - L)} \right)^{\kappa}

F: the force that draws the two points together.  Gas in a cylinder that draws (+) is compressed as L grows, gas in a
strut that pushes (-) as L shrinks. F_0 = p_0 A and h_0 = V_0 / A, the height of the gas column, at the length L_0, with
the absolute pressure p_0, the piston's area A and the volume V_0. kappa: 1 while the gas keeps its temperature, 1.4 in
motion too fast for heat to flow.
"""

from __future__ import annotations

from typing import Annotated, Literal

from elastid.base.names import PartName
from elastid.base.section import Key, section
from elastid.base.units import Force, Length, LinearStiffness, Ratio
from elastid.robot.body import BASE
from elastid.robot.placement import Numbers, Vector3, below, ends_of


@section
class Anchor:
    """A point of a body."""

    # fmt: off
    body: Annotated[str, Key("Name of the body.", "a body, not a frame; the base for struts that stand on the "
        "foot.")] = BASE
    point: Annotated[Vector3, Key("Coordinates of the point in the body's axes.", "at the centre of the bearing; "
        "millimetres matter where a spring acts nearly through the axis.")] = (0.0, 0.0, 0.0)


@section
class CoilSpring:
    """A mechanical spring."""

    # fmt: off
    stiffness: Annotated[LinearStiffness, Key("Stiffness k_c of the coil.", "by the maker, or from holding torques of "
        "two postures; it adds stiffness to the joint, and kc_NAME in fit.parameters finds it from the low "
        "lines.", above=0)]
    rest_length: Annotated[Length, Key("Length L_0 at which the coil has no force.", "0 for a spring that pulls "
        "wherever it is; it decides in which posture how much weight is carried. L0_NAME may be identified from "
        "holding torques.", least=0)] = 0.0
    # fmt: on

    def numbers(self, name: str) -> Numbers:
        """kc_ and L0_ of a compensator."""
        return {f"kc_{name}": ("N/m", ("stiffness",)), f"L0_{name}": ("m", ("rest_length",))}


@section
class GasSpring:
    """A gas spring."""

    # fmt: off
    force: Annotated[Force, Key("Force F_0 at the length L_0.", "scales with filling pressure, which falls over the "
        "years: F0_NAME is the first of its numbers to identify.", above=0)]
    length: Annotated[Length, Key("Length L_0 between the ends at which force and column hold.", "that at which force "
        "and column were read, usually fully extended.", above=0)]
    column: Annotated[Length, Key("Height h_0 of the gas column at that length.", "volume over piston area; a long one "
        "gives a nearly constant force.", above=0)]
    kappa: Annotated[Ratio, Key("Exponent of the gas, 1 isothermal to 1.4 adiabatic.", "1 for slow motion and "
        "postures, 1.3 to 1.4 for motion within seconds, as in a multisine's swing.", least=1, most=2)] = 1.0
    action: Annotated[Literal["push", "draw"], Key("Direction of the force: `push` for a strut, `draw` for a cylinder "
        "that pulls.", "draw for cylinders whose rod is pulled out as the arm goes down.")] = "push"
    # fmt: on

    def numbers(self, name: str) -> Numbers:
        """F0_, L0_, h0_ and kappa_ of a compensator."""
        return {
            f"F0_{name}": ("N", ("force",)),
            f"L0_{name}": ("m", ("length",)),
            f"h0_{name}": ("m", ("column",)),
            f"kappa_{name}": ("1", ("kappa",)),
        }


@section
class Compensator:
    """A coil or a gas spring, one of the two, between points of two bodies."""

    # fmt: off
    name: Annotated[PartName, Key("Name of the compensator, which ends the names of its parameters.", "such as "
        "`spring_2`, the axis that it holds.")]
    ends: Annotated[tuple[Anchor, Anchor], Key("Two points of two bodies between which the spring acts.", "first the "
        "fixed one; the force acts along the line between them.")]
    coil: Annotated[CoilSpring | None, Key("Coil spring, a mechanical one.", "for steel springs, whose force grows "
        "with length.")] = None
    gas: Annotated[GasSpring | None, Key("Gas spring.", "for nitrogen cylinders; their force rises with stroke and "
        "temperature.")] = None
    # fmt: on

    def __post_init__(self) -> None:
        if (self.coil is None) == (self.gas is None):
            raise ValueError(f"compensator {self.name}: give one of coil and gas")
        first, second = self.ends
        if first.body == second.body:
            raise ValueError(
                f"compensator {self.name}: both ends are on {first.body}, so that it never moves; fix one to the body "
                "beyond the joint that it relieves"
            )

    @property
    def numbers(self) -> Numbers:
        """Numbers of the compensator's spring."""
        if self.coil is not None:
            return below("coil", self.coil.numbers(self.name))
        return below("gas", self.gas.numbers(self.name)) if self.gas is not None else {}

    @property
    def geometry(self) -> Numbers:
        """pc1_ and pc2_: where its ends are on their bodies."""
        return ends_of("pc", self.name)
