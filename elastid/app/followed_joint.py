"""What a filter needs of a friction study: the joint with its identified numbers, its motions and their gravity."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from elastid.base.arrays import FloatArray
from elastid.base.errors import StudyError
from elastid.friction.robot_friction import PlacedLaw, frictions
from elastid.friction_record import FrictionRecord
from elastid.friction_study.extended_kalman_filter import FilterNoise, FollowedJoint, JointSamples
from elastid.friction_study.filter_spec import FilterSpec
from elastid.friction_study.follow import Motion
from elastid.friction_study.result import JointFriction
from elastid.robot import Robot
from elastid.robot.friction_numbers import with_laws
from elastid.simulation.held_joint import held_joint

# Deflection at which bristles slip where no loop has told it: counts of the encoder, or a part of the path.
BEND_COUNTS, BEND_PART = 20, 1e-4
# Of the path: steps of a position below are rounding.
LEAST_COUNT = 1e-7
# Torque noise of a sample where levels or motion have told none, a part of F_c.
NOISE_PART = 0.05


@dataclass(frozen=True)
class Followable:
    """A joint as a filter has it, its motions, and what is known of the noise beforehand."""

    joint: FollowedJoint
    motions: tuple[Motion, ...]
    rate_hz: float
    noise: FilterNoise


def followable(robot: Robot, found: JointFriction, records: Sequence[FrictionRecord], spec: FilterSpec) -> Followable:
    """The joint of a study; StudyError where no friction was identified from which a filter could start."""
    if found.friction is None or found.viscous is None:
        raise StudyError(f"joint {found.joint}: no friction was identified from which a filter could start")
    law = next(
        each
        for each in frictions(with_laws(robot, {found.joint: (found.friction, found.viscous)}))
        if each.place == f"motor {found.joint}"
    )
    joint = _joint(robot, found, records, spec, law, found.viscous)
    motions = tuple(_motion(record, _gravity(found), records[0].start_s) for record in records)
    angle = max(_count(record) for record in records) / np.sqrt(12)
    drift = {name: rate * (joint.coulomb if name == "offset" else 1.0) for name, rate in spec.drift_rates.items()}
    torque = spec.torque_std or NOISE_PART * joint.coulomb
    correlated = torque if spec.correlation_time > 0 else 0.0
    return Followable(joint, motions, records[0].rate_hz, FilterNoise(float(angle), torque, correlated, drift=drift))


def _joint(
    robot: Robot,
    found: JointFriction,
    records: Sequence[FrictionRecord],
    spec: FilterSpec,
    law: PlacedLaw,
    viscous: float,
) -> FollowedJoint:
    """Elastic where the robot's file has a spring, else with the inertia that was identified."""
    F_c, F_s, inverse_nu_s = law.curve()[:3].tolist()
    bent, damped = law.at_rest()
    if law.law.n_states == 0:  # no presliding was identified
        bent, damped = F_c / _bend(records), 0.0
    known = {
        "coulomb": F_c,
        "viscous": max(viscous, 1e-6 * F_c),
        "stiction_ratio": F_s / F_c,
        "stribeck_velocity": 1 / inverse_nu_s if inverse_nu_s > 0 else 0.0,
        "bristle_stiffness": bent,
        "bristle_damping": damped,
        "correlation_s": spec.correlation_time,
    }
    posture = records[0].configuration
    angles = np.zeros(len(robot.driven)) if posture is None else posture.angles
    elastic = held_joint(robot, found.joint, angles)
    if elastic is None:
        return FollowedJoint(_inertia(found), followed=spec.states, **known)
    return FollowedJoint(
        elastic.motor_inertia, link_inertia=elastic.link_inertia, stiffness=elastic.stiffness, damping=elastic.damping,
        followed=spec.states, **known,
    )  # fmt: skip


def _count(record: FrictionRecord) -> float:
    """The step of the position, or the smallest difference of two of its values; of a log without steps a tiny part."""
    if record.resolution > 0:
        return record.resolution
    gaps = np.diff(np.unique(record.position))
    least = LEAST_COUNT * float(np.ptp(record.position))
    return max(least, float(np.min(gaps, initial=np.inf, where=gaps > least)) if np.any(gaps > least) else least)


def _bend(records: Sequence[FrictionRecord]) -> float:
    """A deflection small beside the motion and larger than the encoder's counts."""
    path = max(float(np.ptp(record.position)) for record in records)
    return max([BEND_PART * path, *(BEND_COUNTS * record.resolution for record in records)])


def _inertia(found: JointFriction) -> float:
    """Of all that a rigid joint moves."""
    if found.motion is not None:
        return found.motion.chosen["inertia"]
    if found.levels is not None and "inertia" in found.levels.shared:
        return found.levels.shared["inertia"][0]
    raise StudyError(
        f"joint {found.joint} has no spring in the robot's file, and no motion from which its inertia is known: a "
        "filter needs the inertia; record a motion that accelerates, or give the joint's spring"
    )


def _gravity(found: JointFriction) -> Mapping[str, float]:
    """cos, sin and constant part of the torque that gravity and offsets take, as the study has identified them."""
    if found.motion is not None:
        chosen = found.motion.chosen
        numbers = dict(zip(chosen.names, chosen.values.tolist(), strict=True))
    else:
        numbers = {name: value for name, (value, _) in (found.levels.shared if found.levels else {}).items()}
    return {part: numbers.get(name, 0.0) for part, name in _PARTS.items()}


_PARTS = {"cos": "gravity.cos", "sin": "gravity.sin", "constant": "offset"}


def _motion(record: FrictionRecord, gravity: Mapping[str, float], first_s: float) -> Motion:
    """A record as a filter reads it: torque held from one sample to the next, at whose end the angle is."""
    q: FloatArray = record.position
    load = gravity["cos"] * np.cos(q) + gravity["sin"] * np.sin(q) + gravity["constant"]
    return Motion(JointSamples(record.torque[:-1], load[:-1], q[1:]), record.start_s - first_s)
