"""Friction tracking of joints over their motions: initial state, measurements and noise of the filter.

A joint is elastic where the robot's file has a spring, else rigid with the inertia that was identified.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from elastid.base.arrays import BoolArray, FloatArray, frozen_value, smallest_step
from elastid.base.errors import DataError, Note, StudyError
from elastid.base.execution import Progress, no_progress
from elastid.base.statistics import QUANTILE_95
from elastid.friction.robot_friction import PlacedLaw, frictions
from elastid.friction_record import FrictionRecord
from elastid.friction_study.extended_kalman_filter import (
    FilterNoise,
    JointSamples,
    KalmanFilter,
    TrackedJoint,
    estimate_noise,
)
from elastid.friction_study.filter_consistency import LAGS, Consistency, consistency, filter_notes, is_not_observable
from elastid.friction_study.result import JointFriction, joint_spring
from elastid.friction_study.spec import FilterSpec
from elastid.robot import Robot
from elastid.robot.friction_numbers import with_laws


@frozen_value
class TrackedFriction:
    """Filter estimates of a joint over time_s (m,): values of the tracked parameters, 95 % bands low, high (m, p).

    unknown (m, p): True if the motion does not identify a parameter, which then stays constant.  nis (m,): mean
    normalised innovation squared since the previous time.  noise.torque: estimated or given.
    """

    joint: str
    slides: bool
    names: tuple[str, ...]
    time_s: FloatArray
    values: FloatArray
    low: FloatArray
    high: FloatArray
    unknown: BoolArray
    nis: FloatArray
    consistency: Consistency
    noise: FilterNoise
    filtered: TrackedJoint
    rate_hz: float
    notes: tuple[Note, ...] = ()

    @property
    def verdict(self) -> str:
        """Verdict on the reliability of the confidence intervals."""
        if self.consistency.divergence:
            return f"diverged {self.consistency.divergence}"
        if self.consistency.doubts:
            return "intervals too narrow (see warnings)"
        return "innovations consistent with the intervals"


def track_friction(
    name: str, slides: bool, joints: Sequence[TrackedJoint], motions: Sequence[JointSamples], rate_hz: float,
    guess: FilterNoise, settle_s: float, find_noise: bool,
) -> TrackedFriction:  # fmt: skip
    """Track the friction of a joint along its motions; DataError for motions shorter than settle_s.

    find_noise: estimate the noise from innovations of the longest motion, instead of `guess`.  joints: models with
    different bristles; innovations select one of them.
    """
    duration_s = sum(len(motion.angle) for motion in motions) / rate_hz
    if duration_s <= settle_s + LAGS / rate_hz:
        raise DataError(
            "filter/record",
            f"the motions last {duration_s:.3g} s, less than the filter's settling time ({settle_s:g} s). Record "
            "longer motions, or lower filter.settle",
            f"joint {name}",
        )
    # At most half a minute of the longest motion shows the noise.
    longest, first_30_s = max(motions, key=lambda motion: len(motion.angle)), slice(0, round(30.0 * rate_hz))
    stretch = JointSamples(longest.torque[first_30_s], longest.load[first_30_s], longest.angle[first_30_s])
    # Some sixty runs find it.
    filters = [KalmanFilter(joint, rate_hz, 60 * len(stretch.angle) * find_noise) for joint in joints]
    kalman, noise = filters[0], guess
    if find_noise:
        estimates = [(model, *estimate_noise(model, stretch, guess, min(settle_s, 1.0))) for model in filters]
        kalman, noise, _ = min(estimates, key=lambda estimate: estimate[-1])
    joint, track = kalman.joint, kalman.run(motions, noise)
    assessment = consistency(track, settle_s)
    step = max(1, (n := len(track.innovation)) // 2000)  # a result keeps so many points
    ends = np.arange(n % step + step - 1, n, step)
    mean_nis = track.nis[n % step :].reshape(-1, step).mean(axis=1)
    values, low, high = (
        np.stack([track.values(name, stds)[ends] for name in joint.followed], axis=1)
        for stds in (0.0, -QUANTILE_95, QUANTILE_95)
    )
    return TrackedFriction(
        name, slides, joint.followed, track.time_s[ends], values, low, high, is_not_observable(track)[ends], mean_nis,
        assessment, noise, joint, rate_hz, tuple(filter_notes(f"joint {name}", track, assessment))
    )  # fmt: skip


def with_tolerances(joint: TrackedJoint, identified: JointFriction) -> TrackedJoint:
    """Return a joint whose fixed numbers have the std that a study identified, else a typical one (TOLERANCES)."""
    tolerances, uncertainties = dict(joint.tolerances), identified.shared
    if "inertia" in uncertainties and not joint.stiffness > 0:  # of an elastic one those of the robot's file are taken
        tolerances["inertia"] = uncertainties["inertia"][1] / uncertainties["inertia"][0]
    if gravity := [uncertainties[name] for name in ("gravity.cos", "gravity.sin") if name in uncertainties]:
        size, std = np.linalg.norm(gravity, axis=0).tolist()
        tolerances["gravity"] = std / max(size, 1e-300)
    return replace(joint, tolerances={name: float(np.clip(std, 1e-4, 0.5)) for name, std in tolerances.items()})


def track_joints(
    robot: Robot, joints: Sequence[JointFriction], records: Sequence[FrictionRecord], spec: FilterSpec,
    progress: Progress = no_progress,
) -> tuple[tuple[TrackedFriction, ...], tuple[Note, ...]]:  # fmt: skip
    """Return the friction of joints over the records in which each moves alone; notes on those that cannot be followed.

    StudyError where none can.
    """
    tracked, notes, names = [], list[Note](), [record.name for record in records]
    motions = [record for record in records if record.purpose in ("constant_velocity", "motion")]
    alone = [record for record in motions if names.count(record.name) == 1]
    for n_done, joint in enumerate(joints):
        progress(n_done, len(joints))
        joint_records = sorted((r for r in alone if r.joint == joint.joint), key=lambda record: record.start_s)
        try:
            tracked.append(_track_joint(robot, joint, joint_records, spec))
        except StudyError as error:
            notes.append(Note("filter/record", str(error)))
    if not tracked:
        raise StudyError("filter/start", "; ".join(note.text for note in notes))
    return tuple(tracked), tuple(notes)


def _track_joint(
    robot: Robot, identified: JointFriction, records: Sequence[FrictionRecord], spec: FilterSpec
) -> TrackedFriction:
    """Return the friction of a joint over its motions; StudyError if no filter can start or nothing is identifiable."""
    name = identified.joint
    if not records:
        raise StudyError(
            "filter/start",
            f"joint {name} has no motion in which it moves alone, with the torque of gravity known; record one",
        )
    if identified.friction is None or identified.viscous is None:
        raise StudyError("filter/start", "no friction was identified from which a filter could start", f"joint {name}")
    laws = frictions(with_laws(robot, {name: (identified.friction, identified.viscous)}))
    law = next(law for law in laws if law.place == f"motor {name}")
    joints = _joints(robot, identified, records, spec, law, identified.viscous)
    terms = ("gravity.cos", "gravity.sin", "offset")
    cos, sin, constant = (identified.shared.get(term, (0.0, 0.0))[0] for term in terms)
    motions = tuple(
        # A filter reads a torque that is held from one sample to the next, at whose end the angle is.
        JointSamples(u[:-1], cos * np.cos(q[:-1]) + sin * np.sin(q[:-1]) + constant, q[1:], r.start_s - first_s)
        for r, (u, q), first_s in ((record, _acting(record), records[0].start_s) for record in records)
    )
    angle = max(record.resolution or smallest_step(record.position) for record in records) / np.sqrt(12)
    # The drift within 20 minutes is that of a random walk, of the offset in parts of F_c.
    rate = spec.drift / 1200.0**0.5
    coulomb = joints[0].coulomb
    drift: dict[str, float] = {name: rate * (coulomb if name == "offset" else 1.0) for name in spec.states}
    torque = spec.torque_std or 0.05 * coulomb  # where it was not identified
    noise = FilterNoise(float(angle), torque, torque if spec.correlation_time > 0 else 0.0, drift=drift)
    return track_friction(
        name, identified.slides, joints, motions, records[0].rate_hz, noise, spec.settle,
        find_noise=spec.torque_std is None
    )  # fmt: skip


def _acting(record: FrictionRecord) -> tuple[FloatArray, FloatArray]:
    """Return torque and position (n,) at the times when the torque acts; the filter models the delay of the ZOH."""
    samples = np.arange(len(record.position))
    acting = samples + record.torque_delay_s * record.rate_hz - 0.5 * (record.hold == "zero-order")
    inside = (acting >= 0) & (acting <= samples[-1])
    return record.torque[inside], np.interp(acting[inside], samples, record.position)


SLIPS_OVER_PATH = 1e-4, 2e-5  # presliding distances, where no experiment identified one


def _joints(
    robot: Robot, identified: JointFriction, records: Sequence[FrictionRecord], spec: FilterSpec, law: PlacedLaw,
    viscous: float,
) -> tuple[TrackedJoint, ...]:  # fmt: skip
    """Return the joint to track, with each presliding distance that it may have."""
    F_c, F_s, inverse_nu_s = law.curve()[:3].tolist()
    bristles = [law.at_rest()]
    if law.law.n_states == 0:
        path = max(float(np.ptp(record.position)) for record in records)
        counts = max(20 * record.resolution for record in records)
        bristles = [(sigma, 0.0) for sigma in dict.fromkeys(F_c / max(s * path, counts) for s in SLIPS_OVER_PATH)]
    viscous, numbers = max(viscous, 1e-6 * F_c), {"stiction_ratio": F_s / F_c}
    numbers["stribeck_velocity"] = 1 / inverse_nu_s if inverse_nu_s > 0 else 0.0
    numbers["correlation_s"] = spec.correlation_time
    elastic = joint_spring(robot, records[0])
    if elastic is not None:
        inertia = elastic.motor_inertia
        numbers |= {"link_inertia": elastic.link_inertia, "stiffness": elastic.stiffness, "damping": elastic.damping}
    elif "inertia" in identified.shared:
        inertia = identified.shared["inertia"][0]
    else:
        raise StudyError(
            "filter/start",
            f"joint {identified.joint} has no spring in the robot's file, and no motion from which its inertia is "
            "known: a filter needs the inertia; record a motion that accelerates, or give the joint's spring",
        )
    joint = with_tolerances(TrackedJoint(inertia, F_c, viscous, 1.0, spec.states, **numbers), identified)
    return tuple(replace(joint, bristle_stiffness=sigma_0, bristle_damping=sigma_1) for sigma_0, sigma_1 in bristles)
