"""The figures of a friction study, joint by joint, in the order in which they are read."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence

from matplotlib.figure import Figure

from elastid.friction_fit.record_passes import passes_of
from elastid.friction_fit.result import FrictionResult, JointFriction
from elastid.friction_fit.warm_up import level_over_heat
from elastid.observer.follow import FollowedFriction
from elastid.report.figures.drawings import Drawing
from elastid.report.figures.friction_at_rest import friction_at_rest
from elastid.report.figures.friction_conditions import friction_conditions
from elastid.report.figures.friction_curve import friction_curve
from elastid.report.figures.friction_filter import friction_filter
from elastid.report.figures.friction_loops import friction_loops
from elastid.report.figures.friction_motion import friction_motion
from elastid.report.figures.friction_pass import friction_pass
from elastid.report.figures.friction_warm_up import friction_warm_up
from elastid.report.figures.twin import TORQUE_CAPTION, torque_balance_figure
from elastid.validation.twin import TorqueBalance

# Begins the section of a figure of one joint.
JOINT = "joint "


def friction_study_drawings(
    result: FrictionResult, filters: Sequence[FollowedFriction] = (), balances: Sequence[TorqueBalance] = ()
) -> Iterator[Drawing]:
    """The figures of all joints, drawn one by one so that only one is in memory."""
    for file, joint in zip(_file_names([joint.joint for joint in result.joints]), result.joints, strict=True):
        followed = [each for each in filters if each.joint == joint.joint]
        explained = [each for each in balances if each.place == f"{JOINT}{joint.joint}"]
        for name, caption, figure in (*_of_joint(joint), *map(_of_balance, explained), *map(_of_filter, followed)):
            yield Drawing(f"{file}-{name}", f"{JOINT}{joint.joint}", f"Joint {joint.joint}: {caption}", figure)


def _of_joint(joint: JointFriction) -> Iterator[tuple[str, str, Figure]]:
    """File-safe name, caption and figure of everything that was measured of a joint."""
    law, place = joint.static, f"joint {joint.joint}"
    if law is not None:
        caption = (
            "friction over speed, levels and law with 95 % intervals; shaded: the speeds that were measured, beyond "
            "which the law (dashed) is not to be relied on. Below: what the law leaves of each level."
        )
        yield "curve", caption, friction_curve(law)
        over = friction_conditions(law)
        if over is not None:
            caption = "levels over load or temperature at a few speeds, brought to one other condition by the law."
            yield "conditions", caption, over
    yield from _of_records(joint)
    if joint.at_rest is not None:
        caption = "stiffness and damping of the bristles at rest, by amplitude, and extrapolated to none."
        yield "at-rest", caption, friction_at_rest(place, joint.at_rest, joint.slides)
    if joint.thermal is not None and joint.warm_up is not None:
        caption = "warm-up: power, temperature and levels of the test passes; lines: what the thermal model predicts."
        level_of = level_over_heat(law, joint.warm_up)
        figure = friction_warm_up(place, joint.warm_up, joint.thermal, level_of, joint.slides)
        yield "warm-up", caption, figure


def _of_balance(found: TorqueBalance) -> tuple[str, str, Figure]:
    """The torque of a motion."""
    return "torque", TORQUE_CAPTION, torque_balance_figure(found)


def _of_filter(found: FollowedFriction) -> tuple[str, str, Figure]:
    """The filter of a joint."""
    caption = (
        "friction followed by a Kalman filter over the motions, with 95 % bands. Below: innovations squared over the "
        "variance that the filter expects (NIS), and their autocorrelation; the bands hold where both stay in theirs. "
        f"Weakest: {found.weakest.words}, known to {found.weakest.ratio:.0%} of what it was before."
    )
    return "filter", caption, friction_filter(found)


def _of_records(joint: JointFriction) -> Iterator[tuple[str, str, Figure]]:
    """A pass, a motion and loops."""
    if joint.levels is not None and joint.example is not None:
        caption = (
            "one pass there and back over the angle: torque measured and regressed, the parts of the regression, and "
            "what it leaves."
        )
        yield "pass", caption, friction_pass(passes_of(joint.example), joint.levels)
    if joint.motion is not None:
        caption = "torque of the whole motion without inertia and gravity over velocity, and over time."
        yield "motion", caption, friction_motion(joint.motion)
    if joint.presliding is not None and joint.loops is not None:
        caption = (
            "hysteresis before the joint slides, measured and replayed by Maxwell slip elements; torque k D of each "
            "threshold D; error of parts of the log that were left out of the fit, by number of elements."
        )
        yield "loops", caption, friction_loops(joint.loops, joint.presliding, joint.slides)


def _file_names(joints: Sequence[str]) -> list[str]:
    """friction-<joint> of letters, digits, dots and dashes, numbered where two would be the same file."""
    names = ["friction-" + re.sub(r"[^A-Za-z0-9._-]+", "-", joint) for joint in joints]
    lower = [name.lower() for name in names]
    return [name if lower.count(name.lower()) == 1 else f"{name}-{i + 1}" for i, name in enumerate(names)]
