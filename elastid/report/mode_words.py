"""Springs and modes in words."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from elastid.arrays import FloatArray
from elastid.robot import Body, Joint, Robot, unit_axis

# Shares of a mode's energy that are named: so large, and at most so many.
NAMED, MOST = 0.05, 4
# Cosine of the angle between a link and the axis of its spring, above which it twists and below which it bends.
TWISTS, BENDS = 0.9, 0.5


def spring_names(robot: Robot) -> dict[str, str]:
    """What an engineer calls the spring of each stiffness k_<joint>, km_<joint> or k_<rod>."""
    names = {}
    for body in robot.bodies:
        for joint in body.joints:
            names[f"k_{joint.name}"] = f"{'gear' if joint.motor is not None else _kind(body, joint)} {joint.name}"
            names[f"km_{joint.name}"] = f"shaft of motor {joint.name}"
    for loop in robot.loops:
        names[f"k_{loop.name}"] = loop.name if "rod" in loop.name.lower() else f"rod {loop.name}"
    return names


def load_name(robot: Robot) -> str:
    """What stores energy beside the springs."""
    return "weight and compensators" if robot.compensators else "weight"


def _kind(body: Body, joint: Joint) -> str:
    """A spring amid a link, where no motor is, bends or twists it."""
    along = body.placement.rotation.T @ np.array(body.placement.xyz)
    length = float(np.linalg.norm(along))
    if joint.slides or length == 0 or any(other.motor is not None for other in body.joints):
        return "joint"
    cosine = abs(float(along @ unit_axis(joint.axis))) / length
    return "torsion" if cosine > TWISTS else "bending" if cosine < BENDS else "joint"


def shares_in_words(names: Sequence[str], shares: FloatArray) -> str:
    """The largest shares (n_e,) of a mode's energy, as in '62 % gear 2, 25 % bending b2'.

    >>> shares_in_words(["gear 1", "gear 2", "weight"], np.array([0.104, 0.956, -0.06]))
    '96 % gear 2, 10 % gear 1, -6 % weight'
    """
    order = [i for i in np.argsort(-np.abs(shares), kind="stable") if abs(shares[i]) >= NAMED][:MOST]
    return ", ".join(f"{100 * shares[i]:.0f} % {names[i]}" for i in order)
