"""follow: records and law of a friction study -> filter.h5, friction followed by a Kalman filter over the motions."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from elastid.app.console import Console
from elastid.app.work import Artefacts, Work
from elastid.base.arrays import FloatArray
from elastid.base.display import number
from elastid.base.errors import StudyError
from elastid.base.note import Note
from elastid.friction.robot_friction import PlacedLaw, frictions
from elastid.friction_study.extended_kalman_filter import FilterNoise, FollowedJoint, JointSamples
from elastid.friction_study.follow import FollowedFriction, Motion, follow
from elastid.friction_study.result import JointFriction
from elastid.friction_study.spec import FilterSpec
from elastid.record import FrictionRecord, FrictionRecords
from elastid.robot import Robot
from elastid.robot.friction_numbers import with_laws
from elastid.simulation.elastic_joint import held_joint
from elastid.store.friction_study import read_friction_records, read_friction_result, write_filter

_PARTS = {"cos": "gravity.cos", "sin": "gravity.sin", "constant": "offset"}


def follow_friction(
    *, robot: Robot, filter: FilterSpec, measure_file: Path, friction_file: Path, work: Work
) -> Artefacts:
    """filter.h5: of each joint the followed numbers over time with their bands, and the consistency of the filter."""
    measured, result = read_friction_records(measure_file), read_friction_result(friction_file)
    followed, notes = [], []
    for joint in result.joints:
        try:
            followed.append(_followed(robot, joint, _records_of(measured, joint.joint), filter))
        except StudyError as error:
            notes.append(Note("not-followed", str(error)))
    if not followed:
        raise StudyError("; ".join(note.text for note in notes))

    def report(console: Console) -> None:
        console.notes([*notes, *(note for each in followed for note in each.notes)])
        for each in followed:
            console.say(f"follow: joint {each.joint}: {_words(each)}")

    return Artefacts({"filter.h5": lambda path, stamp: write_filter(path, tuple(followed), stamp)}, report)


def _records_of(measured: FrictionRecords, joint: str) -> tuple[FrictionRecord, ...]:
    """The motions of a joint that moved alone, in the order of time."""
    together = [record.name for record in measured.records]
    own = [record for record in measured.records if record.joint == joint and together.count(record.name) == 1]
    chosen = [record for record in own if record.purpose in ("passes", "motion")]
    return tuple(sorted(chosen, key=lambda record: record.start_s))


def _followed(
    robot: Robot, identified: JointFriction, records: Sequence[FrictionRecord], spec: FilterSpec
) -> FollowedFriction:
    """The friction of a joint over its motions; StudyError where no filter can start or nothing can be followed."""
    name = identified.joint
    if not records:
        raise StudyError(
            f"joint {name} has no motion in which it moves alone, with the torque of gravity known; record one"
        )
    if identified.friction is None or identified.viscous is None:
        raise StudyError(f"joint {name}: no friction was identified from which a filter could start")
    laws = frictions(with_laws(robot, {name: (identified.friction, identified.viscous)}))
    law = next(each for each in laws if each.place == f"motor {name}")
    joint = _joint(robot, identified, records, spec, law, identified.viscous)
    motions = tuple(_motion(record, _gravity(identified), records[0].start_s) for record in records)
    angle = max(_count(record) for record in records) / np.sqrt(12)
    drift = {name: rate * (joint.coulomb if name == "offset" else 1.0) for name, rate in spec.drift_rates.items()}
    torque = spec.torque_std or 0.05 * joint.coulomb  # where it was not identified
    noise = FilterNoise(float(angle), torque, torque if spec.correlation_time > 0 else 0.0, drift=drift)
    return follow(
        name, identified.slides, joint, motions, records[0].rate_hz, noise, spec.settle,
        find_noise=spec.torque_std is None,
    )  # fmt: skip


def _words(followed: FollowedFriction) -> str:
    """The followed numbers at the end, and the NIS."""
    ends = [
        f"{name} {number(followed.values[-1, i])} ({number(followed.low[-1, i])} to {number(followed.high[-1, i])})"
        for i, name in enumerate(followed.names)
    ]
    return f"at the end {', '.join(ends)}; mean NIS {number(followed.consistency.nis, 3)}"


def _joint(
    robot: Robot,
    identified: JointFriction,
    records: Sequence[FrictionRecord],
    spec: FilterSpec,
    law: PlacedLaw,
    viscous: float,
) -> FollowedJoint:
    """Elastic where the robot's file has a spring, else with the inertia that was identified."""
    F_c, F_s, inverse_nu_s = law.curve()[:3].tolist()
    bristle_stiffness, bristle_damping = law.at_rest()
    if law.law.n_states == 0:  # no presliding was identified
        bristle_stiffness, bristle_damping = F_c / _slip_deflection(records), 0.0
    known = {
        "coulomb": F_c,
        "viscous": max(viscous, 1e-6 * F_c),
        "stiction_ratio": F_s / F_c,
        "stribeck_velocity": 1 / inverse_nu_s if inverse_nu_s > 0 else 0.0,
        "bristle_stiffness": bristle_stiffness,
        "bristle_damping": bristle_damping,
        "correlation_s": spec.correlation_time,
    }
    posture = records[0].configuration
    angles = np.zeros(len(robot.driven)) if posture is None else posture.angles
    elastic = held_joint(robot, identified.joint, angles)
    if elastic is None:
        return FollowedJoint(_inertia(identified), followed=spec.states, **known)
    return FollowedJoint(
        elastic.motor_inertia, link_inertia=elastic.link_inertia, stiffness=elastic.stiffness, damping=elastic.damping,
        followed=spec.states, **known,
    )  # fmt: skip


