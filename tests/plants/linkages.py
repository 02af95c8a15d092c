"""Robots with loops."""

from elastid.robot import Anchor, Body, Joint, Loop, Motor, Placement, Robot, Rod, Spring

LOWER, LEVER = 0.89, 0.3


def linkage(
    rod: Rod | None = None,
    crank: float = LEVER,
    bends: bool = False,
    spatial: bool = False,
    loop: Loop | None = None,
    further: tuple[Body, ...] = (),
) -> Robot:
    """Lower arm and crank about one point, an upper arm on a passive elbow, a rod from the crank to its rear lever.

    bends: the lower arm bends in its middle.  spatial: on a turret, and the lower arm bends sideways too, so that the
    rod leaves its plane.  crank: its length; LEVER makes a parallelogram with the rod of length LOWER.
    """
    motor = Motor(inertia=2e-3, ratio=100, viscous=2e-3)
    bodies = []
    base = "base"
    if spatial:
        turn = Joint("1", "z", spring=Spring(1.5e6, 700), motor=motor)
        bodies.append(Body("turret", joints=(turn,), mass=100, center_of_mass=(0.02, 0.02, 0.3), inertia=8.0))
        base = "turret"
    at = Placement((0.2, -0.08, 0.46) if spatial else (0.0, 0.0, 0.0))
    bodies.append(
        Body("lower", base, at, (Joint("2", "y", Spring(8e5, 400), motor),), 16.0, (0.06, 0.09, 0.2), (0.4, 0.4, 0.1))
    )
    elastic = []
    if bends:
        elastic.append(Joint("b2", "y", Spring(2e6, 500)))
    if spatial:
        elastic += [Joint("c2", "x", Spring(1e6, 400)), Joint("t2", "z", Spring(7e5, 300))]
    middle = Placement((0.0, 0.0, 0.4))
    bodies.append(Body("end", "lower", middle, tuple(elastic), 15.0, (0.06, 0.09, 0.2), (0.4, 0.4, 0.1)))
    lever = Joint("3", "y", Spring(5e5, 250), motor)
    bodies.append(Body("crank", base, at, (lever,), 19.4, (-0.45, -0.09, 0.03), (0.22, 0.69, 0.65)))
    elbow = Placement((0.0, -0.069, LOWER - 0.4))
    bodies.append(Body("upper", "end", elbow, (Joint("elbow", "y"),), 50.0, (0.35, 0.13, 0.14), (1.0, 5.0, 5.0)))
    rod = Rod(LOWER, 6.2, 0.52, 0.64, 1e7, 4000) if rod is None else rod
    ends = (Anchor("crank", (-crank, -0.069, 0.0)), Anchor("upper", (-LEVER, 0.0, 0.0)))
    return Robot("linkage", (*bodies, *further), loops=(loop or Loop("rod", ends, rod=rod),))
