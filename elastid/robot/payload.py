"""What the robot carries: a body fixed to a frame or to another body."""

from __future__ import annotations

from elastid.robot.body import Body, InertiaTensor
from elastid.robot.frame import TOOL
from elastid.robot.geometry import Placement, Vector3
from elastid.robot.numbers import Numbers
from elastid.section import section
from elastid.units import Mass

PAYLOAD = "payload"


@section
class Payload:
    """A body called `payload`, fixed to the frame or body `at`; centre of mass and inertia as a body's, in its axes."""

    mass: Mass
    center_of_mass: Vector3 = (0.0, 0.0, 0.0)
    inertia: InertiaTensor = 0.0
    at: str = TOOL

    def __post_init__(self) -> None:
        """A payload is what a body is."""
        self.body("", Placement())

    def body(self, parent: str, placement: Placement) -> Body:
        """The payload as a body, where it is carried."""
        return Body(PAYLOAD, parent, placement, (), self.mass, self.center_of_mass, self.inertia)

    @property
    def numbers(self) -> Numbers:
        """m_payload, c_payload_x ..., I_payload."""
        return self.body("", Placement()).numbers