def _count(record: FrictionRecord) -> float:
    """The step of the position, or the smallest difference of two of its values; below 1e-7 of the path is rounding."""
    if record.resolution > 0:
        return record.resolution
    gaps = np.diff(np.unique(record.position))
    min_gap = 1e-7 * float(np.ptp(record.position))
    larger = gaps[gaps > min_gap]
    return float(np.min(larger)) if larger.size else min_gap


def _slip_deflection(records: Sequence[FrictionRecord]) -> float:
    """Deflection at which bristles slip where no loop has identified it: 1e-4 of the path, or 20 encoder counts."""
    path = max(float(np.ptp(record.position)) for record in records)
    return max([1e-4 * path, *(20 * record.resolution for record in records)])


def _inertia(identified: JointFriction) -> float:
    if identified.motion is not None:
        return identified.motion.chosen["inertia"]
    if identified.levels is not None and "inertia" in identified.levels.shared:
        return identified.levels.shared["inertia"][0]
    raise StudyError(
        f"joint {identified.joint} has no spring in the robot's file, and no motion from which its inertia is known: a "
        "filter needs the inertia; record a motion that accelerates, or give the joint's spring"
    )


def _gravity(identified: JointFriction) -> Mapping[str, float]:
    """cos, sin and constant part of the torque that gravity and offsets take, as the study has identified them."""
    if identified.motion is not None:
        chosen = identified.motion.chosen
        numbers = dict(zip(chosen.names, chosen.values.tolist(), strict=True))
    else:
        numbers = {name: value for name, (value, _) in (identified.levels.shared if identified.levels else {}).items()}
    return {part: numbers.get(name, 0.0) for part, name in _PARTS.items()}


def _motion(record: FrictionRecord, gravity: Mapping[str, float], first_s: float) -> Motion:
    """A record as a filter reads it: torque held from one sample to the next, at whose end the angle is."""
    q: FloatArray = record.position
    load = gravity["cos"] * np.cos(q) + gravity["sin"] * np.sin(q) + gravity["constant"]
    return Motion(JointSamples(record.torque[:-1], load[:-1], q[1:]), record.start_s - first_s)
