r"""Connections between points of two bodies: loops that close the tree, and gravity compensators.

A loop joins two points directly, by a pin or by a rod.

A gravity compensator is a coil or gas spring between points of two bodies with the distance L.

.. math:: F_{coil} = k_c (L - L_0), \qquad F_{gas} = \pm F_0 \left( \frac{h_0}{h_0 \pm (L_0 - L)} \right)^{\kappa}

F: force that draws the points together.  Gas in a drawing cylinder (+) is compressed by increasing L, gas in a pushing
strut (-) by decreasing L. At the length L_0, F_0 = p_0 A and h_0 = V_0 / A is the height of the gas column, with
absolute pressure p_0, piston area A and volume V_0. kappa: 1 for isothermal, 1.4 for adiabatic compression.
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
    body: Annotated[str, Key("Name of the body.", "give a body, not a frame; the base for struts fixed to the "
        "foot.")] = BASE
    point: Annotated[Vector3, Key("Coordinates of the point in the frame of the body.", "measure to the centre of the "
        "bearing; millimetres matter for a spring whose line of action passes near the axis.")] = (0.0, 0.0, 0.0)


@section
class CoilSpring:
    """A mechanical spring."""

    # fmt: off
    stiffness: Annotated[LinearStiffness, Key("Stiffness k_c of the coil spring.", "from the data sheet or from "
        "holding torques of two postures; kc_NAME in fit.parameters estimates it from low-frequency lines.", above=0)]
    rest_length: Annotated[Length, Key("Length L_0 of the spring without force.", "0 for a spring that pulls at any "
        "length; L0_NAME is identifiable from holding torques.", least=0)] = 0.0
    # fmt: on

    def numbers(self, name: str) -> Numbers:
        """Return kc_ and L0_ of a compensator."""
        return {f"kc_{name}": ("N/m", ("stiffness",)), f"L0_{name}": ("m", ("rest_length",))}


@section
class GasSpring:
    """A gas spring."""

    # fmt: off
    force: Annotated[Force, Key("Force F_0 at the length L_0.", "proportional to the filling pressure, which decreases "
        "over the years: identify F0_NAME first.", above=0)]
    length: Annotated[Length, Key("Distance L_0 of the ends to which force and column refer.", "usually the length of "
        "the fully extended spring.", above=0)]
    column: Annotated[Length, Key("Height h_0 of the gas column at the length L_0.", "gas volume divided by piston "
        "area; a long column gives a nearly constant force.", above=0)]
    kappa: Annotated[Ratio, Key("Polytropic exponent of the gas, 1 (isothermal) to 1.4 (adiabatic).", "1 for slow "
        "motion and static postures, 1.3 to 1.4 for motion within seconds, such as a "
        "multisine.", least=1, most=2)] = 1.0
    action: Annotated[Literal["push", "draw"], Key("Direction of the force: `push` for a strut, `draw` for a pulling "
        "cylinder.", "`draw` for cylinders whose rod extends as the arm goes down.")] = "push"
    # fmt: on

    def numbers(self, name: str) -> Numbers:
        """Return F0_, L0_, h0_ and kappa_ of a compensator."""
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
    name: Annotated[PartName, Key("Name of the compensator, used in the names of its parameters.", "name it after its "
        "axis, such as `spring_2`.")]
    ends: Annotated[tuple[Anchor, Anchor], Key("Points of two bodies between which the spring acts.", "first the fixed "
        "point; the force acts along the line between the points.")]
    coil: Annotated[CoilSpring | None, Key("Coil spring; give either coil or gas (default: none with gas).",
        "for steel springs, whose force grows with length.")] = None
    gas: Annotated[GasSpring | None, Key("Gas spring; give either gas or coil (default: none with coil).",
        "for nitrogen cylinders, whose force grows with stroke and temperature.")] = None
    # fmt: on

    def __post_init__(self) -> None:
        if (self.coil is None) == (self.gas is None):
            raise ValueError(f"compensator {self.name}: give one of coil and gas")
        first, second = self.ends
        if first.body == second.body:
            raise ValueError(
                f"compensator {self.name}: both ends are on {first.body}. Attach one end to the body beyond "
                "the joint that it relieves"
            )

    @property
    def numbers(self) -> Numbers:
        """Numbers of the compensator's spring."""
        if self.coil is not None:
            return below("coil", self.coil.numbers(self.name))
        return below("gas", self.gas.numbers(self.name)) if self.gas is not None else {}

    @property
    def geometry(self) -> Numbers:
        """pc1_ and pc2_: locations of the ends on their bodies."""
        return _ends_of("pc", self.name)


