"""The section `experiment.recorded` of a friction study: joints, loads, temperatures and channels of its logs."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from elastid.base.errors import did_you_mean
from elastid.experiment.specs.channels import ChannelSpec
from elastid.experiment.specs.recorded import FileSpec, RecordedSpec
from elastid.friction_study.spec import PassesSpec
from elastid.study.checks.names import unknown
from elastid.study.checks.recorded import check_channels, check_files
from elastid.study.messages import Problem
from elastid.study.sections import Study
from elastid.study.yaml_source import KeyPath

_RECORDED: KeyPath = ("experiment", "recorded")


def check_friction_logs(study: Study, recorded: RecordedSpec, base: Path) -> Iterator[Problem]:
    """Logs exist and are sampled at a known rate; each joint has its torque and position; names are known."""
    yield from check_files(study, recorded.files, _RECORDED, base)
    yield from check_channels(study, recorded.channels, _RECORDED)
    if recorded.rate_hz == "unknown":
        message = "friction depends on velocities, which need the sampling rate; give it in Hz"
        yield Problem((*_RECORDED, "rate_hz"), message)
    yield from _check_joints(study, recorded)
    yield from _check_controller(study, recorded)
    if isinstance(study.as_friction().passes, PassesSpec):
        message = "speeds, count and window are of passes that are still to be made; logs have passes: detect"
        yield Problem(("friction", "passes"), message, at_key=True)
    for i, file in enumerate(recorded.files):
        yield from _check_file(study, file, (*_RECORDED, "files", i))
    if study.as_friction().law.temperature == "yes" and not _has_temperature(recorded):
        yield Problem(
            ("friction", "law", "temperature"),
            "no log has a temperature; add a channel of role t and quantity temperature, give files[].temperature, or "
            "leave this key to auto",
        )


def _check_joints(study: Study, recorded: RecordedSpec) -> Iterator[Problem]:
    """Joints that are asked for by name have a torque and a position."""
    asked = study.as_friction().joints
    for joint in study.friction_joints if asked else ():
        torque = any(channel.role == "u" and channel.at == f"motor {joint.name}" for channel in recorded.channels)
        position = any(_is_position(channel, joint.name) for channel in recorded.channels)
        if not (torque and position):
            missing = "role u" if not torque else "role y and quantity position"
            yield Problem(
                (*_RECORDED, "channels"),
                f"no channel of {missing} is at motor {joint.name}, whose friction is asked for; add it, or leave the "
                "joint out of friction.joints",
                at_key=True,
            )


def _check_controller(study: Study, recorded: RecordedSpec) -> Iterator[Problem]:
    """A controller has gains for all joints and a reference in the logs, and a reference a controller."""
    controller, path = recorded.controller, (*_RECORDED, "controller")
    has_reference = any(channel.role == "reference" for channel in recorded.channels)
    if controller is None:
        if has_reference:
            message = "the reference of the logs is of no use without its controller; give controller, or leave it out"
            yield Problem((*_RECORDED, "channels"), message, at_key=True)
        return
    key, refused = controller.refusal(len(study.as_robot().driven))
    if refused:
        yield Problem((*path, key), refused)
    if not has_reference:
        message = "no channel has role reference, so that nothing tells what the controller was asked for; add it"
        yield Problem(path, message, at_key=True)


def _is_position(channel: ChannelSpec, joint: str) -> bool:
    return channel.quantity == "position" and channel.at in (f"motor {joint}", f"joint {joint}")


def _check_file(study: Study, file: FileSpec, path: KeyPath) -> Iterator[Problem]:
    driven = [joint.name for joint in study.as_robot().driven]
    loads = [load.name for load in study.as_friction().loads]
    if file.joint and file.joint not in driven:
        message = f"no driven joint is called '{file.joint}'; {did_you_mean(file.joint, driven)}"
        yield Problem((*path, "joint"), message)
    if file.load and file.load not in loads:
        yield unknown((*path, "load"), "load", file.load, loads)
    if study.experiment.as_recorded().period_of(file) is not None:
        message = "passes and loops of friction are evaluated without a period; leave period and period_samples out"
        yield Problem(path, message)


def _has_temperature(recorded: RecordedSpec) -> bool:
    by_hand = any(file.temperature is not None for file in recorded.files)
    return by_hand or any(channel.role == "t" for channel in recorded.channels)
