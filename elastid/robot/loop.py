"""A loop of bodies: two points of the tree that are joined, directly, by a pin or by a rod."""

from __future__ import annotations

from typing import Annotated

from elastid.base.names import PartName
from elastid.base.section import Key, section
from elastid.base.units import AxialDamping, Inertia, Length, LinearStiffness, Mass
from elastid.robot.gravity_compensator import Anchor
from elastid.robot.placement import Axis, Numbers, below, ends_of, unit_axis


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
        return ends_of("p", self.name) | length
