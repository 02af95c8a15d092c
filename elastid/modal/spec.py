"""The `modal` section of a study: modes of a structure without a robot."""

from dataclasses import field
from typing import Annotated

from elastid.base.section import Key, section
from elastid.base.units import Frequency, Length, Time


@section
class GeometrySpec:
    """Points and lines of the structure for animated mode shapes."""

    # fmt: off
    points: Annotated[dict[str, tuple[Length, Length, Length]], Key("Coordinates of points by name.",
        "sensor locations and, for the outline, corners without a sensor.")] = field(kw_only=True)
    lines: Annotated[tuple[tuple[str, str], ...], Key("Pairs of points connected by a line.", "edges of the structure; "
        "without any, elastid connects consecutive points.")] = ()
    motion: Annotated[dict[str, tuple[str, str]], Key("Point and direction (`x`, `-z` ...) in which each output "
        "measures.", "needed unless outputs are named by point and direction, such as `tip x`.")] = field(
        default_factory=dict)
    # fmt: on

    def __post_init__(self) -> None:
        """Raise ValueError if `lines` or `motion` has an unknown point or direction."""
        for name in (*(end for line in self.lines for end in line), *(point for point, _ in self.motion.values())):
            if name not in self.points:
                raise ValueError(f"unknown point {name}. Points: {', '.join(self.points)}")
        for output, (_, direction) in self.motion.items():
            if direction.lstrip("+-") not in ("x", "y", "z"):
                raise ValueError(f"the direction of {output} is {direction}; give x, y or z, with - for the opposite")

    def direction_of(self, output: str) -> tuple[str, str] | None:
        """Return the point and direction of an output; None if neither `motion` nor its name states them."""
        if output in self.motion:
            return self.motion[output]
        point, _, direction = output.rpartition(" ")
        return (point, direction) if point in self.points and direction.lstrip("+-") in ("x", "y", "z") else None


@section
class ModalSpec:
    """Settings of the modal analysis of a structure's measured responses."""

    # fmt: off
    band_hz: Annotated[tuple[Frequency, Frequency] | None, Key("Band in which modes are searched for (default: all "
        "lines with excitation and coherence).", "narrower for high modal density, band by band; modes outside are "
        "included as residuals.", least=0, rising=True)] = None
    max_order: Annotated[int | None, Key("Highest order of the matrix polynomials in the stabilisation diagram "
        "(default: 60, fewer with few lines).", "higher for more than about 30 modes in the "
        "band.", least=2, most=200)] = None
    poles_hz: Annotated[tuple[Frequency, ...] | None, Key("Natural frequencies of the selected poles, each the nearest "
        "stable one (default: automatic selection).", "select them in the stabilisation diagram of one band if the "
        "automatic selection is wrong.", above=0, distinct=True, filled=True)] = None
    exponential: Annotated[Time | None, Key("Time constant of an exponential window in the data, whose damping elastid "
        "removes (default: no window).", "only if your analyser applied such a window; elastid needs none, since its "
        "local methods model the transient.", above=0)] = None
    geometry: Annotated[GeometrySpec | None, Key("Points and lines of the structure for animated mode shapes (default: "
        "geometry of universal files).", "give it for mode shapes on the page.")] = None
    # fmt: on
