"""follow: records and law of a friction study -> filter.h5, friction followed by a Kalman filter over the motions."""

from __future__ import annotations

from elastid.app.followed_joint import followable
from elastid.app.run import Run
from elastid.base.errors import StudyError
from elastid.base.note import Note
from elastid.base.numbers import number
from elastid.friction_fit.result import JointFriction
from elastid.friction_record import FrictionRecord, FrictionRecords
from elastid.observer.follow import FollowedFriction, follow
from elastid.observer.spec import FilterSpec
from elastid.store.friction_study import read_friction_records, read_friction_result, write_filter


def follow_friction(run: Run) -> None:
    """filter.h5: of each joint the followed numbers over time with their bands, and whether they can be believed."""
    measured, result = read_friction_records(run.path("measure")), read_friction_result(run.path("friction"))
    spec = run.study.filter or FilterSpec()
    found, notes = [], []
    for joint in result.joints:
        records = followed_records(measured, joint.joint)
        try:
            found.append(_followed(run, joint, records, spec))
        except StudyError as error:
            notes.append(Note("not-followed", str(error)))
    if not found:
        raise StudyError("; ".join(note.text for note in notes))
    write_filter(run.path("follow"), tuple(found), run.stamps["follow"])
    run.console.notes([*notes, *(note for each in found for note in each.notes)])
    for each in found:
        run.console.say(f"follow: joint {each.joint}: {_words(each)}")


def followed_records(measured: FrictionRecords, joint: str) -> tuple[FrictionRecord, ...]:
    """The motions of a joint that moved alone, in the order of time."""
    together = [record.name for record in measured.records]
    own = [record for record in measured.records if record.joint == joint and together.count(record.name) == 1]
    chosen = [record for record in own if record.purpose in ("passes", "motion")]
    return tuple(sorted(chosen, key=lambda record: record.start_s))


def _followed(
    run: Run, joint: JointFriction, records: tuple[FrictionRecord, ...], spec: FilterSpec
) -> FollowedFriction:
    if not records:
        raise StudyError(
            f"joint {joint.joint} has no motion in which it moves alone, with the torque of gravity known; record one"
        )
    ready = followable(run.study.as_robot(), joint, records, spec)
    return follow(
        joint.joint, joint.slides, ready.joint, ready.motions, ready.rate_hz, ready.noise, spec.settle,
        find_noise=spec.torque_std is None,
    )  # fmt: skip


def _words(found: FollowedFriction) -> str:
    """The followed numbers at the end, and the NIS."""
    ends = [
        f"{name} {number(found.values[-1, i])} ({number(found.low[-1, i])} to {number(found.high[-1, i])})"
        for i, name in enumerate(found.names)
    ]
    return f"at the end {', '.join(ends)}; mean NIS {number(found.consistency.nis, 3)}"
