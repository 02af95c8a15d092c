"""The section `friction` against robot, experiment and logs: joints, windows, speeds, loads, other sections."""

from collections.abc import Iterator
from pathlib import Path

from elastid.base.errors import did_you_mean
from elastid.experiment.specs.logs import FileSpec, RecordedSpec
from elastid.friction_study.spec import ConstantVelocitySpec, FrictionSpec
from elastid.robot import Joint
from elastid.study.checks.experiment import check_configurations, check_count, check_simulated
from elastid.study.checks.logs import check_channels, check_controller, check_files
from elastid.study.checks.names import check_names, unknown
from elastid.study.messages import Problem
from elastid.study.sections import Study, joint_called
from elastid.study.source import KeyPath

_FRICTION: KeyPath = ("friction",)
_PASSES: KeyPath = ("friction", "constant_velocity")
_RECORDED: KeyPath = ("experiment", "recorded")


def check_friction(study: Study, base: Path) -> Iterator[Problem]:
    """Yield every contradiction of a study of friction, whose files are relative to `base`."""
    spec, experiment = study.as_friction(), study.experiment
    if study.robot is None:
        yield Problem(_FRICTION, "a friction study needs a robot. Give the path of its file", at_key=True)
        return
    yield from _check_joints(study, spec)
    names = list(experiment.configurations)
    for i, load in enumerate(spec.loads):
        path = (*_FRICTION, "loads", i)
        if load.configuration is not None and load.configuration not in names:
            yield unknown((*path, "configuration"), "configuration", load.configuration, names)
        if load.payload and not study.robot.frames:
            advice = f"frames: [{{name: tool, body: {study.robot.bodies[-1].name}}}]"
            yield Problem((*path, "payload"), f"the robot has no frame for a payload. Add {advice}")
    if experiment.recorded is not None:
        yield from check_friction_logs(study, experiment.recorded, base)
        return
    yield from check_count(study)
    yield from check_configurations(study)
    if spec.constant_velocity == "detect":
        yield Problem(_PASSES, "detect requires logs (experiment.recorded). Give speeds, count and window")
    if experiment.simulated is not None:
        yield from check_simulated(study, experiment.simulated)
    for joint in study.friction_joints:
        yield from _check_passes(spec, joint)


def _check_joints(study: Study, spec: FrictionSpec) -> Iterator[Problem]:
    driven = study.as_robot().driven_names
    spelling: dict[str, str] = {}
    for i, name in enumerate(spec.joints):
        joint = joint_called(name, driven)
        if joint is None:
            message = f"no driven joint is called '{name}'; {did_you_mean(name, driven)}, or give its number from 1"
            yield Problem((*_FRICTION, "joints", i), message)
        elif joint in spelling:
            yield Problem((*_FRICTION, "joints", i), f"'{name}' and '{spelling[joint]}' are the same joint. Omit one")
        else:
            spelling[joint] = name


def _check_passes(spec: FrictionSpec, joint: Joint) -> Iterator[Problem]:
    limits, passes = joint.limits, spec.designed_passes
    for name, pair in (("window", passes.window), ("speeds", passes.speeds)):
        for i, value in enumerate(pair or ()):
            if refusal := joint.refusal_of(value):
                yield Problem((*_PASSES, name, i), refusal)
    if passes.window is not None and not limits.angle[0] <= passes.window[0] < passes.window[1] <= limits.angle[1]:
        message = f"the window exceeds the limits of joint {joint.name}, {limits.angle[0]:.4g} to {limits.angle[1]:.4g}"
        yield Problem((*_PASSES, "window"), f"{message} {joint.unit}. Narrow it")
    if passes.speeds is not None and passes.speeds[1] > limits.velocity:
        message = f"joint {joint.name} is limited to {limits.velocity:.4g} {joint.unit}/s. Lower the highest speed"
        yield Problem((*_PASSES, "speeds", 1), message)
    if spec.warm_up is not None and (refusal := joint.refusal_of(spec.warm_up.speed)):
        yield Problem((*_FRICTION, "warm_up", "speed"), refusal)


def check_friction_logs(study: Study, recorded: RecordedSpec, base: Path) -> Iterator[Problem]:
    """Check that logs exist and names are known; the stage measure rejects missing rates and channels."""
    yield from check_files(study, recorded.files, _RECORDED, base)
    yield from check_channels(study, recorded.channels, _RECORDED)
    yield from check_controller(study, recorded)
    if recorded.controller is not None and not any(channel.role == "reference" for channel in recorded.channels):
        message = "no channel has role reference, so that the commanded position is unknown. Add it"
        yield Problem((*_RECORDED, "controller"), message, at_key=True)
    if isinstance(study.as_friction().constant_velocity, ConstantVelocitySpec):
        message = "speeds, count and window describe runs to be designed. For logs set constant_velocity: detect"
        yield Problem(("friction", "constant_velocity"), message, at_key=True)
    for i, file in enumerate(recorded.files):
        yield from _check_file(study, file, (*_RECORDED, "files", i))
    has_degc = [c.role == "t" for c in recorded.channels] + [file.temperature is not None for file in recorded.files]
    if study.as_friction().law.temperature == "yes" and not any(has_degc):
        message = "no log has a temperature. Add a channel of role t, or give files[].temperature"
        yield Problem(("friction", "law", "temperature"), message)
    pairs = zip(recorded.log_names, recorded.files, strict=True)
    motions, validation = [name for name, file in pairs if file.purpose == "motion"], study.validation.configurations
    yield from check_names(("validation", "configurations"), "log of a motion", validation, motions)
    if set(validation) >= set(recorded.log_names):
        message = "every log is reserved for validation. Leave at least one for identification"
        yield Problem(("validation", "configurations"), message)


def _check_file(study: Study, file: FileSpec, path: KeyPath) -> Iterator[Problem]:
    loads = [load.name for load in study.as_friction().loads]
    if file.load and file.load not in loads:
        yield unknown((*path, "load"), "load", file.load, loads)
    driven = study.as_robot().driven_names
    if file.joint and file.joint not in driven:
        yield unknown((*path, "joint"), "driven joint", file.joint, driven)
    if file.ambient is not None and file.purpose != "warm_up":
        message = "ambient is the room temperature of a warm-up. Give the joint's as temperature"
        yield Problem((*path, "ambient"), message)
    motors = sorted({channel.at for channel in study.experiment.channels if channel.role == "u"})
    if file.purpose in ("presliding_loops", "presliding_test") and not file.joint and len(motors) > 1:
        message = f"several motors are logged ({', '.join(motors)}), and in presliding all of them move a little"
        yield Problem((*path, "purpose"), message + ". Set joint to the excited joint")
