"""A loop of bodies: two points of the tree that are joined, directly, by a pin or by a rod."""

from __future__ import annotations

from elastid.base.names import PartName
from elastid.base.section import section
from elastid.base.units import AxialDamping, Inertia, Length, LinearStiffness, Mass
from elastid.robot.gravity_compensator import Anchor
from elastid.robot.named_numbers import Numbers, below, coordinates
from elastid.robot.placement import Axis, unit_axis


@section
class Pin:
    """A hinge: the two points coincide and turn about one axis.

    axis: in the axes of the first end's body. -- as in the drawing of the first body; must fit other_axis in the
    assembled posture.
    other_axis: the same hinge in those of the second one's (default: the same numbers). -- where the axes of the two
    bodies are turned against each other at zero.
    planar: only the two displacements across the axis are closed, for mechanisms that are planar; else all three, and
    the two tilts of the axis. -- true for a planar mechanism, whose further constraints would be redundant; false for
    real bearings that also take tilt.
    """

    axis: Axis = "z"
    other_axis: Axis | None = None
    planar: bool = False

    def __post_init__(self) -> None:
        """Check the axes."""
        unit_axis(self.axis)
        if self.other_axis is not None:
            unit_axis(self.other_axis)


@section
class Rod:
    """A straight rod on two ball joints, rigid unless it has a stiffness.

    length: between the two joints. -- between ball centres; an error closes the loop at another angle and shifts the
    whole posture.
    mass: of the rod. -- for rods of more than a few percent of the arm; 0 for one that only couples.
    center: place of the centre of mass between first end (0) and second (1). -- away from 0.5 where one end carries a
    clevis or a spring.
    inertia: about the centre of mass, across the rod; its spin about itself is left out. -- m l^2 / 12 for an even rod,
    which has little effect below its own modes.
    stiffness: along the rod, which stretches evenly. -- E A / l to start with; bearings make it a third or less, and it
    trades with the stiffness of its lever's gear.
    damping: along the rod, which stretches evenly. -- start with 1e-3 s times the stiffness, as for a spring.
    """

    length: Length
    mass: Mass = 0.0
    center: float = 0.5
    inertia: Inertia = 0.0
    stiffness: LinearStiffness | None = None
    damping: AxialDamping = 0.0

    def __post_init__(self) -> None:
        """Refuse numbers that no rod can have."""
        if not self.length > 0:
            raise ValueError(f"the length of the rod is {self.length:g} m; it must be positive")
        for name, value in (("mass", self.mass), ("inertia", self.inertia), ("damping", self.damping)):
            if value < 0:
                raise ValueError(f"{name} of the rod is {value:g}; it must not be negative")
        if self.stiffness is not None and not self.stiffness > 0:
            raise ValueError(f"stiffness of the rod is {self.stiffness:g} N/m; it must be positive (none: rigid)")
        if self.stiffness is None and self.damping > 0:
            raise ValueError("the rod has damping but no stiffness; a rigid rod does not stretch")

    @property
    def is_elastic(self) -> bool:
        """Whether it stretches."""
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
    """Two ends that are joined: by a `rod`, by a `pin`, or, where neither is given, as one point.

    name: ends the names of its rod's parameters. -- that of the rod or hinge in the drawing, since k_NAME of a rod
    appears in results.
    ends: two points of two bodies; a rod begins at the first end, and where it is moved by a driven lever, that is the
    lever's end. -- the first on the lever that is driven; exchanging the ends moves the rod's centre of mass.
    pin: a hinge. -- for a hinge that carries load across its axis; `planar` where the mechanism is ideal.
    rod: a rod on ball joints. -- for rods with ball joints, or whose stretching matters; one element in place of a body
    and two joints.
    """

    name: PartName
    ends: tuple[Anchor, Anchor]
    pin: Pin | None = None
    rod: Rod | None = None

    def __post_init__(self) -> None:
        """One way of closing, between two bodies."""
        if self.pin is not None and self.rod is not None:
            raise ValueError(f"loop {self.name}: give pin or rod, or neither (the points coincide), not both")
        if self.ends[0].body == self.ends[1].body:
            raise ValueError(f"loop {self.name}: both ends are on {self.ends[0].body}; a loop joins two bodies")

    @property
    def numbers(self) -> Numbers:
        """Those of the rod; a point and a pin have none."""
        return below("rod", self.rod.numbers(self.name)) if self.rod is not None else {}

    @property
    def geometry(self) -> Numbers:
        """p1_ and p2_: where its ends are on their bodies; l_: the length of its rod."""
        first, second = (coordinates(f"p{i + 1}_{self.name}", ("ends", i, "point")) for i in (0, 1))
        length: Numbers = {f"l_{self.name}": ("m", ("rod", "length"))} if self.rod is not None else {}
        return first | second | length
