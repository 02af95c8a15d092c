"""The section `friction` against robot, experiment and disk: joints, windows, speeds, loads, other sections."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from elastid.base.errors import did_you_mean
from elastid.friction_study.spec import FrictionSpec, LoadSpec
from elastid.robot import Joint
from elastid.study.checks.experiment import check_experiment
from elastid.study.checks.friction_logs import check_friction_logs
from elastid.study.checks.names import unknown
from elastid.study.checks.simulated import check_simulated
from elastid.study.messages import Problem
from elastid.study.sections import Study, joint_called
from elastid.study.yaml_source import KeyPath

_FRICTION: KeyPath = ("friction",)
_PASSES: KeyPath = ("friction", "passes")


def check_friction(study: Study, base: Path) -> Iterator[Problem]:
    """Every contradiction of a study of friction, whose files are relative to `base`."""
    spec, experiment = study.as_friction(), study.experiment
    if study.robot is None:
        yield Problem(_FRICTION, "friction is that of a robot's joints; give robot (the path of its file)", at_key=True)
        return
    yield from _check_sections(study)
    yield from _check_joints(study, spec)
    for i, load in enumerate(spec.loads):
        yield from _check_load(study, load, (*_FRICTION, "loads", i))
    if experiment.recorded is not None:
        yield from check_friction_logs(study, experiment.recorded, base)
        return
    yield from check_experiment(study)
    if spec.passes == "detect":
        message = "detect is for logs (experiment.recorded), whose passes are there; give speeds, count, window ..."
        yield Problem(_PASSES, message)
    if experiment.simulated is not None:
        yield from check_simulated(study, experiment.simulated)
    for joint in study.friction_joints:
        yield from _check_passes(spec, joint)


def _check_sections(study: Study) -> Iterator[Problem]:
    """Sections of the other kind of study."""
    for name in ("excitation", "design"):
        if getattr(study, name) is not None:
            message = f"friction is measured by passes and loops, not by {name}; drop this section, or friction"
            yield Problem((name,), message, at_key=True)
    if study.experiment.responses is not None:
        message = "friction is found in motions, not in frequency responses; give logs (recorded) or simulated"
        yield Problem(("experiment", "responses"), message, at_key=True)


def _check_joints(study: Study, spec: FrictionSpec) -> Iterator[Problem]:
    """Joints exist and have a motor, each once."""
    driven = [joint.name for joint in study.as_robot().driven]
    seen: dict[str, str] = {}
    for i, name in enumerate(spec.joints):
        joint = joint_called(name, driven)
        if joint is None:
            message = f"no driven joint is called '{name}'; {did_you_mean(name, driven)}, or give its number from 1"
            yield Problem((*_FRICTION, "joints", i), message)
        elif joint in seen:
            yield Problem((*_FRICTION, "joints", i), f"'{name}' and '{seen[joint]}' are the same joint; leave one out")
        else:
            seen[joint] = name


def _check_passes(spec: FrictionSpec, joint: Joint) -> Iterator[Problem]:
    """Windows and speeds in the joint's unit and within its limits."""
    limits, passes = joint.limits, spec.designed_passes
    for name, pair in (("window", passes.window), ("speeds", passes.speeds)):
        for i, value in enumerate(pair or ()):
            if refused := joint.refusal_of(value):
                yield Problem((*_PASSES, name, i), refused)
    if passes.window is not None and not limits.angle[0] <= passes.window[0] < passes.window[1] <= limits.angle[1]:
        yield Problem(
            (*_PASSES, "window"),
            f"the window leaves the limits of joint {joint.name}, {limits.angle[0]:.4g} to {limits.angle[1]:.4g} "
            f"{joint.unit}; narrow it",
        )
    if passes.speeds is not None and passes.speeds[1] > limits.velocity:
        yield Problem(
            (*_PASSES, "speeds", 1),
            f"joint {joint.name} may move at {limits.velocity:.4g} {joint.unit}/s; lower the highest speed",
        )
    warm_up = spec.warm_up
    if warm_up is not None and (refused := joint.refusal_of(warm_up.speed)):
        yield Problem((*_FRICTION, "warm_up", "speed"), refused)


def _check_load(study: Study, load: LoadSpec, path: KeyPath) -> Iterator[Problem]:
    """The posture exists, and a payload has a seat."""
    known = list(study.experiment.configurations)
    if load.configuration is not None and load.configuration not in known:
        yield unknown((*path, "configuration"), "configuration", load.configuration, known)
    if load.payload and not study.as_robot().frames:
        yield Problem(
            (*path, "payload"), "no frame of the robot can carry a payload; give it one: frames: [{name: tool, ...}]"
        )
