"""The section `experiment` against the rest of the study: configurations, simulated rig, studies without a robot."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import fields

import numpy as np

from elastid.experiment.specs.disturbances import WarmingSpec
from elastid.experiment.specs.simulated import SimulatedSpec, chain_refusal, saturation_refusal
from elastid.robot import Joint, Robot
from elastid.study.checks.fit import check_model
from elastid.study.checks.names import check_place, check_units
from elastid.study.messages import Problem
from elastid.study.sections import Study
from elastid.study.source import KeyPath

# Keys of a plan, which logs and responses from elsewhere do not follow.
PLAN_KEYS = ("realisations", "periods", "transient_periods", "ramp", "hold")
_SIMULATED: KeyPath = ("experiment", "simulated")
# Sections that only stages with a robot read.
_OF_A_ROBOT = ("excitation", "design", "model", "fit", "validation", "compare")


def check_experiment(study: Study) -> Iterator[Problem]:
    """Experiments of a realisation, and configurations."""
    yield from _check_count(study)
    yield from _check_configurations(study)


def check_plan_keys(study: Study) -> Iterator[Problem]:
    """None of a plan where there is none: logs and responses have their own realisations and periods."""
    experiment = study.experiment
    defaults = {f.name: f.default for f in fields(experiment)}
    for key in PLAN_KEYS if experiment.simulated is None else ():
        if getattr(experiment, key) != defaults[key]:
            message = (
                f"the experiment is {experiment.kind}: its files determine this; drop the key (files[].realisation "
                "numbers realisations, estimator.transient_periods leaves periods out)"
            )
            yield Problem(("experiment", key), message, at_key=True)


def _check_count(study: Study) -> Iterator[Problem]:
    """As many experiments in a realisation as motors at most, and enough for the estimator."""
    experiment, excitation, estimator = study.experiment, study.excitation, study.estimator
    given, n_u, path = experiment.experiments, len(study.as_robot().driven), ("experiment", "experiments")
    if given is None:
        return
    if experiment.simulated is None:
        message = f"the experiment is {experiment.kind}: its files determine the number of experiments; drop this key"
        yield Problem(path, message, at_key=True)
        return
    if given > n_u:
        yield Problem(
            path,
            f"{given} experiments in a realisation, but an orthogonal set for {n_u} motors has {n_u}; give {n_u} at "
            "most, and more realisations instead",
        )
    needed = estimator.experiments_needed(n_u, experiment.realisations)
    if given < needed:
        yield Problem(
            path,
            f"{given} experiments in each of {experiment.realisations} realisations, but estimator.method "
            f"{estimator.method} needs at least {needed} to separate {n_u} motors; give {needed}, or take "
            "estimator.method local_rational, local_polynomial or auto",
        )
    if excitation is None or given >= n_u or excitation.orthogonal == "zippered":
        return
    if not excitation.is_new_in_every_realisation:
        yield Problem(
            path,
            f"with {excitation.phases} phases all motors move in proportion in each of {given} experiments, so that "
            f"neighbouring lines do not separate {n_u} motors; take random phases, orthogonal: zippered, or {n_u} "
            "experiments",
        )


def _check_configurations(study: Study) -> Iterator[Problem]:
    """One angle for each driven joint, in its unit and within its limits, the swing of a carrier included."""
    robot, swings = study.as_robot(), _swings(study)
    for name, angles in study.experiment.configurations.items():
        path: KeyPath = ("experiment", "configurations", name)
        if refused := robot.count_refusal(len(angles)):
            yield Problem(path, refused)
            continue
        for i, (angle, joint, swing) in enumerate(zip(angles, robot.driven, swings, strict=True)):
            if refused := joint.refusal_of(angle) or _angle_refusal(angle, joint, swing):
                yield Problem((*path, i), refused)


def _swings(study: Study) -> list[float]:
    """Amplitude of the carrier at each driven joint; 0 where there is none, or a wrong number of them."""
    n_u, simulated = len(study.as_robot().driven), study.experiment.simulated
    carrier = simulated.carrier if simulated is not None else None
    if carrier is None or carrier.amplitude is None or np.size(carrier.amplitude) not in (1, n_u):
        return [0.0] * n_u
    return list(carrier.amplitudes(n_u).tolist())


def _angle_refusal(angle: float, joint: Joint, swing: float) -> str:
    """Why a joint cannot be at a position, in rad or m, and swing about it; empty where it can."""
    low, high = joint.limits.angle
    # Without limits: beyond a long rail in m, or two turns in rad, it was given in another unit.
    if math.isinf(high - low) and abs(angle) > (50.0 if joint.slides else 4 * math.pi):
        other = f"{angle:g} mm" if joint.slides else f"{angle:g} deg"
        far = f"{angle:g} m" if joint.slides else f"{angle:g} rad, {abs(angle) / (2 * math.pi):.2g} turns,"
        return (
            f"joint {joint.name} at {far} is farther than robots go; a number without a unit is in {joint.unit}: write "
            f"'{other}' if that is meant, or give the joint its limits"
        )
    if low <= angle - swing <= angle + swing <= high:
        return ""
    reach = f" with the carrier's {swing:.4g} {joint.unit} to either side" if swing else ""
    return (
        f"joint {joint.name} at {angle:.4g} {joint.unit}{reach} is outside its limits [{low:.4g}, {high:.4g}] "
        f"{joint.unit}"
    )


def check_simulated(study: Study, simulated: SimulatedSpec) -> Iterator[Problem]:
    """A rig that can be simulated with this robot."""
    robot, carrier = study.as_robot(), simulated.carrier
    for i, output in enumerate(simulated.outputs):
        yield from check_place((*_SIMULATED, "outputs", i), output, robot)
    if simulated.saturation and (refused := saturation_refusal(robot)):
        yield Problem((*_SIMULATED, "saturation"), refused)
    if refused := chain_refusal(robot):
        yield Problem(_SIMULATED, refused, at_key=True)
    yield from check_model((*_SIMULATED, "model"), simulated.model, robot)
    if carrier is not None:
        yield from check_units((*_SIMULATED, "carrier", "amplitude"), carrier.amplitude, robot)
        yield from check_units((*_SIMULATED, "carrier", "velocity"), carrier.velocity, robot)
    if simulated.warming is not None:
        yield from _check_temperatures(robot, simulated.warming)


def _check_temperatures(robot: Robot, warming: WarmingSpec) -> Iterator[Problem]:
    """Temperatures act on some friction law, and leave each a stiction."""
    if warming.temperature is None:
        return
    from elastid.friction.robot_friction import frictions  # brings CasADi, which few checks need

    path: KeyPath = (*_SIMULATED, "warming", "temperature")
    laws = [law for law in frictions(robot) if law.spec.temperature is not None]
    if not laws:
        message = "no friction of the robot depends on temperature; give a `temperature` to its friction, or drop this"
        yield Problem(path, message)
    for law in laws:
        for temperature in warming.temperature:
            try:
                law.curve(0.0, temperature)
            except ValueError as error:
                yield Problem(path, str(error))


def check_structure(study: Study) -> Iterator[Problem]:
    """Every contradiction between the sections of a study without a robot, its files and channels excepted."""
    experiment = study.experiment
    if experiment.simulated is not None:
        message = "the experiment is simulated, and the robot is what the rig simulates; give the path of its file"
        yield Problem(("robot",), message, at_key=True)
        return
    for section, default in ((f.name, f.default) for f in fields(Study) if f.name in _OF_A_ROBOT):
        if getattr(study, section) != default:
            message = "this section needs a robot, and the study has none; give robot: its file, or drop the section"
            yield Problem((section,), message, at_key=True)
    if not experiment.configurations:
        message = (
            "no configuration is given; name each state of the structure that was measured, for example {bench: []}"
        )
        yield Problem(("experiment", "configurations"), message)
    for name, angles in experiment.configurations.items():
        path = ("experiment", "configurations", name)
        if refused := study.places.count_refusal(len(angles)):
            yield Problem(path, refused)
    if experiment.experiments is not None:
        message = f"the experiment is {experiment.kind}: its files determine the number of experiments; drop this key"
        yield Problem(("experiment", "experiments"), message, at_key=True)