@section
class Pin:
    """A hinge: the two points coincide and turn about one axis."""

    # fmt: off
    axis: Annotated[Axis, Key("Axis of the hinge in the frame of the first body.", "copy it from the drawing; it must "
        "be parallel to other_axis in the assembled posture.")] = "z"
    other_axis: Annotated[Axis | None, Key("Axis of the hinge in the frame of the second body (default: the same "
        "numbers as axis).", "if the two bodies are rotated relative to each other at zero angles.")] = None
    planar: Annotated[bool, Key("If true, the hinge constrains only the two displacements across its axis; otherwise "
        "three displacements and two tilts.", "true for a planar mechanism, in which further constraints are "
        "redundant; false for bearings that transmit tilting torque.")] = False
    # fmt: on

    def __post_init__(self) -> None:
        unit_axis(self.axis)
        if self.other_axis is not None:
            unit_axis(self.other_axis)


@section
class Rod:
    """A straight rod on two ball joints, rigid unless it has a stiffness."""

    # fmt: off
    length: Annotated[Length, Key("Distance of the two ball joints.", "measure between ball centres; an error changes "
        "the angles at which the loop closes.", above=0)]
    mass: Annotated[Mass, Key("Mass of the rod.", "give it above a few percent of the arm's mass; otherwise keep "
        "0.", least=0)] = 0.0
    center: Annotated[float, Key("Location of the centre of mass on the rod, from 0 (first end) to 1 (second end).",
        "other than 0.5 if one end carries a clevis or a spring.")] = 0.5
    inertia: Annotated[Inertia, Key("Transverse inertia about the centre of mass; rotation about the rod's own axis is "
        "neglected.", "m l^2 / 12 for a uniform rod; its effect below the rod's own modes is small.", least=0)] = 0.0
    stiffness: Annotated[LinearStiffness | None, Key("Axial stiffness of the rod (default: rigid rod).", "start with E "
        "A / l, or a third of it with bearings; it is correlated with the stiffness of the lever's "
        "gear.", above=0)] = None
    damping: Annotated[AxialDamping, Key("Axial damping of the rod.", "start with 1e-3 s times the "
        "stiffness.", least=0)] = 0.0
    # fmt: on

    def __post_init__(self) -> None:
        if self.stiffness is None and self.damping > 0:
            raise ValueError("the rod has damping but no stiffness; a rigid rod does not stretch")

    @property
    def is_elastic(self) -> bool:
        """True if the rod has an axial stiffness."""
        return self.stiffness is not None

    def numbers(self, loop: str) -> Numbers:
        """Return m_, a_ (location of the centre of mass), I_ of a loop's rod, and k_, d_ of an elastic rod."""
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
    name: Annotated[PartName, Key("Name of the loop, used in the names of its rod's parameters.", "use the drawing's "
        "name of the rod or hinge; results show it, such as k_NAME.")]
    ends: Annotated[tuple[Anchor, Anchor], Key("Points of two bodies that the loop joins; for a rod on a driven lever, "
        "the first end is on the lever.", "first the end on the driven lever; exchanging the ends moves the rod's "
        "centre of mass.")]
    pin: Annotated[Pin | None, Key("Hinge at the two points (default: the points coincide, as in a ball joint).",
        "for a hinge that transmits load across its axis; `planar` for an ideal planar mechanism.")] = None
    rod: Annotated[Rod | None, Key("Rod on ball joints between the two points (default: no rod).", "for rods on ball "
        "joints, also elastic ones; one rod replaces a body and two joints.")] = None
    # fmt: on

    def __post_init__(self) -> None:
        if self.pin is not None and self.rod is not None:
            raise ValueError(f"loop {self.name}: give pin or rod, or neither (the points coincide), not both")
        if self.ends[0].body == self.ends[1].body:
            raise ValueError(f"loop {self.name}: both ends are on {self.ends[0].body}; a loop joins two bodies")

    @property
    def numbers(self) -> Numbers:
        """Parameters of the rod; empty for a point or a pin."""
        return below("rod", self.rod.numbers(self.name)) if self.rod is not None else {}

    @property
    def geometry(self) -> Numbers:
        """Locations p1_, p2_ of the ends on their bodies, and length l_ of the rod."""
        return _ends_of("p", self.name) | ({f"l_{self.name}": ("m", ("rod", "length"))} if self.rod is not None else {})


def _ends_of(prefix: str, name: str) -> Numbers:
    """Return the coordinates of two points, `ends`: p1_name_x ... and p2_name_x ... of the prefix p."""
    return coordinates(f"{prefix}1_{name}", ("ends", 0, "point")) | coordinates(
        f"{prefix}2_{name}", ("ends", 1, "point")
    )
