"""Robots whose gears couple axes."""

import numpy as np

from elastid.robot import Body, GearCoupling, Joint, Motor, Placement, Robot, Spring

J = np.array([1.6e-4, 1.8e-4, 4.3e-5])
RATIO = np.array([-99.0, 79.2, 60.0])
K_SHAFT = np.array([0.9, 0.7, 1.1])
D_SHAFT = np.array([2e-3, 1e-3, 3e-3])
COUPLINGS = (("5", "4", 12.0), ("6", "4", -8.0), ("6", "5", 25.0))


LINKS = ("4", "5", "6")


def wrist(springs: str = "after", shafts: bool = True, links: bool = False, before: tuple[str, ...] = ()) -> Robot:
    """Three coupled axes. shafts: springs of the motors; links: of the joints; before: whose couplings follow these."""
    bodies, parent = [], "base"
    for i, (name, axis) in enumerate(zip(LINKS, "xyx", strict=True)):
        shaft = Spring(K_SHAFT[i], D_SHAFT[i]) if shafts else None
        link = Spring(7e3 * (i + 1), 3.0) if links else None
        joint = Joint(name, axis, link, Motor(J[i], RATIO[i], 1e-4, spring=shaft))
        bodies.append(
            Body(name, parent, Placement((0.1, 0, 0.05)), (joint,), 5.0, (0.05, 0.02, 0.03), (0.2, 0.3, 0.25))
        )
        parent = name
    gears = [GearCoupling(m, j, r, "before" if m in before else springs) for m, j, r in COUPLINGS]
    return Robot("wrist", tuple(bodies), (0.0, 0.0, 0.0), gears=tuple(gears))
