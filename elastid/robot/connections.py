r"""Connections of two bodies between points of them: loops that close the tree, and gravity compensators.

A loop joins two points directly, by a pin or by a rod.

A gravity compensator: a spring of steel or gas between points of two bodies, at the distance L of each other.

.. math:: F_{coil} = k_c (L - L_0), \qquad F_{gas} = \pm F_0 \left( \frac{h_0}{h_0 \pm (L_0 - L)} \right)^{\kappa}

F: the force that draws the two points together.  Gas in a cylinder that draws (+) is compressed as L grows, gas in a
strut that pushes (-) as L shrinks. F_0 = p_0 A and h_0 = V_0 / A, the height of the gas column, at the length L_0, with
the absolute pressure p_0, the piston's area A and the volume V_0. kappa: 1 while the gas keeps its temperature, 1.4 in
motion too fast for heat to flow.
"""

from typing import Annotated, Literal

from elastid.base.names import PartName
from elastid.base.section import Key, section
from elastid.base.units import AxialDamping, Force, Inertia, Length, LinearStiffness, Mass, Ratio
from elastid.robot.body import BASE
from elastid.robot.placement import Axis, Numbers, Vector3, below, coordinates, unit_axis


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
        return _ends_of("pc", self.name)


@section
class Pin:
    """A hinge: the two points coincide and turn about one axis."""

    # fmt: off
    axis: Annotated[Axis, Key("Axis of the hinge in the axes of the first end's body.", "as in the drawing of the "
        "first body; must fit other_axis in the assembled posture.")] = "z"
    other_axis: Annotated[Axis | None, Key("Axis of the same hinge in the axes of the second end's body (default: the "
        "same numbers).", "where the axes of the two bodies are turned against each other at zero.")] = None
    planar: Annotated[bool, Key("Only the two displacements across the axis are closed if true, for mechanisms that "
        "are planar; else all three, and the two tilts of the axis.", "true for a planar mechanism, whose further "
        "constraints would be redundant; false for real bearings that also take tilt.")] = False
    # fmt: on

    def __post_init__(self) -> None:
        unit_axis(self.axis)
        if self.other_axis is not None:
            unit_axis(self.other_axis)


@section
class Rod:
    """A straight rod on two ball joints, rigid unless it has a stiffness."""

    # fmt: off
    length: Annotated[Length, Key("Length between the two ball joints.", "between ball centres; an error closes the "
        "loop at another angle and shifts the whole posture.", above=0)]
    mass: Annotated[Mass, Key("Mass of the rod.", "for rods of more than a few percent of the arm; 0 for one that only "
        "couples.", least=0)] = 0.0
    center: Annotated[float, Key("Place of the centre of mass between first end (0) and second (1).", "away from 0.5 "
        "where one end carries a clevis or a spring.")] = 0.5
    inertia: Annotated[Inertia, Key("Inertia about the centre of mass, across the rod; its spin about itself is left "
        "out.", "m l^2 / 12 for an even rod, which has little effect below its own modes.", least=0)] = 0.0
    stiffness: Annotated[LinearStiffness | None, Key("Stiffness along the rod, which stretches evenly.", "E A / l to "
        "start with; bearings make it a third or less, and it trades with the stiffness of its lever's "
        "gear.", above=0)] = None
    damping: Annotated[AxialDamping, Key("Damping along the rod, which stretches evenly.", "start with 1e-3 s times "
        "the stiffness, as for a spring.", least=0)] = 0.0
    # fmt: on

    def __post_init__(self) -> None:
        if self.stiffness is None and self.damping > 0:
            raise ValueError("the rod has damping but no stiffness; a rigid rod does not stretch")

    @property
    def is_elastic(self) -> bool:
        """True if it stretches."""
        return self.stiffness is not None

    def numbers(self, loop: str) -> Numbers:
        """m_, a_ (place of the centre of mass), I_ of a loop's rod, and k_, d_ of an elastic one."""
        places: Numbers = {
            f"m_{loop}": ("kg", ("mass",)),
            f"a_{loop}": ("1", ("center",)),
            f"I_{loop}": ("kg*m^2", ("inertia",)),
        }
        if self.is_elastic:
            places |= {f"k_{loop}": ("N/m", ("stiffness",)), f"d_{loop}": ("N*s/m", ("damping",))}
        return places


@section
class Loop:
    """Two ends that are joined: by a `rod`, by a `pin`, or, where neither is given, as one point."""

    # fmt: off
    name: Annotated[PartName, Key("Name of the loop, which ends the names of its rod's parameters.", "that of the rod "
        "or hinge in the drawing, since k_NAME of a rod appears in results.")]
    ends: Annotated[tuple[Anchor, Anchor], Key("Two points of two bodies that the loop joins; a rod begins at the "
        "first end, and where it is moved by a driven lever, that is the lever's end.", "the first on the lever that "
        "is driven; exchanging the ends moves the rod's centre of mass.")]
    pin: Annotated[Pin | None, Key("Hinge that joins the ends.", "for a hinge that carries load across its axis; "
        "`planar` where the mechanism is ideal.")] = None
    rod: Annotated[Rod | None, Key("Rod on ball joints that joins the ends.", "for rods with ball joints, or whose "
        "stretching matters; one element in place of a body and two joints.")] = None
    # fmt: on

    def __post_init__(self) -> None:
        if self.pin is not None and self.rod is not None:
            raise ValueError(f"loop {self.name}: give pin or rod, or neither (the points coincide), not both")
        if self.ends[0].body == self.ends[1].body:
            raise ValueError(f"loop {self.name}: both ends are on {self.ends[0].body}; a loop joins two bodies")

    @property
    def numbers(self) -> Numbers:
        """Numbers of the rod; a point and a pin have none."""
        return below("rod", self.rod.numbers(self.name)) if self.rod is not None else {}

    @property
    def geometry(self) -> Numbers:
        """p1_ and p2_: where its ends are on their bodies; l_: the length of its rod."""
        length: Numbers = {f"l_{self.name}": ("m", ("rod", "length"))} if self.rod is not None else {}
        return _ends_of("p", self.name) | length


def _ends_of(prefix: str, name: str) -> Numbers:
    """The coordinates of two points, `ends`: p1_name_x ... and p2_name_x ... of the prefix p."""
    return coordinates(f"{prefix}1_{name}", ("ends", 0, "point")) | coordinates(
        f"{prefix}2_{name}", ("ends", 1, "point")
    )
