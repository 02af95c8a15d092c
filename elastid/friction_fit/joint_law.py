"""The law of a joint as a whole, as a robot's file has it: sliding from passes or a motion, bristles before it."""

from __future__ import annotations

from dataclasses import replace

from elastid.friction_fit.at_rest import AtRest
from elastid.friction_fit.before_sliding import BeforeSliding
from elastid.friction_fit.motion import MotionFriction
from elastid.friction_fit.shooting import LuGreFit
from elastid.friction_fit.spec import LawSpec
from elastid.friction_fit.static_law import StaticLaw
from elastid.robot import Directions, Friction, LuGre, MeasuredRange
from elastid.robot.friction import MAX_DAMPING_VELOCITY_RATIO

# Of the largest damping velocity with which a LuGre law is passive.
PASSIVE_SHARE = 0.9


def joint_law(
    static: StaticLaw | None, motion: MotionFriction | None, before: BeforeSliding, spec: LawSpec
) -> tuple[Friction, float] | None:
    """Friction and the viscous friction beside it, link side; None where neither passes nor a motion tell it."""
    if static is not None:
        friction, viscous = static.to_friction(), static.viscous
    elif motion is not None and motion.chosen["coulomb"] > 0:
        friction, viscous = _of_motion(motion)
    else:
        return None
    if before.presliding is not None:
        return replace(friction, maxwell_slip=before.presliding.few.to_maxwell_slip()), viscous
    if spec.presliding in ("auto", "lugre"):
        return replace(friction, lugre=_bristles(before.bristles, before.at_rest, friction.coulomb)), viscous
    return friction, viscous


def _of_motion(motion: MotionFriction) -> tuple[Friction, float]:
    """Coulomb and viscous friction of a motion, in the range of its plateaus."""
    fit, viscous = motion.chosen, max(0.0, motion.chosen["viscous"])
    apart = {name: fit[f"directions.{name}"] for name in ("coulomb", "viscous") if f"directions.{name}" in fit.names}
    speeds = [abs(plateau.velocity) for plateau in motion.plateaus]
    measured = MeasuredRange((min(speeds), max(speeds))) if speeds else None
    return Friction(fit["coulomb"], directions=Directions(**apart) if apart else None, measured=measured), viscous


def _bristles(shot: LuGreFit | None, rest: AtRest | None, coulomb: float) -> LuGre | None:
    """sigma_0 and sigma_1, the damping falling with velocity so that the law supplies no energy."""
    if shot is not None:
        stiffness, damping = shot.values["sigma_0"], shot.values["sigma_1"]
    elif rest is not None and rest.sigma_0 > 0:
        stiffness, damping = rest.sigma_0, max(0.0, rest.sigma_1)
    else:
        return None
    falling = PASSIVE_SHARE * MAX_DAMPING_VELOCITY_RATIO * coulomb / damping if damping > 0 else None
    return LuGre(stiffness, damping, falling)
