"""A named frame of a body, such as the tool: a point that is measured or pushed, and three directions."""

from __future__ import annotations

from dataclasses import field

from elastid.robot.geometry import Placement
from elastid.section import section

# The frame that a payload is fixed to, and whose Jacobian tells singular postures, unless said otherwise.
TOOL = "tool"


@section
class Frame:
    """A frame fixed to a body: its placement in the body's frame."""

    name: str
    body: str
    placement: Placement = field(default_factory=Placement)
