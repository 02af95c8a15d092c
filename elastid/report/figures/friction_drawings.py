"""The figures of a friction study, joint by joint, in the order in which they are read."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from functools import partial
from typing import TypeAlias

from matplotlib.figure import Figure

from elastid.base.escape import file_names
from elastid.friction_study.follow import FollowedFriction
from elastid.friction_study.laws import StaticLaw
from elastid.friction_study.passes import passes_of
from elastid.friction_study.result import FrictionResult, JointFriction
from elastid.friction_study.warm_up import ThermalModel, WarmUp, level_over_heat
from elastid.report.figures.drawings import Drawing, twin_drawings
from elastid.report.figures.friction_curve import conditions_of, friction_conditions, friction_curve
from elastid.report.figures.friction_over_time import friction_filter, friction_warm_up
from elastid.report.figures.friction_passes import friction_motion, friction_pass
from elastid.report.figures.friction_presliding import friction_at_rest, friction_loops
from elastid.report.figures.validation import (
    TORQUE_CAPTION,
    torque_balance_figure,
)
from elastid.validation.twin_run import NO_TWIN, TwinFindings

# Begins the section of a figure of one joint.
JOINT = "joint "
# File-safe name and caption of a figure, and the function that draws it.
Named: TypeAlias = tuple[str, str, Callable[[], Figure]]


def friction_study_drawings(
    result: FrictionResult, filters: Sequence[FollowedFriction] = (), twin: TwinFindings = NO_TWIN
) -> Iterator[Drawing]:
    """The figures of all joints, and of the twin along their logs, to be drawn."""
    yield from twin_drawings(twin.runs)
    files = file_names([joint.joint for joint in result.joints], "friction")
    for file, joint in zip(files, result.joints, strict=True):
        followed = [tracked for tracked in filters if tracked.joint == joint.joint]
        explained = [balance for balance in twin.balances if balance.place == f"{JOINT}{joint.joint}"]
        torques: list[Named] = [
            ("torque", TORQUE_CAPTION, partial(torque_balance_figure, balance)) for balance in explained
        ]
        for name, caption, draw in (*_of_joint(joint), *torques, *map(_of_filter, followed)):
            yield Drawing(f"{file}-{name}", f"{JOINT}{joint.joint}", f"Joint {joint.joint}: {caption}", draw)


def _of_joint(joint: JointFriction) -> Iterator[Named]:
    """File-safe name, caption and function that draws everything that was measured of a joint."""
    law, place = joint.static, f"joint {joint.joint}"
    if law is not None:
        caption = (
            "friction over speed, levels and law with 95 % intervals; shaded: the speeds that were measured, beyond "
            "which the law (dashed) is not to be relied on. Below: what the law leaves of each level."
        )
        yield "curve", caption, partial(friction_curve, law)
        if conditions_of(law):
            caption = "levels over load or temperature at a few speeds, brought to one other condition by the law."
            yield "conditions", caption, partial(friction_conditions, law)
    yield from _of_records(joint)
    if joint.at_rest is not None:
        caption = "stiffness and damping of the bristles at rest, by amplitude, and extrapolated to none."
        yield "at-rest", caption, partial(friction_at_rest, place, joint.at_rest, joint.slides)
    if joint.thermal is not None and joint.warm_up is not None:
        caption = "warm-up: power, temperature and levels of the test passes; lines: what the thermal model predicts."
        yield "warm-up", caption, partial(_warm_up, place, joint.warm_up, joint.thermal, law, joint.slides)


def _warm_up(place: str, warm_up: WarmUp, thermal: ThermalModel, law: StaticLaw | None, slides: bool) -> Figure:
    return friction_warm_up(place, warm_up, thermal, level_over_heat(law, warm_up), slides)


def _of_filter(followed: FollowedFriction) -> Named:
    """The filter of a joint."""
    caption = (
        "friction followed by a Kalman filter over the motions, with 95 % bands. Below: innovations squared over the "
        "variance that the filter expects (NIS), and their autocorrelation; the bands hold where both stay in theirs. "
        f"Weakest: {followed.weakest.words}, known to {followed.weakest.ratio:.0%} of what it was before."
    )
    return "filter", caption, partial(friction_filter, followed)


def _of_records(joint: JointFriction) -> Iterator[Named]:
    """A pass, a motion and loops."""
    if joint.levels is not None and joint.example is not None:
        caption = (
            "one pass there and back over the angle: torque measured and regressed, the parts of the regression, and "
            "what it leaves."
        )
        yield "pass", caption, partial(friction_pass, passes_of(joint.example), joint.levels)
    if joint.motion is not None:
        caption = "torque of the whole motion without inertia and gravity over velocity, and over time."
        yield "motion", caption, partial(friction_motion, joint.motion)
    if joint.presliding is not None and joint.loops is not None:
        caption = (
            "hysteresis before the joint slides, measured and replayed by Maxwell slip elements; torque k D of each "
            "threshold D; error of parts of the log that were left out of the fit, by number of elements."
        )
        yield "loops", caption, partial(friction_loops, joint.loops, joint.presliding, joint.slides)
